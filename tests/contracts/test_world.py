"""Nothing asks the world around the one door: what a build looked at stands in its record."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from .code_robots import write_robots


@pytest.mark.slow
def test_all_that_cold_builds_looked_at_stands_in_their_record(tmp_path: Path):
    """Three robots, built from nothing: a xacro that carries an MJCF, that MJCF, and a URDF."""
    folder = tmp_path / "mine"
    for made in (folder, tmp_path / "out"):
        made.mkdir()
    _, *recipes = map(str, write_robots(folder))
    program = Path(__file__).with_name("asking.py")
    done = subprocess.run(
        [sys.executable, str(program), str(tmp_path / "out"), *recipes],
        cwd=folder,
        env={**os.environ, "ASSETBUILD_CACHE": str(tmp_path / "store")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert not found["errors"] and found["whole"]
    assert found["lacking"] == []
    files = {Path(subject).name for kind, subject, _ in found["recorded"] if kind == "bytes"}
    assert files >= {"rod.yaml", "rod.urdf", "tile.mtl", "motors.yaml", "body.xacro", "pole.csv"}
    assert ["variable", "MUJOCO_GL", ""] in found["recorded"]
