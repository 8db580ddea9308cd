"""Untidy text that readers of URDF take alike is read like that, and each case says so."""

# ruff: noqa: E501 # one untidy file per line reads better than wrapped XML

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from urdfs import FILE, Reading, read, refused

from assetbuild.errors import SourceError
from assetbuild.robot.pose import rotation_of
from assetbuild.robot.shapes import MeshFile, Sphere

TENSOR = '<inertia ixx="0.01" ixy="0.001" ixz="0" iyy="0.02" iyz="0" izz="0.025"/>'
INERTIAL = f'<inertial><origin xyz="0.1 0 0"/><mass value="2"/>{TENSOR}</inertial>'
OTHER = '<inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
ORIGIN = '<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>'
LIMIT = '<limit lower="-1" upper="1" effort="9" velocity="5"/>'
AXIS = '<axis xyz="0 0 1"/>'
BOX = '<geometry><box size="0.1 0.2 0.3"/></geometry>'
QUARTER = 'quat_xyzw="0 0 0.7071067811865476 0.7071067811865476"'


def robot(
    link: str = INERTIAL, joint: str = ORIGIN + AXIS + LIMIT, *, kind: str = "revolute",
    attributes: str = 'name="r"', ends: str = '<parent link="base"/><child link="arm"/>', extra: str = "",
) -> str:  # fmt: skip
    """A base on line 2, an arm on line 3, the joint between them on line 4."""
    return (
        f'<robot {attributes}>\n<link name="base">{INERTIAL}</link>\n<link name="arm">{link}</link>\n'
        f'<joint name="j" type="{kind}">{ends}{joint}</joint>\n{extra}</robot>'
    )


def collision(geometry: str, role: str = "collision") -> str:
    return f"{INERTIAL}<{role}><geometry>{geometry}</geometry></{role}>"


def limit(words: str) -> str:
    return f'{ORIGIN}{AXIS}<limit lower="-1" upper="1" {words}/>'


def visual(look: str) -> str:
    return f"{INERTIAL}<visual>{BOX}{look}</visual>"


# --- what other readers make of the file ------------------------------------------------------


def by_pinocchio(text: bytes) -> tuple[float, np.ndarray]:
    """(mass of the arm in kg, (3, 4) pose of the joint in the base)."""
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(text.decode("latin-1"))
    place = model.jointPlacements[1]
    return model.inertias[1].mass, np.column_stack([place.rotation, place.translation])


def by_yourdfpy(text: bytes) -> tuple[float, np.ndarray]:
    import yourdfpy

    urdf = yourdfpy.URDF.load(io.BytesIO(text), load_meshes=False, build_scene_graph=False)
    return urdf.link_map["arm"].inertial.mass, urdf.joint_map["j"].origin[:3]


def by_mujoco(text: bytes) -> tuple[float, np.ndarray]:
    import mujoco

    opened = re.sub(
        r"(<robot[^>]*>)",
        r'\1<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>',
        text.decode("latin-1"),
        count=1,
    )
    model = mujoco.MjModel.from_xml_string(opened)
    arm = model.body("arm")
    return float(arm.mass[0]), np.column_stack([rotation_of(tuple(arm.quat)), arm.pos])


READERS = {"p": by_pinocchio, "y": by_yourdfpy, "m": by_mujoco}

