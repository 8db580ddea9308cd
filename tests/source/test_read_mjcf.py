"""An MJCF is read by MuJoCo's own rules, exactly; what cannot be read is told with its line."""

# ruff: noqa: E501 # one broken file per line reads better than wrapped XML

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import pytest
from mjcfs import TET, Reading, compared, hard_arm, read, write

from assetbuild.errors import SourceError
from assetbuild.robot.model import Contact, Mimic, Place, Sensor
from assetbuild.robot.pose import Pose


def robot(body: str, more: str = "", head: str = "") -> str:
    return f'<mujoco model="r">{head}<worldbody>{body}</worldbody>{more}</mujoco>'


ARM = '<body name="a"><geom name="g" size=".1"/><body name="b" pos="0 0 1"><joint name="j"/><geom name="h" size=".1"/></body></body>'


def refused(text: str, tmp_path: Path, **files: str) -> str:
    with pytest.raises(SourceError) as caught:
        read(text, tmp_path, **files)
    return str(caught.value)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Reading:
    return hard_arm(tmp_path_factory.mktemp("arm"))


# --- bodies and joints ----------------------------------------------------------------------


def test_bodies_keep_their_names_and_only_those_with_mass_stay_bodies(arm: Reading):
    assert arm.links.base == "fixed"
    assert arm.links.root == "base"
    assert arm.source.bodies == ("base", "upper", "lower", "slider", "follower", "welded")
    assert "mark" in arm.links.by_body, "a body without mass only names a place"


def test_several_joints_on_one_body_become_a_row_of_links(arm: Reading):
    shoulder, twist = (arm.links.by_joint[name] for name in ("shoulder", "twist"))
    assert (shoulder.parent, shoulder.child) == ("base", "upper_shoulder")
    assert (twist.parent, twist.child) == ("upper_shoulder", "upper")
    assert arm.links.by_body["upper_shoulder"].inertial is None
    assert twist.X_parent_joint.xyz == pytest.approx((0.04, -0.02, -0.03)), "anchor to anchor"


def test_a_joint_that_stands_elsewhere_moves_the_frame_and_keeps_the_old_one(arm: Reading):
    frame = arm.links.joint_above["upper_origin"]
    assert (frame.kind, frame.parent) == ("fixed", "upper")
    assert frame.X_parent_joint.xyz == (-0.05, 0.0, 0.0)
    assert "mjcf.joint_pos" in arm.rules()


def test_positions_count_from_ref_and_degrees_become_radians(arm: Reading):
    elbow = arm.links.by_joint["elbow"]
    refs = {f.subject: f.data["ref"] for f in arm.findings if f.rule == "mjcf.joint_ref"}
    assert refs["joint elbow"] == pytest.approx(math.radians(20), abs=1e-12)
    assert "joint shoulder" not in refs
    assert elbow.limits.lower == pytest.approx(math.radians(-20), abs=1e-15)
    assert elbow.limits.upper == pytest.approx(math.radians(80), abs=1e-15)
    values = dict(arm.control.keyframes[0].joints)
    assert values["elbow"] == pytest.approx(0.5 - math.radians(20), abs=1e-15)
    assert values["shoulder"] == 0.1
    assert arm.control.by_joint["elbow"].ctrl == pytest.approx(
        (-math.radians(20), 1.5 - math.radians(20))
    )


@pytest.mark.parametrize(
    ("written", "kind"),
    [
        ('<geom name="g"size=".1"/>', "space"),
        ("<!-- --- a --- --><geom size='.1'/>", "comment"),
        ('<geom name="a&b" size=".1"/>', "ampersand"),
    ],
)
def test_faults_of_the_text_that_mujoco_overlooks_are_reported(
    written: str, kind: str, tmp_path: Path
):
    part = f'<mujoco>\n<worldbody><body name="a">{written}</body></worldbody></mujoco>'
    reading = read(robot("", head='<include file="part.xml"/>'), tmp_path, part_xml=part)
    compiled = mujoco.MjModel.from_xml_path(f"{tmp_path}/in/tree/arm/robot.xml")
    assert reading.links.root == compiled.body(1).name
    (found,) = [finding for finding in reading.findings if finding.rule == "mjcf.xml"]
    assert found.data == {"fault": kind, "line": 2}
    assert found.message.endswith("(arm/part.xml:2)")


