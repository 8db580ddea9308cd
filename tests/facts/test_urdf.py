"""The reader of facts of a URDF finds every planted fault, and none in what we write."""

from __future__ import annotations

import io
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from mutants import is_found, xml_elements, xml_values
from PIL import Image
from tiny import (
    TinyRobot,
    box_obj,
    examples,
    pendulum,
    robots,
    run_step,
    stl,
    tiny_quadruped,
    with_mimic,
    write_robot_ports,
)

from assetbuild.errors import UsageError
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets
from assetbuild.robot.model import Limits
from assetbuild.robot.pose import Pose, normalised_quat
from assetbuild.robot.shapes import Capsule, Material, Mesh, Shape, Shapes
from assetbuild.targets.urdf import Urdf

ROBOTS = Path(__file__).parents[1] / "robots"
TURNED = Pose((0.1, -0.2, 0.3), normalised_quat((0.5, 0.1, -0.7, 0.2)))


def written(robot: TinyRobot, folder: Path) -> Path:
    """The ports of a robot, with its URDF below `urdf/`."""
    ports = write_robot_ports(folder, robot)
    (ports / "control.json").unlink()
    run_step(MeasureAssets(), ports, ports)
    run_step(Urdf(robot="bot"), ports, ports)
    return ports


def proved(ports: Path) -> list[Finding]:
    """What the reader says of it."""
    found = run_step(UrdfFacts(robot="bot"), ports, ports.parent / "out")
    return [finding for finding in found if finding.rule != "lost.urdf"]


def edited(robot: TinyRobot, folder: Path, *edits: tuple[str, str], file: str = "bot.urdf") -> Path:
    """The same with the first of each text replaced in one file."""
    ports = written(robot, folder)
    path = ports / "urdf" / file
    text = path.read_text()
    for old, new in edits:
        assert old in text, text
        text = text.replace(old, new, 1)
    path.write_text(text)
    return ports


# --- robots -------------------------------------------------------------------------------------


def follower() -> TinyRobot:
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", -1.0, 0.1)
    joints = tuple(robot.tree.by_joint.get(j.name, j) for j in robot.links.joints)
    return replace(robot, links=replace(robot.links, joints=joints))


def slider(limits: Limits = Limits(-0.5, 0.5, 5.0, 10.0)) -> TinyRobot:  # noqa: B008 # frozen
    robot = pendulum()
    joint = replace(robot.tree.joints[0], kind="prismatic", limits=limits, X_parent_joint=TURNED)
    tree = replace(robot.tree, joints=(joint,))
    return replace(robot, tree=tree, links=tree)


def hung() -> TinyRobot:
    robot = pendulum()
    tree = replace(robot.tree, X_world_root=TURNED)
    return replace(robot, tree=tree, links=tree)


def spinning() -> TinyRobot:
    """Without limits, and stopped by nothing."""
    robot = slider()
    joint = replace(robot.tree.joints[0], kind="continuous", limits=Limits(), damping=None)
    tree = replace(robot.tree, joints=(joint,))
    return replace(robot, tree=tree, links=tree)


def picture(colour: str) -> bytes:
    held = io.BytesIO()
    Image.new("RGB", (2, 2), colour).save(held, "PNG")
    return held.getvalue()


def textured() -> TinyRobot:
    """One mesh that is seen with two textures, a ball without length, a material nobody wears."""
    robot = tiny_quadruped()
    lines = box_obj((0.4, 0.2, 0.1)).decode().splitlines()
    corners = [line for line in lines if line.startswith("v")]
    faces = [
        " ".join(f"{n}/{n}/{n}" if n != "f" else n for n in line.split()) for line in lines[8:]
    ]
    uv = [f"vt {n / 8!r} {n / 16!r}" for n in range(8)]
    normals = [f"vn {n / 8!r} 0.6 -0.8" for n in range(8)]
    mesh = "\n".join([*corners, *uv, *normals, *faces, ""]).encode()
    shapes = Shapes(
        (
            Shape("a", "trunk", "visual", Mesh("trunk_box"), material="wood"),
            Shape("b", "imu", "visual", Mesh("trunk_box"), TURNED, "stone"),
            Shape("c", "trunk", "collision", Mesh("trunk_box"), TURNED),
            Shape("ball", "FR_foot", "visual", Capsule(0.1, 0.0), TURNED, "plain"),
            Shape("bare", "FR_hip", "visual", Capsule(0.1, 0.2), TURNED),
        ),
        (
            Material("wood", (1.0, 0.9, 0.8, 1.0), "wood.png"),
            Material("stone", (1.0, 1.0, 1.0, 0.5), "stone.png"),
            Material("plain", (0.1, 0.2, 0.3, 1.0)),
            Material("unworn", (0.3, 0.2, 0.1, 1.0), "wood.png"),
        ),
        robot.shapes.meshes,
    )
    pictures = {"wood.png": picture("brown"), "stone.png": picture("grey")}
    return replace(robot, shapes=shapes, meshes={"trunk_box.obj": mesh, **pictures})


