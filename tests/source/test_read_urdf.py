"""The reader takes what is right exactly, and tells what is wrong with its line."""

# ruff: noqa: E501 # one broken file per line reads better than wrapped XML

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest
from urdfs import FILE, Reading, joint, link, read, refused, robot, shape

from assetbuild.robot.model import Limits, Mimic
from assetbuild.robot.shapes import Box, Capsule, Cylinder, MeshFile, Sphere


@pytest.fixture
def every_kind(robots: Path, tmp_path: Path) -> Reading:
    return read((robots / "every_kind.urdf").read_bytes(), tmp_path)


def test_the_tree_is_depth_first_from_the_only_root(every_kind: Reading):
    assert [b.name for b in every_kind.tree.bodies] == ["base", "arm", "hand", "finger", "thumb"]
    assert [j.name for j in every_kind.tree.joints] == ["shoulder", "wrist", "slide", "spin"]
    assert every_kind.tree.by_body["hand"].inertial is None


def test_joints_say_what_the_file_says(every_kind: Reading):
    shoulder, slide, spin = (every_kind.tree.by_joint[n] for n in ("shoulder", "slide", "spin"))
    assert shoulder.axis == (0.0, 0.0, 1.0)
    assert shoulder.limits == Limits(-1.0, 2.0, 10.0, 3.0)
    assert (shoulder.damping, shoulder.friction) == (0.1, 0.2)
    assert shoulder.X_parent_joint.quat == pytest.approx((math.cos(0.75), 0, 0, math.sin(0.75)))
    assert slide.axis == (1.0, 0.0, 0.0), "an omitted axis is X"
    assert spin.mimic == Mimic("slide", -2.0, 0.5)
    assert spin.limits == Limits()


def test_shapes_have_stable_names_and_their_own_geometry(every_kind: Reading):
    assert [(s.name, s.geometry) for s in every_kind.shapes.shapes] == [
        ("base_visual", MeshFile("pkg/meshes/base.dae", (0.001, 0.001, -0.001))),
        ("base_visual_1", MeshFile("pkg/meshes/lid.stl")),
        ("base_collision", Box((1.0, 2.0, 3.0))),
        ("base_collision_1", Capsule(0.1, 0.5)),
        ("arm_visual", MeshFile("pkg/meshes/base.dae")),
        ("arm_visual_1", Sphere(0.1)),
        ("finger_visual", Cylinder(0.1, 0.2)),
    ]


def test_materials_are_found_by_name_wherever_they_are_defined(every_kind: Reading):
    by_name = {shape.name: shape.material for shape in every_kind.shapes.shapes}
    assert by_name["base_visual"] == "grey"
    assert by_name["base_visual_1"] == "base_material", "a colour without a name gets one"
    assert by_name["arm_visual_1"] == by_name["finger_visual"] == "green"
    assert by_name["arm_visual"] is None, "`blue` is defined nowhere"
    colours = {m.name: m.rgba for m in every_kind.shapes.materials}
    assert colours["base_material"] == (1.0, 0.0, 0.0, 1.0)


def test_each_mesh_is_listed_once_with_its_first_use(every_kind: Reading):
    assert [(m["path"], m["subject"]) for m in every_kind.meshes] == [
        ("pkg/meshes/base.dae", "link base"),
        ("pkg/meshes/lid.stl", "link base"),
    ]
    assert every_kind.meshes[0]["uri"] == "package://robot_pkg/meshes/base.dae"


def test_what_has_no_home_is_told_once_per_kind(every_kind: Reading):
    dropped = {
        f.data["element"]: f.data["count"] for f in every_kind.findings if "dropped" in f.rule
    }
    assert dropped == {
        "transmission": 2,
        "gazebo": 1,
        "safety_controller": 1,
        "name of visual": 1,
    }


def test_repairs_and_gaps_are_findings(every_kind: Reading):
    told = {f.rule: f for f in every_kind.findings}
    assert told["urdf.axis.normalised"].subject == "joint shoulder"
    assert told["urdf.axis.normalised"].data["norm"] == 2.0
    assert told["urdf.material.undefined"].data["material"] == "blue"