@pytest.mark.skipif(mujoco.__version__.startswith("3."), reason="a warning of MuJoCo 4")
def test_what_mujoco_warns_about_is_passed_on(tmp_path: Path):
    ball, head = '<body name="a"><geom size=".1"/></body>', '<compiler settotalmass="9"/>'
    warned = read(robot(ball, head=head), tmp_path / "a")
    inertial = warned.links.by_body["a"].inertial
    assert inertial is not None and inertial.mass_kg == pytest.approx(9.0)
    assert "mjcf.source_warning" in warned.rules()
    assert "mjcf.source_warning" not in read(robot(ball), tmp_path / "b").rules()


def test_a_free_joint_makes_the_base_float_and_the_recipe_may_hold_it(tmp_path: Path):
    text = robot('<body name="a" pos="0 0 2"><freejoint name="root"/><geom size=".1"/></body>')
    floating = read(text, tmp_path / "1")
    assert floating.links.base == "floating"
    assert floating.only("freejoint") == {"": '<freejoint name="root"/>'}
    assert floating.only("root") == {"a": '<body pos="0 0 2"/>'}
    held = read(text, tmp_path / "2", base="fixed")
    assert held.links.base == "fixed"
    assert (held.links.X_world_root, held.only("root")) == (Pose((0.0, 0.0, 2.0)), {})
    assert "mjcf.base" in held.rules()


def test_a_joint_to_the_world_makes_the_world_the_root(tmp_path: Path):
    text = robot(
        '<body name="cart" pos="0 0 1"><joint name="rail" type="slide"/><geom size=".1"/></body>'
    )
    reading = read(text, tmp_path)
    assert reading.links.root == "world"
    assert reading.links.by_joint["rail"].X_parent_joint.xyz == (0.0, 0.0, 1.0)


def test_what_has_no_name_gets_one(tmp_path: Path):
    text = robot(
        '<body><geom size=".1"/><geom size=".1"/><geom size=".1" contype="0" conaffinity="0"/><body><joint/><geom size=".1"/><site/></body></body>'
    )
    reading = read(text, tmp_path)
    assert [b.name for b in reading.links.bodies] == ["body", "body_body", "body_body_site"]
    assert [s.name for s in reading.shapes.shapes] == [
        "body_collision",
        "body_collision2",
        "body_visual",
        "body_body_collision",
        "body_collision_visual",
        "body_collision2_visual",
        "body_body_collision_visual",
    ]
    assert reading.links.moving_joints[0].name == "body_body_joint"


GUARDED = '<geom name="hull" contype="0" conaffinity="0" group="{}" size=".1"/>'


@pytest.mark.parametrize(
    ("beside", "stated", "roles"),
    [
        ("", 'rgba="1 0 0 1"', {"bumper": "collision", "bumper_visual": "visual"}),
        (GUARDED.format(0), "", {"bumper": "collision", "bumper_visual": "visual"}),
        (GUARDED.format(1), "", {"bumper": "collision"}),
        ("", 'group="3"', {"bumper": "collision"}),
        ("", 'rgba="1 0 0 0"', {"bumper": "collision"}),
    ],
    ids=["alone", "in the group of what is seen", "beside a shell", "hidden", "transparent"],
)
def test_what_collides_and_is_drawn_is_seen_in_every_format(
    beside: str, stated: str, roles: dict[str, str], tmp_path: Path
):
    text = robot(f'<body name="b">{beside}<geom name="bumper" size=".2" {stated}/></body>')
    reading = read(text, tmp_path / "read")
    shapes = [s for s in reading.shapes.shapes if s.name != "hull"]
    assert {s.name: s.role for s in shapes} == roles
    assert compared(write(reading, tmp_path / "out")) == set()