# --- what we write ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "robot",
    [tiny_quadruped(), pendulum(), follower(), slider(), slider(Limits()), spinning(), hung(),
     textured()],
    ids=["quadruped", "pendulum", "mimic", "prismatic", "prismatic without limits", "continuous",
         "held away from the origin", "textures"],
)  # fmt: skip
def test_what_we_write_is_the_robot(robot: TinyRobot, tmp_path: Path):
    assert proved(written(robot, tmp_path / "in")) == []
    assert '"facts": 0' not in (tmp_path / "out/figures.json").read_text()


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(robot=robots())
def test_any_robot_reads_back(robot: TinyRobot, tmp_path_factory: pytest.TempPathFactory):
    tree = replace(robot.links, frames=())
    folder = tmp_path_factory.mktemp("any")
    assert proved(written(replace(robot, links=tree, tree=tree), folder / "in")) == []


def test_a_source_s_effort_stays_where_the_drive_has_no_limit(tmp_path: Path):
    robot = pendulum()
    free = replace(robot.control.actuators[0], effort=None, velocity=None)
    robot = replace(robot, control=replace(robot.control, actuators=(free,)))
    ports = written(robot, tmp_path / "in")
    assert 'effort="5.0" velocity="10.0"' in (ports / "urdf/bot.urdf").read_text()
    assert proved(ports) == []


def test_a_picture_that_nothing_can_read_is_the_same_picture(tmp_path: Path):
    robot = textured()
    robot = replace(robot, meshes={**robot.meshes, "stone.png": b"no picture"})
    ports = written(robot, tmp_path / "in")
    assert proved(ports) == []
    (ports / "urdf/meshes/stone.png").write_bytes(picture("grey"))
    assert "equal.urdf.texture" in {f.rule for f in proved(ports)}


def test_comments_order_and_spelling_say_nothing(tmp_path: Path):
    edits = (
        ("<robot", "<!-- a remark --><robot"),
        ('value="6.0"', 'value=" 6 "'),
        ('<axis xyz="1.0 0.0 0.0"', '<axis xyz="1 0  0"'),
        ('lower="-0.86" upper="0.86"', 'upper="0.86" lower="-0.86"'),
    )
    assert proved(edited(tiny_quadruped(), tmp_path / "in", *edits)) == []


# --- planted faults -----------------------------------------------------------------------------

