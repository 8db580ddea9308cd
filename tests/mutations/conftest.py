"""Bundles of tiny robots, built once for all workers."""

from __future__ import annotations

import os
from pathlib import Path

import commands
import pytest
from once import made_once
from tiny import box_obj

ROBOTS = Path(__file__).parents[1] / "robots"
LEGS = """\
schema: assetbuild/v1
robot: legs
source: {path: robot, urdf: four_legs.urdf, license: MIT}
base: floating
collision: {default: {method: keep}}
actuators:
  - {joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}
keyframes:
  home: {base: on_ground, joints: {".*_hip_joint": 0, ".*_thigh_joint": 0.3, ".*_calf_joint": -1}}
randomize: {joints: {".*_calf_joint": {kp: [0.9, 1.1]}}}
targets: [urdf, mjcf, mjx, usd, mjlab]
validate: {free_fall: null, sine: null}
"""
COVER = '<visual name="cover"><geometry><mesh filename="cover.obj"/></geometry></visual>'


def built(folder: Path, recipe: str) -> Path:
    """The bundle of a recipe whose robot lies in `robot/` of the folder."""
    (folder / "robot.yaml").write_text(recipe)
    kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
    environment = kept | {"ASSETBUILD_CACHE": str(folder / "store")}
    words = ("build", "robot.yaml", "-o", "bundle", "--fail-on", "never")
    done = commands.run(words, folder, environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "bundle"


@pytest.fixture(scope="session")
def legs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A quadruped of primitives below a cover, with every target but Isaac Lab's."""

    def build(folder: Path) -> None:
        (folder / "robot").mkdir(parents=True)
        (folder / "robot/cover.obj").write_bytes(box_obj((0.3, 0.2, 0.02)))
        urdf = (ROBOTS / "four_legs.urdf").read_text().replace("</link>", f"{COVER}</link>", 1)
        (folder / "robot/four_legs.urdf").write_text(urdf)
        built(folder, LEGS)

    folder: Path = made_once("mutated-legs", build, tmp_path_factory)
    return folder / "bundle"