def test_a_site_named_like_a_body_is_renamed_aloud(arm: Reading):
    assert "slider_site" in arm.links.by_body
    assert "mjcf.renamed" in arm.rules()


# --- shapes and surfaces --------------------------------------------------------------------


def test_surfaces_are_those_of_the_classes(arm: Reading):
    contacts = dict(arm.control.contacts)
    rubber = Contact(friction=(0.9, 0.01, 0.001), condim=4)
    assert arm.control.contact == rubber
    assert contacts["beam"] == rubber
    assert contacts["tube"] == Contact()
    assert contacts["knob"].priority == 2


def test_colours_that_differ_by_less_than_a_shade_are_two(tmp_path: Path):
    """Materials of such colours are called after the nearest of 256 shades."""
    colours = ("0.631817 0.804656 0.9 1", "0.631836 0.804648 0.9 1", "0.631817 0.804656 0.9 1")
    seen = "".join(
        f'<geom name="g{i}" size=".1" contype="0" conaffinity="0" rgba="{rgba}"/>'
        for i, rgba in enumerate(colours)
    )
    found = read(
        robot(f'<body name="a"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{seen}</body>'),
        tmp_path,
    )
    materials = {m.name: m.rgba for m in found.shapes.materials}
    worn = [materials[shape.material or ""] for shape in found.shapes.shapes]
    assert worn == [tuple(map(float, rgba.split())) for rgba in colours]
    assert len(materials) == 2


def test_a_shape_that_only_mjcf_has_stays_whole(arm: Reading):
    assert 'type="ellipsoid"' in arm.only("body")["base"]
    assert not any(shape.name == "egg" for shape in arm.shapes.shapes)


# --- drives, sensors, couplings -------------------------------------------------------------


@pytest.mark.parametrize(
    ("element", "model"),
    [
        ('<motor joint="j" ctrlrange="-5 5"/>', "motor"),
        ('<position joint="j" kp="3"/>', "pd"),
        ('<velocity joint="j" kv="3"/>', "velocity"),
        ('<general joint="j" gainprm="2" biastype="affine" biasprm="1 -2 0 1"/>', "general"),
        ('<intvelocity joint="j" kp="2" actrange="-1 1"/>', "passive"),
        ('<motor joint="j" ctrlrange="-5 6"/>', "general"),
        ('<position joint="j" kp="3" forcerange="-1 2"/>', "passive"),
        ('<motor joint="j" group="2"/>', "motor"),
        ('<motor joint="j" gear="0"/>', "passive"),
    ],
)
def test_every_actuator_is_the_robots_or_left_whole(element: str, model: str, tmp_path: Path):
    reading = read(robot(ARM, f"<actuator>{element}</actuator>"), tmp_path)
    assert reading.control.by_joint["j"].model == model
    whole = [item for item in reading.control.mjcf_only if item.place == "actuator"]
    assert bool(whole) == (model == "passive")


def test_a_linear_coupling_is_a_mimic_and_its_softness_stays_with_mjcf(arm: Reading):
    assert arm.links.by_joint["follow"].mimic == Mimic("slide", -1.0, 0.01)
    assert arm.only("mimic") == {"follow": '<joint solref="0.005 1" name="couple"/>'}
    assert 'site2="slider_site"' in arm.only("equality")[""], "under the frame's new name"


def test_sensors_are_the_robots_where_it_has_the_words(tmp_path: Path):
    sensors = '<gyro site="s"/><framepos name="f" objtype="xbody" objname="b" reftype="site" refname="s" cutoff="3"/><jointpos joint="j" noise="0.1"/><framezaxis name="z" objtype="body" objname="world"/><distance name="d" geom1="g" geom2="h" cutoff="1"/>'
    text = robot(
        ARM.replace("</body></body>", '<site name="s"/></body></body>'),
        f"<sensor>{sensors}</sensor>",
    )
    reading = read(text, tmp_path)
    assert reading.control.sensors == (
        Sensor("s_gyro", "gyro", Place("frame", "s")),
        Sensor("f", "framepos", Place("frame", "b"), Place("frame", "s"), cutoff=3.0),
        Sensor("j_jointpos", "jointpos", Place("joint", "j"), noise=0.1),
        Sensor("z", "framezaxis", Place("world")),
    )
    assert [i.element for i in reading.control.mjcf_only if i.place == "sensor"] == [
        '<distance name="d" cutoff="1" geom1="g" geom2="h"/>'
    ]


