"""Pinocchio on the source and MuJoCo on the MJCF agree on right robots and on no wrong one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny import run_step

from assetbuild.body.merge_fixed_joints import MergeFixedJoints
from assetbuild.checks.oracle import Oracle
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.robot.shapes import MeshFile, Shape, Shapes, SourceShapes
from assetbuild.source.urdf.read_urdf import ReadUrdf
from assetbuild.targets.mjcf import Mjcf

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
        <inertial pos="0 0 -0.2" mass="1" diaginertia="0.02 0.02 0.001"/>
        <site name="tip" pos="0 0 -0.4"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def robot_folder(urdf: str | bytes, folder: Path, base: str = "floating") -> Path:
    """links.json, tree.json and source.urdf of a description."""
    folder.mkdir(parents=True, exist_ok=True)
    data = urdf.encode() if isinstance(urdf, str) else urdf
    for name in ("robot.urdf", "source.urdf"):
        (folder / name).write_bytes(data)
    packages = {"example-robot-data": ".", "robot_pkg": "."}
    run_step(ReadUrdf(file="a/b/c.urdf", base=base, packages=packages), folder, folder)  # type: ignore[arg-type] # a literal
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
    tree = decode(Tree, (folder / "tree.json").read_bytes())
    shapes = decode(SourceShapes, (folder / "shapes.json").read_bytes())
    simple = tuple(s for s in shapes.shapes if not isinstance(s.geometry, MeshFile))
    (folder / "shapes.json").write_bytes(
        encode(Shapes(tuple(Shape(**vars(s)) for s in simple), shapes.materials))
    )
    drives = tuple(
        Actuator(j.name, "pd", 50.0, 2.0, 0.1, 0.2, 0.01, 10.0, 10.0) for j in tree.moving_joints
    )
    (folder / "control.json").write_bytes(encode(Control(drives)))
    (folder / "meshes").mkdir()
    run_step(Mjcf(robot="bot"), folder, folder)
    return run_step(Oracle(robot="bot"), folder, folder)


def figures(folder: Path) -> dict[str, float]:
    found: dict[str, float] = json.loads((folder / "figures.json").read_text())
    return found


def test_an_mjcf_written_by_hand_is_the_same_robot(robots: Path, tmp_path: Path):
    assert by_hand(robots, tmp_path) == []
    found = figures(tmp_path)
    assert max(found[f"{k}_error"] for k in ("kinematics", "mass_matrix", "gravity")) < 1e-12
    assert (found["nv"], found["mass_mjcf_kg"]) == (7, 4.0)


@pytest.mark.parametrize(
    ("rules", "old", "new"),
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
        ({"oracle.mass_matrix"}, "0.03 0.04 0.05", "0.03 0.04 0.05000001"),
        ({"oracle.kinematics"}, 'pos="0 0 -0.4"', 'pos="0 0 -0.400001"'),
        ({"oracle.structure"}, 'name="swing"', 'name="swung"'),
        ({"oracle.structure"}, 'name="arm"', 'name="army"'),
        ({"oracle.structure"}, "<freejoint/>", ""),
        ({"oracle.load"}, "</mujoco>", ""),
    ],
)
def test_a_wrong_mjcf_is_found_out(
    rules: set[str], old: str, new: str, robots: Path, tmp_path: Path
):
    assert old in BY_HAND
    findings = by_hand(robots, tmp_path, BY_HAND.replace(old, new))
    assert {f.rule for f in findings} == rules
    assert {f.severity for f in findings} == {"error"}


@pytest.mark.parametrize("name", ["placeholder_root", "every_kind"])
@pytest.mark.parametrize("base", ["floating", "fixed"])
def test_our_own_target_writes_the_source(name: str, base: str, robots: Path, tmp_path: Path):
    folder = robot_folder(_mass_everywhere((robots / f"{name}.urdf").read_text()), tmp_path, base)
    assert by_target(folder) == []


def _mass_everywhere(text: str) -> str:
    """MuJoCo wants mass on every moving body; `thumb` has none and is one."""
    tensor = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    inertial = f'<inertial><mass value="0.3"/>{tensor}</inertial>'
    return text.replace('<link name="thumb"/>', f'<link name="thumb">{inertial}</link>')


def test_a_joint_that_cannot_be_compared_is_told(tmp_path: Path):
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="planar">'
        '<parent link="a"/><child link="b"/></joint></robot>'
    )
    folder = robot_folder(text, tmp_path, "fixed")
    (finding,) = run_step(Oracle(robot="bot"), folder, folder)
    assert (finding.rule, finding.severity) == ("oracle.unsupported", "info")


def test_a_source_that_pinocchio_refuses_is_told(robots: Path, tmp_path: Path):
    folder = robot_folder((robots / "placeholder_root.urdf").read_bytes(), tmp_path)
    (folder / "source.urdf").write_text("<robot/>")
    (finding,) = run_step(Oracle(robot="bot"), folder, folder)
    assert (finding.rule, finding.severity) == ("oracle.unreadable", "warning")


ON_THE_WALL = """<robot name="r">
  <link name="plate"/>
  <link name="arm"><inertial><origin xyz="0.1 0 0.2"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="plate"/><child link="arm"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
</robot>"""


def test_a_limit_that_states_no_effort_keeps_nothing_from_being_compared(tmp_path: Path):
    """As in the URDF of many an MJCF; urdfdom refuses such a file."""
    folder = robot_folder(ON_THE_WALL, tmp_path, "fixed")
    assert by_target(folder) == []
    assert figures(folder)["nv"] == 1


def test_a_frame_that_is_hardly_turned_is_compared_as_it_is_stated(tmp_path: Path):
    nearly = """<link name="eye"/><joint name="eye_mount" type="fixed"><parent link="plate"/>
      <child link="eye"/><origin xyz="0 0.4 0" rpy="1e-7 0 0"/></joint></robot>"""
    folder = robot_folder(ON_THE_WALL.replace("</robot>", nearly), tmp_path, "fixed")
    assert by_target(folder) == []


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_speck_behind_a_large_rotor_is_compared_to_its_last_digit(kind: str, tmp_path: Path):
    """Armature of 0.2 kg m² is 1e12 times what the link itself has."""
    hinge = ON_THE_WALL.replace("revolute", kind).replace('xyz="0.1 0 0.2"', 'xyz="0 0 0"')
    speck = hinge.replace('value="2"', 'value="1e-12"').replace('"0.02"', '"1e-14"')
    folder = robot_folder(speck.replace('"0.01"', '"1e-14"'), tmp_path, "fixed")
    assert by_target(folder) == []


def test_an_mjcf_that_hangs_elsewhere_is_another_robot_unless_the_urdf_says_so(tmp_path: Path):
    folder = robot_folder(ON_THE_WALL, tmp_path, "fixed")
    assert by_target(folder) == []
    xml = folder / "mjcf/bot.xml"
    text = xml.read_text()
    hung = text.replace('<body name="plate"', '<body name="plate" pos="0 0.4 1" quat="1 1 0 0"', 1)
    assert hung != text
    xml.write_text(hung)
    found = run_step(Oracle(robot="bot"), folder, folder)
    assert {"oracle.kinematics", "oracle.gravity"} <= {f.rule for f in found}
    world = """<link name="world"/><joint name="hang" type="fixed"><parent link="world"/>
      <child link="plate"/><origin xyz="0 0.4 1" rpy="1.5707963267948966 0 0"/></joint>"""
    source = (folder / "source.urdf").read_text()
    (folder / "source.urdf").write_text(source.replace("</robot>", world + "</robot>"))
    assert run_step(Oracle(robot="bot"), folder, folder) == []