def test_the_source_map_knows_the_lines(every_kind: Reading, robots: Path):
    text = (robots / "every_kind.urdf").read_text().splitlines()
    for subject, needle in {
        "link arm": '<link name="arm"',
        "joint slide": '<joint name="slide"',
        "mesh pkg/meshes/lid.stl": "lid.stl",
        "material green": '<material name="green">',
        "shape base_collision_1": "capsule",
        "element gazebo": "<gazebo",
        "robot": "<robot",
    }.items():
        assert needle in text[every_kind.lines[subject] - 1], subject


def test_inertia_given_in_turned_axes_is_read_into_link_axes(robots: Path, tmp_path: Path):
    reading = read((robots / "inertia_rotated_origin.urdf").read_bytes(), tmp_path)
    inertial = reading.tree.bodies[0].inertial
    assert inertial is not None
    # A quarter turn about z swaps xx and yy; what was xz is seen along y.
    assert inertial.inertia_com_kg_m2 == pytest.approx((2.0, 1.0, 2.5, 0.0, 0.0, 0.25), abs=1e-15)
    assert inertial.com_m == (0.1, 0.2, 0.3)


@pytest.mark.parametrize("version", ["0.0", "1", "2.7"])
def test_a_version_of_xml_that_does_not_exist_is_told(version: str, tmp_path: Path):
    """As in many files of Bullet's, whose reader does not look."""
    body = '<robot name="r"><link name="a"/></robot>'
    reading = read(f'<?xml version="{version}" encoding="utf-8"?>\n{body}', tmp_path)
    assert reading.rules() == ["urdf.xml"]
    assert reading.lines["link a"] == 2
    assert reading.source.startswith("<robot")
    assert read(f'<?xml version="1.0"?>\n{body}', tmp_path / "b").rules() == []


def test_numbers_without_a_rotation_keep_every_bit(tmp_path: Path):
    inertia = 'ixx="0.10000000000000003" ixy="1e-17" ixz="-3.3e-9" iyy=".2" iyz="+4E-3" izz="3."'
    text = robot(f'<link name="a"><inertial><origin xyz="1e-300 2 3" rpy="0 -0 0"/>'
                  f'<mass value="7.000000000000001"/><inertia {inertia}/></inertial></link>')  # fmt: skip
    inertial = read(text, tmp_path).tree.bodies[0].inertial
    assert inertial is not None
    assert inertial.inertia_com_kg_m2 == (0.10000000000000003, 0.2, 3.0, 1e-17, -3.3e-9, 4e-3)
    assert (inertial.mass_kg, inertial.com_m) == (7.000000000000001, (1e-300, 2.0, 3.0))


# --- what is refused ----------------------------------------------------------------------------


def _arm(joint: str, links: str = '<link name="a"/><link name="b"/>') -> str:
    return robot(f"{links}\n{joint}")


def _joint(inside: str = "", kind: str = "fixed", name: str = "j") -> str:
    ends = '<parent link="a"/><child link="b"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def _mass(mass: str, inertia: str = 'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"') -> str:
    return robot(f'<link name="a"><inertial>{mass}<inertia {inertia}/></inertial></link>')


