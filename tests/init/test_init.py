"""The recipe that `init` writes: its choices, and that it builds."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
from pathlib import Path

import commands
import mujoco
import pytest
import urdfs
from daes import CUBE, dae
from proposals import proposed

from assetbuild.cli.init import SCHEMA_FILE, write_schema
from assetbuild.init import propose
from assetbuild.init.anatomy import study
from assetbuild.init.drives import STEP_S
from assetbuild.init.home import home_pose
from assetbuild.init.look import InspectedRobot, look
from assetbuild.init.source import find_source
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators.mujoco.trials import settle


def looked(urdf: Path) -> InspectedRobot:
    return look(find_source(urdf, {}))


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return commands.run(words, folder, os.environ | {"ASSETBUILD_CACHE": str(folder / "cache")})


# --- choices --------------------------------------------------------------------------------


def test_a_dog_floats_on_its_four_feet(robots: Path):
    anatomy = study(looked(robots / "four_legs.urdf"))
    assert anatomy.base == "floating"
    assert sorted(leg.foot for leg in anatomy.legs) == ["LF_foot", "LH_foot", "RF_foot", "RH_foot"]
    assert anatomy.sensors == {"IMU": ("imu_link",), "camera": ("head_camera",)}


def test_a_bolted_arm_is_fixed_and_its_fingers_are_no_legs(robots: Path):
    anatomy = study(looked(robots / "odd_arm.urdf"))
    assert (anatomy.base, anatomy.legs) == ("fixed", ())
    assert "`world`" in anatomy.base_reason


def test_the_home_pose_stands_within_the_limits_feet_level_below_the_hips(robots: Path):
    robot = looked(robots / "four_legs.urdf")
    anatomy = study(robot)
    pose = home_pose(robot.tree, anatomy.legs)
    for joint in robot.tree.moving_joints:
        assert joint.limits.lower <= pose[joint.name] <= joint.limits.upper  # type: ignore[operator]
    X = forward_kinematics(robot.links, pose)
    heights = [X[leg.foot].xyz[2] for leg in anatomy.legs]
    assert max(heights) - min(heights) < 1e-3
    for leg in anatomy.legs:
        assert X[leg.foot].xyz[0] == pytest.approx(X[leg.foot[:2] + "_thigh"].xyz[0], abs=5e-3)
    # two links of 0.2 m with the knee bent by q: the hip is 0.4 cos(q / 2) above the foot
    knee = pose["LF_calf_joint"]
    assert -heights[0] == pytest.approx(0.4 * math.cos(knee / 2), abs=2e-3)


def test_the_table_has_a_row_per_limit_and_a_guess_where_effort_is_missing(
    robots: Path, tmp_path: Path
):
    dog = proposed(robots / "four_legs.urdf", tmp_path).recipe
    assert [row.joints for row in dog.actuators] == [".*_(hip|thigh)_joint", ".*_calf_joint"]
    assert dog.actuators[1].kp == pytest.approx(36 / 0.3, rel=0.05)
    arm = proposed(robots / "odd_arm.urdf", tmp_path).recipe
    models = {row.joints: row.model for row in arm.actuators}
    assert models == {
        "shoulder": "pd", "elbow": "pd", "wrist": "pd", "left_slide": "pd",
        "hinge": "passive",  # locked by equal limits
    }  # fmt: skip
    assert [row.joints for row in arm.actuators if row.guessed] == ["wrist"]
    assert arm.keyframes["home"].joints == {"elbow": 1.5}


# --- files ----------------------------------------------------------------------------------


def test_the_source_is_relative_to_the_recipe_wherever_one_stands(
    robots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    shutil.copy(robots / "four_legs.urdf", tmp_path / "dog.urdf")
    (tmp_path / "recipes").mkdir()
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    recipe = proposed(Path("../dog.urdf"), Path("../recipes")).recipe
    assert (recipe.source.path, recipe.source.urdf) == ("..", "dog.urdf")


ROD = re.sub(r"(\S+) (\S+) (\S+)", r"0.\1 \2 0.\3", CUBE)
"""Two bars, 1 m long along y; the middle of both is at x = 8.5 m."""


@pytest.mark.parametrize("height", [0.5, None], ids=["mass up z", "mass up y"])
def test_meshes_are_turned_where_the_mass_says_so(tmp_path: Path, height: float | None):
    (tmp_path / "rod.dae").write_bytes(dae(ROD, unit="1", up="Y_UP"))
    solid = urdfs.inertial(xyz=f"8.5 0 {height}" if height else "8.5 0.5 0")
    rod = urdfs.link("rod", solid, urdfs.shape("visual", urdfs.mesh("rod.dae")))
    source = proposed(urdfs.robot(rod), tmp_path).recipe.source
    assert source.honour_up_axis == ((".*",) if height else ())


def test_the_schema_that_the_first_line_names_lies_beside_the_recipe(robots: Path, tmp_path: Path):
    proposal = propose(robots / "four_legs.urdf", tmp_path / "mine.yaml", {})
    named = proposal.text.splitlines()[0].rpartition("$schema=")[2]
    schema = tmp_path / named
    assert schema.name == SCHEMA_FILE
    write_schema(schema)
    assert json.loads(schema.read_text())["title"] == "assetbuild recipe"
    schema.write_text(schema.read_text().replace("robot", "zzz"))
    write_schema(schema)
    assert "zzz" not in schema.read_text(), "an older schema of ours is renewed"
    schema.write_text("{}")
    write_schema(schema)
    assert schema.read_text() == "{}", "a file of somebody else is left alone"


# --- the whole way --------------------------------------------------------------------------


@pytest.mark.slow  # a whole build, pictures and all
def test_the_dog_checks_builds_and_stands(robots: Path, tmp_path: Path):
    shutil.copy(robots / "four_legs.urdf", tmp_path)
    assert run(tmp_path, "init", "four_legs.urdf").returncode == 0
    assert run(tmp_path, "init", "four_legs.urdf").returncode == 2
    checked = run(tmp_path, "check", "four_legs.yaml")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    built = run(tmp_path, "build", "four_legs.yaml")
    assert built.returncode == 0, built.stdout + built.stderr
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "build/four_legs/mjcf/four_legs.xml"))
    assert (model.nv, model.nu, model.nkey) == (18, 12, 1)
    scene = mujoco.MjModel.from_xml_path(str(tmp_path / "build/four_legs/mjcf/scene.xml"))
    assert settle(scene, 0.05)["drift_m"] < 1e-3
    scene.opt.timestep = STEP_S
    scene.dof_armature[:] = 0.0
    assert settle(scene, 0.05)["drift_m"] > 0.05, "the reason for the shorter step is gone"
