"""The same manifest whoever builds, and whatever the folder looks like (F28)."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from .conftest import Place, new_legs

pytestmark = pytest.mark.slow
NOBODY = 65534


def built(legs: Place, **options: object) -> bytes:
    done = subprocess.run(
        legs.command("build", "legs.yaml"),
        cwd=legs.folder,
        env=legs.env(HOME=str(legs.folder), TZ="Asia/Tokyo"),
        capture_output=True,
        text=True,
        timeout=300,
        **options,  # type: ignore[call-overload]  # keyword arguments of subprocess
    )
    assert done.returncode == 0, done.stderr
    return legs.manifest()


def test_a_private_umask_and_files_in_another_order_with_other_dates(
    legs: Place, built_legs: Place
):
    for path in (legs.urdf, legs.recipe):  # the other way round, and long ago
        text = path.read_bytes()
        path.unlink()
        path.write_bytes(text)
        os.utime(path, (1e9, 1e9))
    assert built(legs, umask=0o077) == built_legs.manifest()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can build as another user")
def test_another_user(tmp_path: Path, built_legs: Place):
    legs = new_legs(tmp_path / "legs")
    for path in (tmp_path, *tmp_path.rglob("*")):
        os.chown(path, NOBODY, NOBODY)
    for parent in tmp_path.parents:
        if not parent.stat().st_mode & 0o001:
            pytest.skip(f"another user cannot reach {parent}")
    assert built(legs, user=NOBODY, group=NOBODY) == built_legs.manifest()