# What stands in the file | line | rule | readers that take it, and so: pinocchio, yourdfpy, MuJoCo.
TAKEN = {
    "a collision box of size 0": (robot(collision('<box size="0 0 0"/>')), 3, "urdf.collision.nothing", "py"),
    "a collision sphere of radius 0": (robot(collision('<sphere radius="0.0"/>')), 3, "urdf.collision.nothing", "py"),
    "a collision cylinder of size 0": (robot(collision('<cylinder radius="0" length="0"/>')), 3, "urdf.collision.nothing", "py"),
    "a collision plate": (robot(collision('<box size="1 1 0"/>')), 3, "urdf.collision.nothing", "py"),
    "a collision disc": (robot(collision('<cylinder radius=".2" length="0"/>')), 3, "urdf.collision.nothing", "py"),
    "a visual line": (robot(collision('<box size="0 1 0"/>', "visual")), 3, "urdf.visual.nothing", "py"),
    "a visual plate": (robot(collision('<box size="1 1 0"/>', "visual")), 3, "urdf.visual.nothing", "py"),
    "a geometry without a shape": (robot(collision("")), 3, "urdf.collision.nothing", "p"),
    "a collision without a geometry": (robot(f"{INERTIAL}<collision/>"), 3, "urdf.collision.nothing", "p"),
    "a capsule of length 0": (robot(collision('<capsule radius="0.1" length="0"/>'), attributes='name="r" version="1.1"'), 3, "urdf.capsule.ball", "p"),
    "two shapes in a geometry": (robot(collision('<sphere radius="0.1"/><box size="1 1 1"/>')), 3, "urdf.repeated", "pym"),
    "two geometries": (robot(f'{INERTIAL}<collision><geometry><sphere radius="0.1"/></geometry>{BOX}</collision>'), 3, "urdf.repeated", "py"),
    "two inertials": (robot(INERTIAL + OTHER), 3, "urdf.repeated", "py"),
    "two masses": (robot(f'<inertial><mass value="2"/><mass value="3"/>{TENSOR}</inertial>'), 3, "urdf.repeated", "py"),
    "two materials": (robot(visual('<material name="a"><color rgba="1 0 0 1"/></material>\n<material name="b"/>')), 4, "urdf.repeated", "py"),
    "two origins": (robot(joint=f'{ORIGIN}\n<origin xyz="4 5 6"/>{AXIS}{LIMIT}'), 5, "urdf.repeated", "py"),
    "two limits": (robot(joint=f'{ORIGIN}{AXIS}{LIMIT}\n<limit effort="1" velocity="1"/>'), 5, "urdf.repeated", "py"),
    "two parents": (robot(ends='<parent link="base"/><parent link="arm"/><child link="arm"/>'), 4, "urdf.repeated", "py"),
    "one material twice": (robot(extra='<material name="a"><color rgba="1 0 0 1"/></material>\n<material name="a"><color rgba="1.  0 0 1"/></material>'), 6, "urdf.repeated", "ym"),
    "commas and blanks": (robot(joint='<origin xyz="1, 2, 3" rpy="0.1 0.2 0.3"/>' + AXIS + LIMIT), 4, "urdf.separators", ""),
    "commas alone": (robot(joint='<origin xyz="1,2,3" rpy="0.1 0.2 0.3"/>' + AXIS + LIMIT), 4, "urdf.separators", ""),
    "a comma at the end": (robot(joint='<origin xyz="1 2 3," rpy="0.1 0.2 0.3"/>' + AXIS + LIMIT), 4, "urdf.separators", ""),
    "a comma after a mass": (robot(INERTIAL.replace('"2"', '"2,"')), 3, "urdf.separators", ""),
    "a semicolon": (robot(joint=limit('effort="9;" velocity="5"')), 4, "urdf.separators", ""),
    "an empty rpy": (robot(joint='<origin xyz="1 2 3" rpy=""/>' + AXIS + LIMIT), 4, "urdf.empty_attribute", "m"),
    "an empty xyz": (robot(joint='<origin xyz=""/>' + AXIS + LIMIT), 4, "urdf.empty_attribute", "m"),
    "an empty effort": (robot(joint=limit('effort="" velocity="5"')), 4, "urdf.empty_attribute", "m"),
    "a negative effort": (robot(joint=limit('effort="-1" velocity="5"')), 4, "urdf.limit.none", "ym"),
    "an infinite velocity": (robot(joint=limit('effort="9" velocity="inf"')), 4, "urdf.limit.none", "ym"),
    "an infinite range": (robot(joint=ORIGIN + AXIS + '<limit lower="-inf" upper="inf" effort="9" velocity="5"/>'), 4, "urdf.limit.none", "ym"),
    "no mass": (robot(f"<inertial>{TENSOR}</inertial>"), 3, "urdf.inertial.incomplete", ""),
    "an empty inertial": (robot("<inertial/>"), 3, "urdf.inertial.incomplete", ""),
    "a mass without value": (robot(f'<inertial><mass value=""/>{TENSOR}</inertial>'), 3, "urdf.inertial.incomplete", ""),
    "no tensor": (robot('<inertial><mass value="2"/></inertial>'), 3, "urdf.inertial.incomplete", "py"),
    "no moments": (robot('<inertial><mass value="2"/><inertia ixy="1"/></inertial>'), 3, "urdf.inertial.incomplete", "py"),
    "no products": (robot('<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'), 3, "urdf.inertial.incomplete", "py"),
    "a scale of one number": (robot(collision('<mesh filename="a.stl" scale="0.001"/>')), 3, "urdf.mesh.scale", "y"),
    "a scale of four equal numbers": (robot(collision('<mesh filename="a.stl" scale="2 2 2 2"/>')), 3, "urdf.mesh.scale", "y"),
    "a colour of three numbers": (robot(visual('<material name="a"><color rgba="1 0 0"/></material>')), 3, "urdf.material.colour", "p"),
    "a colour of five numbers": (robot(visual('<material name="a"><color rgba="1 0 0 1 1"/></material>')), 3, "urdf.material.colour", "p"),
    "a colour by name": (robot(visual('<material name="a"><color rgba="red"/></material>')), 3, "urdf.material.colour", "p"),
    "no rgba": (robot(visual('<material name="a"><color/></material>')), 3, "urdf.material.colour", "py"),
    "an undeclared prefix": (robot(extra='<drake:joint name="x"/>'), 5, "urdf.xml", "pym"),
    "an undeclared prefix of an attribute": (robot(extra='<gazebo sensor:a="1"/>'), 5, "urdf.xml", "pym"),
    "a late declaration": ("\n" + robot() .replace("<robot", '<?xml version="1.0"?><robot'), 2, "urdf.xml", "pym"),
    "a declaration after a comment": ('<!-- exported -->\n<?xml version="1.0"?>' + robot(), 2, "urdf.xml", "y"),
    "two declarations": ('<?xml version="1.0"?>\n<?xml version="1.0"?>' + robot(), 2, "urdf.xml", "pym"),
    "letters after the end": (robot() + "\nend", 6, "urdf.xml", "y"),
    "a zero byte after the end": (robot() + "\n\0", 6, "urdf.xml", "y"),
    "a cut comment after the end": (robot() + "\n<!-- x", 6, "urdf.xml", "y"),
    "the end twice": (robot() + "\n</robot>", 6, "urdf.xml", "ym"),
    "a second robot": (robot() + "\n" + robot(OTHER), 6, "urdf.xml", "pym"),
    "dashes in a comment": (robot(extra="<!-- a -- b --->"), 5, "urdf.xml", "pym"),
    "an ampersand": (robot(attributes='name="a&b"'), 1, "urdf.xml", "pym"),
    "no blank between attributes": (robot(joint='<origin xyz="1 2 3"rpy="0.1 0.2 0.3"/>' + AXIS + LIMIT), 4, "urdf.xml", "pm"),
    "letters of no encoding in a comment": (robot(extra="<!-- caf\xe9 -->").encode("latin-1"), 5, "urdf.xml", ""),
    "letters of no encoding beside a codec of no text": (('<?xml version="1.0" encoding="zlib"?>' + robot(extra="<!-- caf\xe9 -->")).encode("latin-1"), 5, "urdf.xml", ""),
    "an encoding that does not exist": (('<?xml version="1.0" encoding="uft-8"?>' + robot()), 1, "urdf.xml", "pym"),
    "an encoding that it is not in": (('<?xml version="1.0" encoding="utf-16"?>' + robot()), 1, "urdf.xml", "pm"),
    "a namespace": (robot(attributes='name="r" xmlns="http://example.org"'), 1, "urdf.xml", "pm"),
    "a version 1.3": (robot(attributes='name="r" version="1.3"'), 1, "urdf.version", "ym"),
    "a version 1": (robot(attributes='name="r" version="1"'), 1, "urdf.version", "ym"),
    "a quaternion": (robot(joint=f'<origin xyz="1 2 3" {QUARTER}/>' + AXIS + LIMIT, attributes='name="r" version="1.1"'), 4, "urdf.quaternion", "p"),
    "a long quaternion": (robot(joint='<origin quat_xyzw="0 0 2 2"/>' + AXIS + LIMIT, attributes='name="r" version="1.2"'), 4, "urdf.quaternion.normalised", "p"),
}  # fmt: skip


