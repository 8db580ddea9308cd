"""Two small robots of the corpus, each for what it shows; the whole corpus is `run.py`."""

from __future__ import annotations

from pathlib import Path

import pytest

from corpus.lists import Robot
from corpus.one import one

ROBOTS = {
    "quadruped_description/urdf/quadruped.urdf": "locked knees, meshes beside the URDF",
    "hector_description/robots/quadrotor_base.urdf": "nothing moves but its base",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_init_and_build(name: str, go1_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    if not (go1_root / "robots" / name).is_file():
        pytest.skip(f"no {name} in {go1_root}: name the unpacked package in ASSETBUILD_TEST_DATA")
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))
    row = one(Robot(name, go1_root / "robots" / name, go1_root), tmp_path)
    assert (row["result"], row["judge"], row["lost"]) == ("ready", "equal", []), row["note"]
