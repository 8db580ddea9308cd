"""Wrong input: one clear error with file, line and hint, the right exit code, no traceback."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from tiny import stl

from .conftest import LEGS, LEGS_RECIPE, Place, new_legs


def refused(legs: Place, code: int, *parts: str, command: tuple[str, ...] = ()) -> str:
    """Build, expect one error with `parts` in it; the old bundle must be as it was."""
    before = _snapshot(legs.bundle)
    done = legs.run(*(command or ("build", "legs.yaml")))
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert done.stderr.count("error: ") == 1, done.stderr
    for part in parts:
        assert part in done.stderr, done.stderr
    assert _snapshot(legs.bundle) == before
    return done.stderr


def _snapshot(folder: Path) -> dict[str, int]:
    return {str(p): p.stat().st_mtime_ns for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def legs_with_a_bundle(tmp_path_factory: pytest.TempPathFactory, legs_store: Path) -> Place:
    folder = tmp_path_factory.mktemp("bad-input")
    legs = new_legs(folder / "legs", shutil.copytree(legs_store, folder / "store"))
    assert legs.build().returncode == 0
    return legs


@pytest.fixture
def built(legs_with_a_bundle: Place) -> Place:
    """The input put right again before each test; the bundle is never touched."""
    legs_with_a_bundle.recipe.write_text(LEGS_RECIPE)
    shutil.copyfile(LEGS, legs_with_a_bundle.urdf)
    return legs_with_a_bundle


def with_mesh(legs: Place, data: bytes | None) -> None:
    """The trunk is shown as `trunk.stl`; without data there is no such file."""
    if data is not None:
        (legs.folder / "robot/trunk.stl").write_bytes(data)
    shown = '</inertial><visual><geometry><mesh filename="trunk.stl"/></geometry></visual>'
    legs.urdf.write_text(legs.urdf.read_text().replace("</inertial>", shown, 1))


def test_a_missing_mesh(built: Place):
    with_mesh(built, None)
    refused(built, 2, "four_legs.urdf:4", "trunk.stl", "hint: ")


def test_a_cut_off_mesh(built: Place):
    with_mesh(built, stl(np.arange(18.0).reshape(2, 3, 3))[:-20])
    refused(built, 1, "trunk.stl", "hint: ")


def test_no_such_recipe(legs: Place):
    refused(legs, 2, "dogs.yaml", command=("build", "dogs.yaml"))


def test_a_folder_that_is_no_bundle_is_never_replaced(warm_legs: Place):
    precious = warm_legs.folder / "precious"
    precious.mkdir()
    (precious / "thesis.tex").write_text("x")
    refused(warm_legs, 2, "precious", command=("build", "legs.yaml", "-o", "precious"))
    assert (precious / "thesis.tex").read_text() == "x"


def test_a_stale_lock_is_out_of_date(legs: Place):
    legs.edit("path: robot", "pypi: example-robot-data==6.0.0")
    legs.recipe.with_name("legs.lock.yaml").write_text(
        "schema: assetbuild-lock/v1\nsource:\n  pypi: example-robot-data==5.0.0\n"
        f'  file: example_robot_data-5.0.0-py3-none-any.whl\n  sha256: "{"0" * 64}"\n  size: 1\n'
    )
    refused(legs, 3, "legs.lock.yaml", "assetbuild lock", command=("check", "legs.yaml"))
    refused(legs, 3, "legs.lock.yaml", command=("build", "--frozen", "legs.yaml"))