@pytest.mark.parametrize("case", TAKEN)
def test_what_readers_take_alike_is_taken_like_that(case: str, tmp_path: Path):
    text, line, rule, readers = TAKEN[case]
    found = read(text, tmp_path)
    told = found.told(rule)
    assert told.data["line"] == line
    assert str(line) in told.message or told.subject != "robot" or rule == "urdf.version"
    inertial, joint = found.tree.by_body["arm"].inertial, found.tree.by_joint["j"]
    pose = np.column_stack([rotation_of(joint.X_parent_joint.quat), joint.X_parent_joint.xyz])
    data = text.encode() if isinstance(text, str) else text
    for reader in readers:
        mass, theirs = READERS[reader](data)
        assert inertial is not None
        assert inertial.mass_kg == mass, reader
        assert np.allclose(pose, theirs, atol=1e-12), reader
    the_source_that_checks_read_is_tidy(found)


def the_source_that_checks_read_is_tidy(found: Reading) -> None:
    """pinocchio finds the same masses in it, whether or not it read the original."""
    assert etree.fromstring(found.source).tag == "robot"
    stated = found.source
    for name in ("effort", "velocity"):  # urdfdom refuses a limit without them
        stated = re.sub(rf"<limit(?![^>]*{name}=)", f'<limit {name}="0"', stated)
    mass, pose = by_pinocchio(stated.encode())
    inertial = found.tree.by_body["arm"].inertial
    joint = found.tree.by_joint["j"].X_parent_joint
    assert mass == (inertial.mass_kg if inertial else 0.0)
    assert np.allclose(pose, np.column_stack([rotation_of(joint.quat), joint.xyz]), atol=1e-12)