def test_sensors_that_change_places_are_one_finding(tmp_path: Path):
    own = "".join(f'<jointpos name="q{n}" joint="j"/>' for n in range(3))
    sensors = f'<sensor><clock name="c"/>{own}</sensor>'
    found = read(robot(ARM, sensors), tmp_path)
    (order,) = [f.message for f in found.findings if f.rule == "mjcf.order"]
    assert order.startswith("sensors from `q0` on stand before those that only MJCF has")


def test_excludes_and_cameras(arm: Reading):
    assert arm.control.excludes == (("base", "lower"),)
    eye = next(camera for camera in arm.control.cameras if camera.name == "eye")
    assert (eye.link, eye.resolution) == ("slider", (320, 240))
    assert eye.fovy == pytest.approx(math.radians(50))
    assert next(c for c in arm.control.cameras if c.name == "world_cam").link is None


# --- includes, lines, refusals --------------------------------------------------------------


def test_an_included_body_is_found_in_its_own_file(tmp_path: Path):
    inside = f"<mujoco>\n<worldbody>\n{ARM}</worldbody></mujoco>"
    reading = read('<mujoco><include file="more.xml"/></mujoco>', tmp_path, more_xml=inside)
    assert reading.lines["link a"] == "arm/more.xml:3"


@pytest.mark.parametrize("found", ["main", "near"])
def test_a_nested_include_is_looked_for_beside_the_main_file_first(found: str, tmp_path: Path):
    """So MuJoCo does."""
    main, near = (robot(f'<body name="{n}"><geom size="1"/></body>') for n in ("main", "near"))
    nested = '<mujoco><include file="b.xml"/></mujoco>'
    files = {"parts__a_xml": nested, "parts__b_xml": near}
    files |= {"b_xml": main} if found == "main" else {}
    reading = read('<mujoco><include file="parts/a.xml"/></mujoco>', tmp_path, **files)
    compiled = mujoco.MjModel.from_xml_path(f"{tmp_path}/in/tree/arm/robot.xml")
    assert reading.links.root == compiled.body(1).name == found


@pytest.mark.parametrize("meshdir", ["", 'meshdir="..\\arm\\cad"'])
def test_files_are_named_with_the_separators_of_windows_too(meshdir: str, tmp_path: Path):
    name = r"cad/..\cad\a.obj" if not meshdir else "a.obj"
    head = f'<compiler {meshdir}/><asset><mesh name="m" file="{name}"/></asset>'
    body = '<body name="a"><geom type="mesh" mesh="m"/></body>'
    reading = read(robot(body, head=head), tmp_path, cad__a_obj=TET)
    assert [mesh["path"] for mesh in reading.meshes] == ["arm/cad/a.obj"]
    assert mujoco.MjModel.from_xml_path(f"{tmp_path}/in/tree/arm/robot.xml").nmesh == 1


