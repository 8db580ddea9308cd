"""Robots that cannot stand with all joints at 0, built in every format."""

from __future__ import annotations

import json
import os
from pathlib import Path

import commands
import pytest
import urdfs

KNEE = '<limit lower="-2" upper="-0.5" effort="9" velocity="5"/>'
RECIPE = """schema: assetbuild/v1
robot: leg
source: {path: ., urdf: leg.urdf, license: MIT}
base: fixed
collision: {default: {method: keep}}
actuators: [{joints: ".*", model: pd, kp: 30, kd: 2, armature: 0.01}]
targets: [urdf, mjcf, mjx, usd, mjlab, isaaclab]
"""
STANCE = "keyframes: {stance: {joints: {hip: 0.4, knee: -1}}}\n"


def leg() -> str:
    rod = urdfs.shape("collision", '<cylinder radius="0.02" length="0.2"/>')
    return urdfs.robot(
        urdfs.link("base"),
        urdfs.link("thigh", urdfs.inertial(), rod),
        urdfs.link("shank", urdfs.inertial(), rod),
        urdfs.joint("hip", "base", "thigh"),
        urdfs.joint("knee", "thigh", "shank", content=KNEE),
    )


@pytest.mark.slow  # whole builds, pictures and all
@pytest.mark.parametrize("keyframes", ["", STANCE], ids=["none", "stance"])
def test_a_bent_knee_is_ready_without_a_keyframe_named_home(tmp_path: Path, keyframes: str):
    (tmp_path / "leg.urdf").write_text(leg())
    (tmp_path / "leg.yaml").write_text(RECIPE + keyframes)
    environment = os.environ | {"ASSETBUILD_CACHE": str(tmp_path / "cache")}
    done = commands.run(["build", "leg.yaml", "-o", "out"], tmp_path, environment)
    assert done.returncode == 0, done.stdout + done.stderr
    verdict = json.loads((tmp_path / "out/report/report.json").read_text())["verdict"]
    assert verdict["ready"], verdict