def test_one_number_scales_all_axes_and_three_colours_are_opaque(tmp_path: Path):
    look = '<material name="a"><color rgba="1 0 0.5"/></material>'
    mesh = '<collision><geometry><mesh filename="a.stl" scale="0.001"/></geometry></collision>'
    found = read(robot(visual(look) + mesh), tmp_path).shapes
    assert found.shapes[1].geometry == MeshFile("pkg/urdf/a.stl", (0.001, 0.001, 0.001))
    assert found.materials[0].rgba == (1.0, 0.0, 0.5, 1.0)


def test_a_capsule_without_length_is_a_ball(tmp_path: Path):
    found = read(robot(collision('<capsule radius="0.1" length="0"/>')), tmp_path)
    assert found.shapes.shapes[0].geometry == Sphere(0.1)


def test_products_left_out_are_zero_and_moments_are_not_made_up(tmp_path: Path):
    text = robot('<inertial><mass value="2"/><inertia ixx="1" iyy="2" izz="2.5"/></inertial>')
    inertial = read(text, tmp_path).tree.by_body["arm"].inertial
    assert inertial is not None
    assert inertial.inertia_com_kg_m2 == (1.0, 2.0, 2.5, 0.0, 0.0, 0.0)


def test_a_quaternion_turns_whatever_has_an_origin(tmp_path: Path):
    link = INERTIAL.replace("<origin ", f"<origin {QUARTER} ")
    link += f"<visual><origin {QUARTER}/>{BOX}</visual>"
    text = robot(link, f"<origin {QUARTER}/>" + AXIS + LIMIT, attributes='name="r" version="1.2"')
    found = read(text, tmp_path)
    half = math.sqrt(0.5)
    assert found.tree.joints[0].X_parent_joint.quat == pytest.approx((half, 0, 0, half))
    assert found.shapes.shapes[0].X_link_shape.quat == pytest.approx((half, 0, 0, half))
    inertial = found.tree.by_body["arm"].inertial
    assert inertial is not None
    assert inertial.inertia_com_kg_m2[:2] == pytest.approx((0.02, 0.01))
    assert found.told("urdf.quaternion").data["count"] == 3


def test_limits_of_1_2_are_left_out_with_a_warning(tmp_path: Path):
    words = 'effort="9" velocity="5" acceleration="3" deceleration="2" jerk="1"'
    found = read(robot(joint=limit(words), attributes='name="r" version="1.2"'), tmp_path)
    told = [f for f in found.findings if f.rule == "urdf.dropped"]
    assert [f.data["element"] for f in told] == [
        "acceleration of limit",
        "deceleration of limit",
        "jerk of limit",
    ]
    assert {f.severity for f in told} == {"warning"}