SCENE = """\
<body name="table"><geom size=".5"/></body>
<body name="hand" mocap="true"><geom size=".1" contype="0" conaffinity="0"/></body>
<body name="cube" pos="0 0 1"><freejoint name="cube"/><geom size=".1"/><site name="top"/></body>
<body name="dog" pos="0 0 2"><freejoint name="root"/><geom size=".1"/><body name="leg"><joint name="knee"/><geom size=".1"/></body></body>"""
ACTING = '<actuator><motor name="m" joint="knee"/></actuator><sensor><framepos name="p" objtype="site" objname="top"/></sensor><equality><weld name="w" body1="hand" body2="leg"/></equality><keyframe><key name="home" qpos="9 9 9 1 0 0 0 0 0 3 1 0 0 0 .5" ctrl=".25"/></keyframe>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot/>", "robot.xml:1: the root element is <robot>, not <mujoco>\nhint: this is URDF: use `source.urdf`"),
        ("<mujocoinclude/>", "<mujocoinclude>, not <mujoco>\nhint: this is a part of a model: give the file that includes it"),
        ("<mujoco/>", "robot.xml:1: an MJCF without <worldbody>"),
        ('<mujoco xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arg name="a"/></mujoco>', "hint: expand it first: `xacro FILE"),
        ("<mujoco><worldbody>", "robot.xml:1: not readable as XML"),
        ('<!DOCTYPE m [<!ENTITY a "b">]><mujoco/>', "a DOCTYPE is not allowed"),
        (robot(""), "a robot without bodies"),
        (robot('<body name="a"><freejoint/><geom size=".1"/></body>\n<body name="c"><freejoint/><geom size=".1"/></body>'), "robot.xml:2: 2 bodies, none of them driven, in the world, and a recipe builds one"),
        (robot('<body name="a">\n<geom size=".1" sise="3"/></body>'), "robot.xml:2: MuJoCo does not compile it: Schema violation: unrecognized attribute: 'sise'"),
        (robot('<body name="a"><geom size=".1" material="m"/></body>'), "hint: if another file includes this one and defines it"),
        (robot('<body name="a">\n<joint/></body>'), "MuJoCo does not compile it: mass and inertia of moving bodies"),
        (robot('<body name="a">\n<geom class="no" size=".1"/></body>'), "robot.xml:2: no default class `no`\nhint: if another file includes this one"),
        (robot('<body name="a"><geom apirate="9" size=".1"/></body>'), "no longer knows it"),
        (robot('<body name="a"><geom size=".1"/></body>\n<keyframe><key/></keyframe>'), "correct its spelling or its place; "),
        (robot('<body name="nan">\n<geom size=".1" pos="0 nan 0"/></body>'), "robot.xml:2: <geom> `pos` is `0 nan 0`: not a finite number"),
        (robot('<body name="inf">\n<joint name="j" range="-inf inf"/><geom size=".1"/></body>'), "robot.xml:2: <joint> `range` is `-inf inf`: not a finite number"),
        (robot('<body>\n<geom size=".1"/><geom type="hfield" hfield="h"/></body>', head='<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset>'), "robot.xml:2: the mass of a height field is not read"),
        (robot(ARM, head='\n<size nkey="2000000000"/>'), "robot.xml:2: <size> asks for 2000000000 keyframes"),
        (robot(ARM, head='\n<option timestep="0"/>'), "robot.xml:2: a timestep of 0 s simulates nothing"),
        (robot(ARM, head='<option timestep="1e-9"/>'), "a timestep of 1e-09 s simulates nothing"),
        (robot(ARM, head='<asset><mesh name="m" file="../../x.stl"/></asset>'), "file `../../x.stl` leads out of the source"),
        (robot(ARM, head='<asset><mesh name="m" file="/etc/x.stl"/></asset>'), "file `/etc/x.stl` cannot be followed"),
        (robot(ARM, head='<asset><mesh file="a.ply"/></asset>'), "is no STL, OBJ or MSH"),
        (robot(ARM, head='<include file="no.xml"/>'), "no file `arm/no.xml` to include"),
        (robot(ARM, head='<include file="../../../etc/passwd"/>'), "leads out of the source"),
        (robot(ARM, head='<include file="robot.xml"/>'), "is included twice"),
        (robot(ARM, head='<asset>\n<mesh name="m" vertex="0 1"/></asset>'), "robot.xml:2: mesh `m`"),
        (robot(ARM, head='<asset>\n<mesh name="m" vertex="0 0 0 1 0 0 0 2 0 0 0 3" face="0 1 9"/></asset>'), "robot.xml:2: mesh `m`"),
        (robot(ARM, head='<asset>\n<mesh name="m" vertex="0 0 0 1 0 0 0 2 0"/></asset>'), "robot.xml:2: mesh `m`: a hull needs 4 distinct points"),
        (robot(ARM, head='\n<option xmlns:d="relative" d:a="1"/>'), "robot.xml:2: MuJoCo does not compile it: Schema violation"),
        (robot(ARM, head='<asset>\n<mesh name="m"/></asset>'), "robot.xml:2: mesh `m`"),
        (robot(SCENE, ACTING, '<compiler settotalmass="9"/>'), "`settotalmass` spreads"),
        (robot(ARM, '<actuator>\n<plugin name="p" plugin="mujoco.pid" joint="j"/></actuator>', '<extension><plugin plugin="mujoco.pid"/></extension>'), "<plugin> is not read"),
        (robot('<replicate count="9999">' * 3 + '<body><geom size=".1"/></body>' + "</replicate>" * 3), "more than 100000 elements"),
        (robot('<body><geom size=".1"/><attach model="r" body="b" prefix="x"/></body>', head='<asset><model name="r" file="robot.xml"/></asset>'), "more than 4 deep"),
        (robot('<body name="a"><geom size=".1"/><body name="b"><joint name="j" ref="1"/><geom size=".1"/></body></body>', '<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon><actuator>\n<position tendon="t"/></actuator>'), "robot.xml:2: actuator `t` on a joint with `ref`"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_error_with_its_line(text: str, message: str, tmp_path: Path):
    assert message in refused(text, tmp_path)


def test_what_is_left_out_is_told(arm: Reading):
    told = {f.data["element"] for f in arm.findings if f.rule == "mjcf.dropped"}
    assert told == {"geom of worldbody", "visual"}
    assert {"mjcf.visible_collision", "mjcf.order"} <= arm.rules()


def test_terrain_of_many_boxes_is_one_finding(tmp_path: Path):
    text = robot('<geom type="box" size="1 1 .1"/>' * 9 + '<body name="a"><geom size=".1"/></body>')
    (lost,) = (f for f in read(text, tmp_path).findings if f.rule == "mjcf.dropped")
    assert lost.message.startswith("9 geoms of the world were left out, each a box: ")


# --- files and scenes -----------------------------------------------------------------------


def test_a_skin_is_left_out_without_its_file(tmp_path: Path):
    more = '<deformable><skin name="s" file="absent.skn"/></deformable>'
    assert "mjcf.dropped" in read(robot(ARM, more), tmp_path).rules()


def test_obstacles_beside_a_driven_robot_that_floats_are_left_out_aloud(tmp_path: Path):
    reading = read(robot(SCENE, ACTING), tmp_path)
    assert [b.name for b in reading.links.bodies] == ["dog", "leg"]
    assert reading.links.base == "floating"
    told = [f.subject for f in reading.findings if f.rule == "mjcf.scenery"]
    assert told == ["link table", "link hand", "link cube"]
    told = [f.message.split(" was")[0] for f in reading.findings if f.rule == "mjcf.dropped"]
    assert told == ["<weld> `w`", "<framepos> `p`"]
    key = reading.control.keyframes[0]
    assert (key.joints, key.base) == ((("knee", 0.5),), Pose((0.0, 0.0, 3.0)))
    assert reading.source.ctrl == (("home", (("m", 0.25),)),)
    assert reading.control.sensors == ()


def test_the_recipe_chooses_among_several_robots_in_one_world(tmp_path: Path):
    one = '<body name="{0}"><freejoint/><geom size=".1"/><body name="{0}2"><joint name="{0}"/><geom size=".1"/></body></body>\n'
    text = robot(one.format("ant") + one.format("bee"))
    message = refused(text, tmp_path / "1")
    assert "robot.xml:2: 2 robots in the world" in message
    assert "ant, bee" in message
    chosen = read(text, tmp_path / "2", body="bee")
    assert [b.name for b in chosen.links.bodies] == ["bee", "bee2"]
    with pytest.raises(SourceError, match="no body `bea`"):
        read(text, tmp_path / "3", body="bea")