QUADRUPED_FAULTS = {
    "mass": ("body trunk", "mass", '<mass value="6.0"', '<mass value="6.06"'),
    "centre of mass": ("body FR_hip", "centre_of_mass", 'xyz="0.0 -0.005 0.0"', 'xyz="0 0 0"'),
    "inertia swapped": ("body trunk", "inertia", 'ixx="0.025', 'ixx="0.085'),
    "inertia turned": ("body FR_thigh", "inertia", '-0.1" rpy="0.0', '-0.1" rpy="0.5'),
    "place": ("body FR_hip", "pose", 'xyz="0.18 -0.05 0.0"', 'xyz="0.182 -0.05 0.0"'),
    "axis": ("joint FR_hip_joint", "axis", '<axis xyz="1.0', '<axis xyz="-1.0'),
    "length of axis": ("joint FR_hip_joint", "axis_length", '<axis xyz="1.0', '<axis xyz="2.0'),
    "lower": ("joint FR_hip_joint", "lower", 'lower="-0.86"', 'lower="-0.87"'),
    "limit left out": ("joint FR_hip_joint", "lower", 'lower="-0.86"', ""),
    "effort": ("joint FR_hip_joint", "effort", 'effort="24.0"', 'effort="2.0"'),
    "velocity": ("joint FR_hip_joint", "velocity", 'velocity="30.0"', 'velocity="31.0"'),
    "damping": ("joint FR_hip_joint", "damping", 'damping="0.1"', 'damping="0.101"'),
    "friction": ("joint FR_hip_joint", "friction", 'friction="0.2"', ""),
    "kind": ("joint FR_hip_joint", "type", 'type="revolute"', 'type="continuous"'),
    "link": ("body imv", "link", 'link name="imu"', 'link name="imv"'),
    "second link": ("body imu (again)", "link", "</robot>", '<link name="imu"/></robot>'),
    "parent": ("body FR_hip", "parent", 'parent link="trunk"', 'parent link="imu"'),
    "radius": ("shape FR_thigh_collision", "size", 'radius="0.015"', 'radius="0.016"'),
    "end of a capsule": ("shape FR_thigh_collision_top", "missing", "collision_top", "collision"),
    "role": ("shape trunk_visual", "role", "<visual", "<collision"),
    "colour": ("shape trunk_visual", "rgba", 'rgba="0.4', 'rgba="0.5'),
    "material": ("shape trunk_visual", "material", '<material name="grey" />', ""),
    "scale": ("shape trunk_visual", "area", ".obj", '.obj" scale="1.01 1 1'),
    "mirror image": ("shape trunk_visual", "volume", ".obj", '.obj" scale="0.5 1 -1'),
    "mesh moved": ("shape trunk_visual", "mean_corner", "<geometry>",
                   '<origin xyz="0 0 0.03"/><geometry>'),
    "mesh lost": ("shape trunk_visual", "missing_mesh", "trunk_box.obj", "lost.obj"),
    "mesh elsewhere": ("shape trunk_visual", "missing_mesh", "meshes/trunk", "package://a/trunk"),
    "axis of a fixed joint": ("joint imu_joint", "axis", 'link="imu" />',
                              'link="imu" /><axis xyz="0 0 1"/>'),
    "name": ("robot", "name", '<robot name="', '<robot name="my_'),
}  # fmt: skip


@pytest.mark.parametrize("fault", QUADRUPED_FAULTS)
def test_a_fault_is_named_with_subject_and_quantity(fault: str, tmp_path: Path):
    subject, quantity, old, new = QUADRUPED_FAULTS[fault]
    edits = ((old, new),)
    if fault == "role":
        edits = (*edits, ("</visual>", "</collision>"))
    findings = proved(edited(tiny_quadruped(), tmp_path / "in", *edits))
    assert (f"equal.urdf.{quantity}", subject) in {(f.rule, f.subject) for f in findings}
    assert {f.severity for f in findings} == {"error"}


def test_both_values_and_the_line_are_told(tmp_path: Path):
    (found,) = proved(edited(tiny_quadruped(), tmp_path / "in", ('effort="24.0"', 'effort="2"')))
    assert found.message == "effort is 2 in the URDF, 24 in the robot"
    assert found.data == {"expected": 24.0, "found": 2.0}
    assert found.where.startswith("bot.urdf:")


def test_a_shape_without_its_name_is_found(tmp_path: Path):
    """Its place among the others says which one it is."""
    edit = ('<collision name="trunk_collision">', "<collision>")
    (found,) = proved(edited(tiny_quadruped(), tmp_path / "in", edit))
    assert (found.rule, found.subject) == ("equal.urdf.name", "shape trunk_collision")
    assert found.data == {"expected": "trunk_collision", "found": None}


def test_a_tensor_that_is_turned_is_found(tmp_path: Path):
    """Also that of a ball, which is the same from all sides."""
    edit = ('"0.0 -0.005 0.0" rpy="0.0 0.0 0.0"', '"0.0 -0.005 0.0" rpy="1 0 0"')
    findings = proved(edited(tiny_quadruped(), tmp_path / "in", edit))
    assert "equal.urdf.inertial_axes" in {f.rule for f in findings}


def test_a_mimic_joint_is_compared_with_its_coefficients(tmp_path: Path):
    faults = {
        "mimic_multiplier": ('multiplier="-1.0"', 'multiplier="-3"'),
        "mimic_offset": ('offset="0.1"', ""),
        "mimics": ('mimic joint="FR_hip_joint"', 'mimic joint="RR_hip_joint"'),
    }
    for quantity, edit in faults.items():
        (found,) = proved(edited(follower(), tmp_path / quantity / "in", edit))
        assert (found.rule, found.subject) == (f"equal.urdf.{quantity}", "joint FL_hip_joint")


def test_a_root_that_moved_in_the_world_is_found(tmp_path: Path):
    (found,) = proved(edited(hung(), tmp_path / "in", ('xyz="0.1 -0.2', 'xyz="0.1 0.2')))
    assert (found.rule, found.subject) == ("equal.urdf.pose", "body base")


