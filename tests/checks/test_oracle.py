"""Pinocchio on the source and MuJoCo on the MJCF agree on right robots and on no wrong one."""

from __future__ import annotations

from pathlib import Path

import pytest
from robot_files import check_inputs, checked, edit, figures, laid_out, ranked, rules, run_step
from tiny import TinyRobot, pendulum, tiny_quadruped
from urdfs import inertial, joint, link, read, robot, tensor

from assetbuild.body.merge_fixed_joints import MergeFixedJoints
from assetbuild.checks._pinocchio import Oracle
from assetbuild.checks.urdf_kinematics import UrdfKinematics
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Actuator, Base, Control, Tree
from assetbuild.robot.shapes import Shapes
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.urdf import Urdf

pytest.importorskip("pinocchio", reason="needs the extra `oracle`")

# By hand from placeholder_root.urdf without its 1e-6 kg `base`: the mass of `trunk` and `arm`.
BY_HAND = """
<mujoco>
  <worldbody>
    <body name="trunk">
      <freejoint/>
      <inertial pos="0.01 0 0.02" mass="3" diaginertia="0.03 0.04 0.05"/>
      <body name="arm" pos="0 0 0.5">
        <joint name="swing" axis="0 1 0" armature="0.3" damping="1" frictionloss="1"/>
        <inertial pos="0.1 0 -0.2" mass="1" diaginertia="0.02 0.02 0.001"/>
        <site name="tip" pos="0 0 -0.4"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def robot_folder(urdf: str | bytes, folder: Path, base: Base = "floating") -> Path:
    """links.json, tree.json and source.urdf of a description."""
    read(urdf, folder, base=base)
    run_step(MergeFixedJoints(), folder, folder)
    return folder


def by_hand(robots: Path, folder: Path, mjcf: str = BY_HAND) -> list[Finding]:
    text = (robots / "placeholder_root.urdf").read_text()
    first, last = text.index("<inertial>"), text.index("</inertial>") + len("</inertial>")
    robot_folder(text[:first] + text[last:], folder)
    (folder / "mjcf").mkdir()
    (folder / "mjcf/bot.xml").write_text(mjcf)
    return run_step(Oracle(robot="bot"), folder, folder)


def by_target(folder: Path) -> list[Finding]:
    """With our own MJCF target, geometry aside."""
    links, tree = (decode(Tree, (folder / f"{n}.json").read_bytes()) for n in ("links", "tree"))
    drives = tuple(
        Actuator(j.name, "pd", 50.0, 2.0, 0.1, 0.2, 0.01, 10.0, 10.0) for j in tree.moving_joints
    )
    laid_out(folder, TinyRobot(links, tree, Shapes(), Control(drives)))
    run_step(Mjcf(robot="bot"), folder, folder)
    return run_step(Oracle(robot="bot"), folder, folder)


def test_an_mjcf_written_by_hand_is_the_same_robot(robots: Path, tmp_path: Path):
    assert by_hand(robots, tmp_path) == []
    found = figures(tmp_path)
    assert max(found[f"{k}_error"] for k in ("kinematics", "mass_matrix", "gravity")) < 1e-12
    assert (found["nv"], found["mass_mjcf_kg"]) == (7, 4.0)


@pytest.mark.parametrize(
    ("found", "old", "new"),
    [
        ({"oracle.mass_matrix", "oracle.gravity"}, 'mass="1"', 'mass="1.000001"'),
        ({"oracle.mass_matrix"}, "0.02 0.02 0.001", "0.02 0.02000001 0.001"),
        (
            {"oracle.kinematics", "oracle.mass_matrix", "oracle.gravity"},
            'axis="0 1 0"',
            'axis="0 -1 0"',
        ),
        ({"oracle.kinematics", "oracle.mass_matrix"}, 'pos="0 0 0.5"', 'pos="0 0 0.500001"'),
        ({"oracle.mass_matrix"}, 'mass="3"', 'mass="3.000001"'),
        ({"oracle.kinematics"}, 'pos="0 0 -0.4"', 'pos="0 0 -0.400001"'),
        ({"oracle.structure"}, 'name="swing"', 'name="swung"'),
        ({"oracle.structure"}, 'name="arm"', 'name="army"'),
        ({"oracle.structure"}, "<freejoint/>", ""),
        ({"oracle.load"}, "</mujoco>", ""),
    ],
)
def test_a_wrong_mjcf_is_found_out(
    found: set[str], old: str, new: str, robots: Path, tmp_path: Path
):
    assert old in BY_HAND
    findings = by_hand(robots, tmp_path, BY_HAND.replace(old, new))
    assert set(ranked(findings)) == {(rule, "error") for rule in found}


@pytest.mark.parametrize("name", ["placeholder_root", "every_kind"])
@pytest.mark.parametrize("base", ["floating", "fixed"])
def test_our_own_target_writes_the_source(name: str, base: Base, robots: Path, tmp_path: Path):
    folder = robot_folder(_mass_everywhere((robots / f"{name}.urdf").read_text()), tmp_path, base)
    assert by_target(folder) == []


def _mass_everywhere(text: str) -> str:
    """MuJoCo wants mass on every moving body; `thumb` has none and is one."""
    tensor = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    inertial = f'<inertial><mass value="0.3"/>{tensor}</inertial>'
    return text.replace('<link name="thumb"/>', f'<link name="thumb">{inertial}</link>')


HEAVY = inertial(2.0, tensor(0.02, 0.02, 0.01), "0.1 0 0.2")
SPECK = inertial(1e-12, tensor(1e-14, 1e-14, 1e-14))
"""An armature of 0.01 kg m² is 1e12 times what the link itself has."""


def on_the_wall(*more: str, kind: str = "revolute", arm: str = HEAVY) -> str:
    hinge = joint("hinge", "plate", "arm", kind, '<limit lower="-1" upper="1"/>', xyz="0 0 0.1")
    return robot('<link name="plate"/>', link("arm", arm), hinge, *more)


HARDLY_TURNED = """<link name="eye"/><joint name="eye_mount" type="fixed"><parent link="plate"/>
  <child link="eye"/><origin xyz="0 0.4 0" rpy="1e-7 0 0"/></joint>"""


@pytest.mark.parametrize(
    "text",
    [on_the_wall(HARDLY_TURNED), on_the_wall(arm=SPECK), on_the_wall(kind="prismatic", arm=SPECK)],
    ids=["a frame hardly turned", "a speck that turns", "a speck that slides"],
)
def test_small_numbers_and_limits_without_effort_are_compared(text: str, tmp_path: Path):
    """Many an MJCF's URDF states no effort; urdfdom refuses such a file."""
    folder = robot_folder(text, tmp_path, "fixed")
    assert by_target(folder) == []
    assert figures(folder)["nv"] == 1