GAZEBO = {
    "a spring": ("<springStiffness>3</springStiffness><springReference>.2</springReference>", True),
    "no gravity": ("<mu1>0.2</mu1><gravity>false</gravity>", True),
    "gravity off": ("<turnGravityOff>true</turnGravityOff>", True),
    "gravity": ("<gravity>true</gravity>", False),
    "a look": ("<material>Gazebo/Red</material>", False),
    "friction": ("<mu1>0.2</mu1><mu2>0.2</mu2>", False),
}


@pytest.mark.parametrize("what", GAZEBO)
def test_what_gazebo_alone_reads_is_named(what: str, tmp_path: Path):
    words, moves = GAZEBO[what]
    found = read(robot(extra=f'<gazebo reference="arm">{words}</gazebo>'), tmp_path)
    told = found.told("urdf.dropped")
    assert "`arm` (" in told.message
    assert all(tag in told.message for tag in re.findall(r"</(\w+)>", words))
    assert told.severity == ("warning" if moves else "info")


@pytest.mark.parametrize("start", ["#usda 1.0\n(\n)\n", "PXR-USDC\0\0"])
def test_a_usd_is_no_source(start: str, tmp_path: Path):
    message = refused(start, tmp_path)
    assert "this is USD" in message
    assert "cut off" not in message


STRAY = '<inertial><mass value="1.3"/></inertial>'


@pytest.mark.parametrize(
    ("text", "tag", "severity", "mass"),
    [
        (robot(extra=STRAY), "inertial", "warning", "1.3"),
        (robot(joint=ORIGIN + AXIS + LIMIT + STRAY), "inertial", "warning", "1.3"),
        (robot(link=INERTIAL + '<mass value="2"/>'), "mass", "warning", "2"),
        (robot(link=INERTIAL + '<geometry><box size="1 1 1"/></geometry>'), "geometry", "warning", None),
        (robot(extra='<limit effort="3"/>'), "limit", "warning", None),
        (robot(link=INERTIAL + '<origin xyz="0 0 1"/>'), "origin", "info", None),
    ],
)  # fmt: skip
def test_a_part_outside_of_its_element_is_told_with_the_mass_that_vanishes(
    text: str, tag: str, severity: str, mass: str | None, tmp_path: Path
):
    found = read(text, tmp_path).told("urdf.stray")
    assert (found.severity, found.data["element"], found.data["mass_kg"]) == (severity, tag, mass)
    assert (f"of {mass} kg" in found.message) == (mass is not None)


def test_what_belongs_to_other_programs_is_no_stray(tmp_path: Path):
    gazebo = "<gazebo><inertial/></gazebo><transmission><joint name='j'/></transmission>"
    assert "urdf.stray" not in {f.rule for f in read(robot(extra=gazebo), tmp_path).findings}


@pytest.mark.parametrize("xyz", ["0.866 0 -0.5", "0.57735 0.57735 0.57735"])
def test_a_unit_axis_of_few_digits_is_taken_as_one(xyz: str, tmp_path: Path):
    text = robot(joint=f'{ORIGIN}<axis xyz="{xyz}"/>{LIMIT}')
    assert read(text, tmp_path).findings == []


def test_what_a_fixed_joint_says_of_axis_and_limits_is_not_read(tmp_path: Path):
    text = robot(joint='<axis xyz="x"/><limit effort="nan"/>', kind="fixed")
    assert read(text, tmp_path).findings == []