@pytest.mark.parametrize(
    ("file", "subject", "quantity", "old", "new"),
    [
        ("meshes/trunk_box.mtl", "shape a", "mesh_colour", "Kd 1.0 0.9", "Kd 1.0 0.1"),
        ("meshes/trunk_box_2.mtl", "shape b", "mesh_opacity", "d 0.5", "d 1.0"),
        ("meshes/trunk_box.mtl", "shape a", "mesh_texture", "wood.png", "stone.png"),
        ("meshes/trunk_box.mtl", "meshes/trunk_box.mtl:4", "equal.unread", "map_K", "Ns 5\nmap_K"),
        ("meshes/trunk_box_2.obj", "shape b", "texture_corners", "vt 0.125", "vt 0.25"),
        ("meshes/trunk_box.obj", "shape a", "normals", "vn 0.125", "vn 0.25"),
        ("meshes/trunk_box.obj", "shape a", "mean_corner", "v -0.2", "v -0.21"),
        ("meshes/trunk_box.obj", "meshes/trunk_box.obj", "equal.unread", "vt 0.0", "l 1 2\nvt 0.0"),
        ("bot.urdf", "shape a", "texture", "meshes/wood.png", "meshes/stone.png"),
        ("bot.urdf", "material unworn", "rgba", 'rgba="0.3', 'rgba="0.4'),
    ],
)  # fmt: skip
def test_textures_and_their_libraries_are_compared(
    file: str, subject: str, quantity: str, old: str, new: str, tmp_path: Path
):
    findings = proved(edited(textured(), tmp_path / "in", (old, new), file=file))
    rule = quantity if quantity.startswith("equal") else f"equal.urdf.{quantity}"
    told = {(f.rule, f.subject) for f in findings}
    others = {(f.rule, s) for f in findings for s in f.data.get("subjects", ())}  # type: ignore[union-attr] # a tuple
    assert (rule, subject) in told | others


def test_other_pixels_are_another_texture(tmp_path: Path):
    ports = written(textured(), tmp_path / "in")
    (ports / "urdf/meshes/wood.png").write_bytes(picture("red"))
    assert {f.rule for f in proved(ports)} == {"equal.urdf.texture", "equal.urdf.mesh_texture"}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<mass value", '<mass unit="lb" value', "`unit` of <mass>"),
        ("</inertial>", "<spring/></inertial>", "<spring>"),
        ("</inertial>", "</inertial><inertial><mass value='1'/></inertial>", "<inertial>"),
        ("</robot>", '<transmission name="a"/></robot>', "<transmission>"),
        ("<geometry>", "<geometry>5", "text in <geometry>"),
        ('value="6.0"', 'value="six"', "`value` of <mass>"),
        ('rpy="0.0 0.0 0.0"', 'rpy="0.0 0.0"', "`rpy` of <origin>"),
        ('lower="-0.86"', 'lower="-0_86"', "`lower` of <limit>"),
    ],
)
def test_what_has_no_known_meaning_is_reported(old: str, new: str, told: str, tmp_path: Path):
    found = proved(edited(tiny_quadruped(), tmp_path / "in", (old, new)))
    (unread,) = (f for f in found if f.rule == "equal.unread")
    assert unread.data["attribute"] == told
    assert unread.subject.startswith("bot.urdf:")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</robot>", "", "not readable as XML"),
        ("<robot", "<!DOCTYPE robot><robot", "a DOCTYPE is not allowed"),
    ],
)
def test_a_file_that_is_no_urdf_is_one_error(old: str, new: str, message: str, tmp_path: Path):
    (found,) = proved(edited(tiny_quadruped(), tmp_path / "in", (old, new)))
    assert found.rule == "equal.unreadable"
    assert message in found.message


def lopsided(robot: TinyRobot) -> TinyRobot:
    """Without any symmetry that makes a turned tensor the same."""
    tensor = (0.02, 0.025, 0.03, 0.001, 0.002, 0.003)
    bodies = tuple(
        replace(b, inertial=replace(b.inertial, inertia_com_kg_m2=tensor) if b.inertial else None)
        for b in robot.links.bodies
    )
    return replace(robot, links=replace(robot.links, bodies=bodies))