def test_what_cannot_be_compared_is_told(robots: Path, tmp_path: Path):
    planar = robot_folder(on_the_wall(kind="planar"), tmp_path / "a", "fixed")
    assert ranked(run_step(Oracle(robot="bot"), planar, planar)) == [("oracle.unsupported", "info")]
    folder = robot_folder((robots / "placeholder_root.urdf").read_bytes(), tmp_path / "b")
    (folder / "source.urdf").write_text("<robot/>")
    broken = run_step(Oracle(robot="bot"), folder, folder)
    assert ranked(broken) == [("oracle.unreadable", "warning")]


def test_an_mjcf_that_hangs_elsewhere_is_another_robot_unless_the_urdf_says_so(tmp_path: Path):
    folder = robot_folder(on_the_wall(), tmp_path, "fixed")
    assert by_target(folder) == []
    plate = '<body name="plate"'
    edit(folder / "mjcf/bot.xml", (plate, f'{plate} pos="0 0.4 1" quat="1 1 0 0"'))
    found = run_step(Oracle(robot="bot"), folder, folder)
    assert {"oracle.kinematics", "oracle.gravity"} <= rules(found)
    world = """<link name="world"/><joint name="hang" type="fixed"><parent link="world"/>
      <child link="plate"/><origin xyz="0 0.4 1" rpy="1.5707963267948966 0 0"/></joint>"""
    edit(folder / "source.urdf", ("</robot>", f"{world}</robot>"))
    assert run_step(Oracle(robot="bot"), folder, folder) == []


# --- yourdfpy on the written URDF ----------------------------------------------------------------


@pytest.mark.parametrize("bot", [tiny_quadruped(), pendulum()])
def test_what_we_write_moves_as_the_robot(bot: TinyRobot, tmp_path: Path):
    inputs = check_inputs(tmp_path, bot, Urdf(robot="bot"), "urdf")
    findings, measured = checked(UrdfKinematics(robot="bot"), inputs, tmp_path / "out")
    assert findings == []
    assert measured["links"] == len(bot.links.bodies)
    assert measured["kinematics_error"] < 1e-12


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("unreadable", '<mass value="6.0" />', '<mass value="six" />'),
        ("unreadable", 'link name="imu"', 'link name="imv"'),
        ("place", '<axis xyz="1.0 0.0 0.0" />', '<axis xyz="-1.0 0.0 0.0" />'),
        ("place", '<origin xyz="0.18 -0.05 0.0"', '<origin xyz="0.1800001 -0.05 0.0"'),
    ],
)
def test_a_wrong_file_is_found_out(rule: str, old: str, new: str, tmp_path: Path):
    inputs = check_inputs(tmp_path, tiny_quadruped(), Urdf(robot="bot"), "urdf")
    edit(inputs / "urdf/bot.urdf", (old, new))
    findings = run_step(UrdfKinematics(robot="bot"), inputs, tmp_path / "out")
    assert set(ranked(findings)) == {(f"urdf.kinematics.{rule}", "error")}