# What stands in the file | line | words of the error.
REFUSED = {
    "a decimal comma": (robot(joint='<origin xyz="1,5 2 3"/>' + AXIS + LIMIT), 4, "a comma may separate numbers or start decimals"),
    "a decimal comma of one number": (robot(joint=limit('effort="9,5" velocity="5"')), 4, "a comma may separate numbers or start decimals"),
    "a unit": (robot(joint=limit('effort="9 N" velocity="5"')), 4, "give a decimal number"),
    "a C number": (robot(joint=limit('effort="9.0f" velocity="5"')), 4, "give a decimal number"),
    "a hexadecimal number": (robot(joint=limit('effort="0x10" velocity="5"')), 4, "give a decimal number"),
    "a range that ends at one side": (robot(joint=ORIGIN + AXIS + '<limit lower="0" upper="inf"/>'), 4, "not a finite number"),
    "a negative size": (robot(collision('<sphere radius="-1"/>')), 3, "must be positive"),
    "a shape without size": (robot(collision("<box/>")), 3, "<box> without `size`"),
    "a scale of two numbers": (robot(collision('<mesh filename="a.stl" scale="1 1"/>')), 3, "needs 3 numbers, found 2"),
    "a scale of four different numbers": (robot(collision('<mesh filename="a.stl" scale="1 2 3 4"/>')), 3, "needs 3 numbers, found 4"),
    "an axis without direction": (robot(joint=ORIGIN + '<axis rpy="0 0 1"/>' + LIMIT), 4, 'write `xyz="1 0 0"`'),
    "a quaternion in 1.0": (robot(joint=f"<origin {QUARTER}/>" + AXIS + LIMIT), 4, 'write `version="1.1"` at <robot> to turn it'),
    "a quaternion beside rpy": (robot(joint=f'<origin rpy="1 0 0" {QUARTER}/>' + AXIS + LIMIT, attributes='name="r" version="1.2"'), 4, "remove one of the two: urdfdom refuses the file"),
    "a quaternion of zeros": (robot(joint='<origin quat_xyzw="0 0 0 0"/>' + AXIS + LIMIT), 4, "it is no rotation"),
    "one material twice, in two colours": (robot(extra='<material name="a"><color rgba="1 0 0 1"/></material>\n<material name="a"><color rgba="0 0 1 1"/></material>'), 6, "material `a` is defined twice"),
    "a leftover of xacro": (robot(extra="<xacro:arm/>"), 5, "this is a xacro file: expand it first"),
    "an attribute twice": (robot(joint='<origin xyz="1 2 3" xyz="1 2 3"/>' + AXIS + LIMIT), 4, "not readable as XML"),
    "a million comments without end": (robot(extra="<!--" * 1_000_000), 5, "not readable as XML"),
    "a codec that XML does not know": ('<?xml version="1.0" encoding="cp720"?>' + robot(extra="\xe9"), 1, "save it as UTF-8"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_two_meanings_is_refused_with_the_choices(case: str, tmp_path: Path):
    text, line, words = REFUSED[case]
    said = refused(text, tmp_path)
    assert said.startswith(f"{FILE}:{line}: ")
    assert words in said


def test_a_name_in_no_encoding_is_refused_with_its_line(tmp_path: Path):
    with pytest.raises(SourceError, match=rf"{FILE}:2: .*UTF-8"):
        read('<robot name="r">\n<link name="caf\xe9"/></robot>'.encode("latin-1"), tmp_path)


def test_a_namespace_may_be_relative(tmp_path: Path):
    """libxml2's canonical form refuses it."""
    found = read(robot(extra='<d:joint xmlns:d="drake" d:at="1"/>'), tmp_path)
    assert "urdf.dropped" in found.rules()


FLOATING = (
    '<robot name="r"><link name="world"/>\n<link name="base"/>'
    '<joint name="f" type="floating"><parent link="world"/><child link="base"/></joint></robot>'
)


def test_an_empty_root_above_a_floating_joint_is_the_world(tmp_path: Path):
    found = read(FLOATING, tmp_path, base="floating")
    assert [body.name for body in found.tree.bodies] == ["base"]
    assert found.tree.joints == ()
    assert found.told("urdf.world.floating").data["line"] == 2
    assert "world" not in found.source


@pytest.mark.parametrize(
    "other",
    [
        FLOATING.replace('type="floating"', 'type="fixed"'),
        FLOATING.replace('<link name="world"/>', f'<link name="world">{INERTIAL}</link>'),
        FLOATING.replace("</robot>", '<link name="c"/><joint name="g" type="fixed"><parent link="world"/><child link="c"/></joint></robot>'),
    ],
    ids=["a fixed joint", "a root that weighs", "more below the root"],
)  # fmt: skip
def test_any_other_root_stays(other: str, tmp_path: Path):
    assert read(other, tmp_path, base="floating").tree.root == "world"


def test_a_base_that_the_recipe_fixes_keeps_its_floating_joint(tmp_path: Path):
    assert read(FLOATING, tmp_path).tree.root == "world"