@pytest.mark.parametrize("robot", [follower(), hung(), slider(), textured()])
def test_any_single_change_is_found(robot: TinyRobot, tmp_path: Path):
    ports = written(lopsided(robot), tmp_path / "in")
    path = ports / "urdf/bot.urdf"
    data = path.read_bytes()
    reference, reader = Reference.of_ports(ports, {}), UrdfFacts(robot="bot")
    changes = [*xml_values(data), *xml_elements(data)]
    missed = []
    for what, text in random.Random(0).sample(changes, 40):
        path.write_bytes(text)
        if not is_found(reader.prove(reference, path)):
            missed.append(what)
    assert missed == []


# --- other people's -----------------------------------------------------------------------------


def test_any_urdf_becomes_a_table():
    found = UrdfFacts(robot="x").read(ROBOTS / "every_kind.urdf")
    shell = found.of("shape", "shell")
    assert shell["urdf:missing mesh"] == "package://robot_pkg/meshes/base.dae"
    assert found.of("shape", "base_collision_1")["geometry"] == "capsule"
    assert found.of("shape", "finger_visual")["rgba"] == (0.0, 1.0, 0.0, 1.0)
    assert found.of("joint", "spin") == {
        "type": "rotary", "urdf:type": "continuous", "body": "thumb", "parent": "hand",
        "axis": (0.0, 1.0, 0.0), "mimics": "slide", "mimic multiplier": -2.0, "mimic offset": 0.5,
    }  # fmt: skip
    assert {item.attribute for item in found.unread} == {
        "<safety_controller>", "<transmission>", "<gazebo>"
    }  # fmt: skip


def test_a_mesh_of_another_format_is_measured(tmp_path: Path):
    (tmp_path / "a.stl").write_bytes(stl(np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])))
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    shapes = "".join(
        f'<visual><geometry><mesh filename="{name}" scale="2 2 2"/></geometry></visual>'
        for name in ("a.stl", "broken.stl")
    )
    (tmp_path / "x.urdf").write_text(f'<robot name="x"><link name="l">{shapes}</link></robot>')
    found = UrdfFacts(robot="x").read(tmp_path / "x.urdf")
    assert found.of("shape", "l_visual")["area"] == pytest.approx((2.0,))
    assert "broken.stl" in str(found.of("shape", "l_visual_1")["urdf:unreadable mesh"])


def test_a_file_that_is_not_there_is_one_error(tmp_path: Path):
    with pytest.raises(UsageError, match="cannot read"):
        UrdfFacts(robot="x").read(tmp_path / "no.urdf")


# --- URDFs of others ------------------------------------------------------------------------------

ARM = (
    '<robot name="r" version="1.1"><link name="a"/><link name="b"/><joint name="j" type="fixed">'
    '<origin {origin}/><parent link="a"/><child link="b"/></joint></robot>'
)


def read_text(text: str, folder: Path) -> Table:
    path = folder / "r.urdf"
    path.write_text(text)
    return UrdfFacts(robot="r").read(path)


def test_a_quaternion_is_a_rotation_from_1_1_on(tmp_path: Path):
    quarter = 'xyz="1, 2, 3" quat_xyzw="0 0 2 2"'
    pose = read_text(ARM.format(origin=quarter), tmp_path).of("body", "b")["pose"]
    assert pose == pytest.approx((1, 2, 3, 0.5**0.5, 0, 0, 0.5**0.5))
    for other in ('rpy="0 0 0" quat_xyzw="0 0 2 2"', 'quat_xyzw="0 0 0 0"'):
        found = read_text(ARM.format(origin=other), tmp_path)
        assert found.of("body", "b")["pose"] == (0, 0, 0, 1, 0, 0, 0)
    old = read_text(ARM.format(origin=quarter).replace(' version="1.1"', ""), tmp_path)
    assert old.of("body", "b")["pose"] == (1, 2, 3, 1, 0, 0, 0)
    assert any("quat_xyzw" in unread.attribute for unread in old.unread)


def test_faults_of_the_text_are_unread_with_their_line(tmp_path: Path):
    text = "\n" + ARM.format(origin="").replace("<robot", '<?xml version="1.0"?><robot')
    found = read_text(text.replace("</robot>", "<drake:a/>\n</robot>\nmore"), tmp_path)
    assert set(found.names("body")) == {"a", "b"}
    said = [(unread.where, unread.attribute) for unread in found.unread]
    assert ("r.urdf:2", "untidy text (declaration)") in said
    assert ("r.urdf:2", "untidy text (prefix)") in said
    assert ("r.urdf:4", "untidy text (end)") in said