BAD = {
    "not xml": ("hello", 1, "not readable as XML"),
    "empty": ("", 1, "not readable as XML"),
    "cut off": ('<robot name="r">\n<link name="a">\n', 3, "hint: is the file cut off?"),
    "mjcf": ("<mujoco/>", 1, "this is MJCF, not URDF"),
    "no links": ('<robot name="r"/>', 1, "a robot without links"),
    "link twice": (robot('<link name="a"/>\n<link name="a"/>'), 3, "link `a` is defined twice, first on line 2"),
    "joint twice": (_arm(_joint() + "\n" + _joint()), 4, "joint `j` is defined twice"),
    "no name": (robot("<link/>"), 2, "<link> without `name`"),
    "joint type": (_arm(_joint(kind="revolut")), 3, "hint: did you mean `revolute`?"),
    "no joint type": (_arm('<joint name="j"><parent link="a"/><child link="b"/></joint>'), 3, "joint j: <joint> without `type`\nhint: choose one: `"),
    "joint type of PyBullet": (_arm(_joint(kind="spherical")), 3, "hint: PyBullet's ball joint"),
    "no parent": (_arm('<joint name="j" type="fixed"><child link="b"/></joint>'), 3, "joint j: <joint> without <parent>"),
    "no child": (_arm('<joint name="j" type="fixed"><parent link="a"/></joint>'), 3, "joint j: <joint> without <child>"),
    "no world": (_arm(_joint().replace('parent link="a"', 'parent link="world"')), 3, "parent link `world` does not exist\nhint: add `<link name=\"world\"/>`"),
    "no such link": (_arm(_joint().replace('child link="b"', 'child link="bb"')), 3, "joint j: child link `bb` does not exist"),
    "own parent": (_arm(_joint().replace('child link="b"', 'child link="a"')), 3, "the same link `a`"),
    "two parents": (_arm(_joint() + "\n" + _joint(name="k")), 4, "joint k: link `b` already hangs on joint `j`"),
    "two roots": (robot('<link name="a"/>\n<link name="b"/>'), 3, "2 links have no parent: `a`, `b`"),
    "loop": (_arm(_joint() + "\n" + '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint>'), 4, "close a loop: `a` -> `b` -> `a`"),
    "nan inertia": (_mass('<mass value="1"/>', 'ixx="nan" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"'), 2, "link a: inertia ixx is `nan`"),
    "infinite": (_mass('<mass value="1e999"/>'), 2, "mass value is `1e999`, not a finite number"),
    "a number of no robot": (_mass('<mass value="1e300"/>'), 2, "mass value is 1e+300, which no robot has"),
    "next to nothing": (_mass('<mass value="1e-300"/>'), 2, "mass value is 1e-300, which no robot has"),
    "python number": (_mass('<mass value="1_0"/>'), 2, "mass value is `1_0`"),
    "xacro number": (_mass('<mass value="${m}"/>'), 2, "hint: expand the xacro file first"),
    "negative mass": (_mass('<mass value="-1"/>'), 2, "mass is -1.0 kg"),
    "short vector": (_arm(_joint('<origin xyz="0 0"/>')), 3, "origin xyz needs 3 numbers, found 2: `0 0`"),
    "xacro with blanks": (_arm(_joint('<origin xyz="$(optenv X 1 0 0)"/>')), 3, "expand the xacro"),
    "zero axis": (_arm(_joint('<axis xyz="0 0 0"/>', "continuous")), 3, "joint j: axis is `0 0 0`"),
    "no limit": (_arm(_joint(kind="revolute")), 3, "joint j: a revolute joint without <limit>"),
    "negative damping": (_arm(_joint('<dynamics damping="-1"/>', "continuous")), 3, "dynamics damping is -1.0"),
    "mimics nobody": (_arm(_joint('<mimic joint="x"/>', "continuous")), 3, "patches: [{file: URDF, find: '<mimic ...>'"),
    "followers in a row": (_arm(_joint('<mimic joint="k"/>', "continuous") + '<joint name="k" type="continuous"><parent link="b"/><child link="c"/><mimic joint="j"/></joint>', '<link name="a"/><link name="b"/><link name="c"/>'), 3, "follow one another: `j` -> `k` -> `j`"),
    "xacro": ('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:property name="a" value="1"/><link name="a"/></robot>', 2, "<xacro:property> in a URDF"),
    "mimics next to nothing": (_arm(_joint('<mimic joint="k" multiplier="-1e-320"/>', "continuous") + '<joint name="k" type="continuous"><parent link="b"/><child link="c"/></joint>', '<link name="a"/><link name="b"/><link name="c"/>'), 3, "mimic multiplier is -1e-320, which no robot has"),
    "mimics itself": (_arm(_joint('<mimic joint="j"/>', "continuous")), 3, "cannot mimic itself"),
    "negative box": (robot(link("a", shape("collision", '<box size="1 1 -1"/>'))), 2, "every edge must be positive"),
    "zero scale": (robot(link("a", shape("collision", '<mesh filename="a.stl" scale="1 0 1"/>'))), 2, "a scale of 0 leaves no mesh"),
    "unknown geometry": (robot(link("a", shape("collision", "<boxx/>"))), 2, "hint: did you mean `box`?"),
    "file uri": (robot(link("a", shape("collision", '<mesh filename="file:///x/a.stl"/>'))), 2, "is absolute"),
    "absolute": (robot(link("a", shape("collision", '<mesh filename="/x/a.stl"/>'))), 2, "is absolute"),
    "escape": (robot(link("a", shape("collision", '<mesh filename="../../../a.stl"/>'))), 2, "leads out of the source"),
    "escape by two slashes": (robot(link("a", shape("collision", '<mesh filename="package://robot_pkg//etc/a.stl"/>'))), 2, "leads out of the source"),
    "escape by package": (robot(link("a", shape("collision", '<mesh filename="package://robot_pkg/../../a.stl"/>'))), 2, "leads out of the source"),
    "backslash": (robot(link("a", shape("collision", r'<mesh filename="meshes\a.stl"/>'))), 2, "hint: write `/` instead"),
    "unknown package": (robot(link("a", shape("collision", '<mesh filename="package://robot_pgk/a.stl"/>'))), 2, "did you mean `robot_pkg`?; or add `robot_pgk: FOLDER` under `source.packages`"),
    "folder": (robot(link("a", shape("collision", '<mesh filename="package://robot_pkg/"/>'))), 2, "names a folder"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_broken_file_is_refused_with_its_line(case: str, tmp_path: Path):
    text, line, words = BAD[case]
    said = refused(text, tmp_path)
    assert said.startswith(f"{FILE}:{line}: ")
    assert words in said


ENTITIES = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(12))
DOCTYPES = {
    "an entity": '<?xml version="1.0"?>\n<!DOCTYPE robot [<!ENTITY a "x">]>',
    "a file of the web": '<!DOCTYPE robot SYSTEM "http://localhost/never.dtd">',
    "none": "<!DOCTYPE robot>",
    "a bomb": f'<!DOCTYPE robot [<!ENTITY a "ha">{ENTITIES}]>',
    "a bomb in UTF-16": f'<!DOCTYPE robot [<!ENTITY a "ha">{ENTITIES}]>',
    "a bomb behind a comment": f'<!-- a --><!DOCTYPE robot [<!ENTITY a "ha">{ENTITIES}]>',
    "a bomb before a late declaration": f'\n<?xml version="1.0"?><!DOCTYPE robot [{ENTITIES}]>',
}


@pytest.mark.parametrize("what", DOCTYPES)
def test_a_doctype_is_refused_before_anything_is_expanded(what: str, tmp_path: Path):
    encoding = "utf-16" if "UTF-16" in what else "utf-8"
    text = f'{DOCTYPES[what]}\n<robot name="&a;"><link name="a"/></robot> more'
    assert "a DOCTYPE is not allowed" in refused(text.encode(encoding), tmp_path)


def test_absurd_nesting_is_refused(tmp_path: Path):
    deep = "<a>" * 5000 + "</a>" * 5000
    assert "nested this deep" in refused(robot(deep), tmp_path)


def test_too_many_bytes_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("assetbuild.source.urdf.xml.MAX_BYTES", 100)
    assert "of URDF; at most" in refused(robot(" " * 101), tmp_path)


# --- what is told and goes on -------------------------------------------------------------------


def test_one_look_under_two_names_and_two_under_one(tmp_path: Path):
    def visual(look: str) -> str:
        return f'<visual><geometry><sphere radius="1"/></geometry><material name="m">{look}</material></visual>'

    red, blue = '<color rgba="1 0 0 1"/>', '<color rgba="0 0 1 1"/>'
    reading = read(
        robot(f'<link name="a">{visual(red)}{visual(blue)}{visual(red)}{visual(blue)}</link>'),
        tmp_path,
    )
    assert [s.material for s in reading.shapes.shapes] == ["m", "m_1", "m", "m_1"]
    assert reading.rules() == ["urdf.material.conflict"]


@pytest.mark.parametrize(
    ("stated", "taken", "rule"),
    [
        ("255 0 0 1", (1.0, 0.0, 0.0, 1.0), "urdf.material.range"),
        ("1 0 0 0", (1.0, 0.0, 0.0, 0.0), "urdf.material.transparent"),
    ],
)
def test_a_colour_that_is_cut_or_not_seen_is_told(
    stated: str, taken: tuple[float, ...], rule: str, tmp_path: Path
):
    look = f'<material name="m"><color rgba="{stated}"/></material>'
    reading = read(robot(f'{look}<link name="a"/>'), tmp_path)
    assert reading.shapes.materials[0].rgba == taken
    assert reading.rules() == [rule]


def test_textures_are_paths_of_the_source(tmp_path: Path):
    look = '<material name="m"><texture filename="package://robot_pkg/wood.png"/></material>'
    material = read(robot(f'{look}<link name="a"/>'), tmp_path).shapes.materials[0]
    assert (material.texture, material.rgba) == ("pkg/wood.png", (1.0, 1.0, 1.0, 1.0))


def test_limits_left_out_are_told(tmp_path: Path):
    reading = read(_arm(_joint('<limit upper="1"/>', "revolute")), tmp_path)
    assert reading.tree.joints[0].limits == Limits(0.0, 1.0, None, None)
    assert reading.findings[0].data["missing"] == ("lower", "effort", "velocity")
    assert reading.rules() == ["urdf.limit.omitted"]
    whole = '<limit lower="0" upper="1" effort="2" velocity="3"/>'
    assert read(_arm(_joint(whole, "revolute")), tmp_path / "b").rules() == []


@pytest.mark.parametrize(
    ("velocity", "free"), [("1e9", ("velocity",)), ("1e12", ("velocity",)), ("9e8", ())]
)
def test_a_limit_of_a_billion_is_none(velocity: str, free: tuple[str, ...], tmp_path: Path):
    limit = f'<limit lower="0" upper="1" effort="2" velocity="{velocity}"/>'
    reading = read(_arm(_joint(limit, "revolute")), tmp_path)
    assert reading.tree.joints[0].limits.velocity == (None if free else float(velocity))
    told = [f.data["unlimited"] for f in reading.findings if f.rule == "urdf.limit.unlimited"]
    assert told == [free] * bool(free)


def test_a_robot_without_a_name_gets_one(tmp_path: Path):
    reading = read('<robot><link name="a"/></robot>', tmp_path)
    assert (reading.tree.name, reading.rules()) == ("robot", ["urdf.name.missing"])


def test_a_range_on_a_continuous_joint_is_told(tmp_path: Path):
    limit = '<limit lower="-1" upper="1" effort="2" velocity="3"/>'
    reading = read(_arm(_joint(limit, "continuous")), tmp_path)
    assert reading.tree.joints[0].limits == Limits(None, None, 2.0, 3.0)
    assert reading.rules() == ["urdf.limit.ignored"]


def test_a_follower_of_a_fixed_joint_is_locked(tmp_path: Path):
    fixed = '<joint name="f" type="fixed"><parent link="b"/><child link="c"/></joint>'
    follower = (
        '<joint name="k" type="continuous"><parent link="c"/><child link="d"/>'
        '<mimic joint="f" offset="0.3"/></joint>'
    )
    done = read(_arm(_joint() + '<link name="c"/><link name="d"/>' + fixed + follower), tmp_path)
    limits = done.tree.by_joint["k"].limits
    assert (limits.lower, limits.upper) == (0.3, 0.3)
    assert "joint.mimic_fixed" in {finding.rule for finding in done.findings}


def test_a_chain_of_links_is_read_in_linear_time(tmp_path: Path):
    links = [link(f"l{number}") for number in range(3000)]
    joints = (joint(f"j{number}", f"l{number - 1}", f"l{number}") for number in range(1, 3000))
    start = time.process_time()
    assert len(read(robot(*links, *joints), tmp_path).tree.bodies) == 3000
    assert time.process_time() - start < 12.0
