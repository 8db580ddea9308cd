"""Our MJCF is compared with the one that it was read from, and a lie in it is found."""

from __future__ import annotations

# ruff: noqa: E501 # one text per line reads better than wrapped XML
from pathlib import Path

import mujoco as engine
import pytest
from mjcfs import TET, Written, hard_arm, read, write
from robot_files import about, configured, edit, ranked, rules, run_step

from assetbuild.checks.mjcf_source import MjcfSource
from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets, ReadMeshes
from assetbuild.simulators import mujoco

FLOATING = """<mujoco model="r">
  <compiler angle="radian"/>
  <asset><mesh file="tet.obj" scale=".1 .1 .1" refpos=".1 .2 .3" refquat="1 .3 .2 .1"/></asset>
  <worldbody>
    <body name="trunk" pos="0 0 .5"><freejoint name="root"/>
      <geom name="hull" type="mesh" mesh="tet" euler=".1 .2 .3" solref="0.01 1"/>
      <camera name="view" pos="1 0 0" mode="trackcom"/>
      <site name="imu" pos="0 0 .1" group="3"/>
      <body name="leg" pos="0 .2 0"><joint name="hip" axis="0 1 0" range="-1 1" limited="true"/>
        <geom name="foot" size=".05" condim="6" friction="1.2 .01 .001"/>
        <body name="toe" pos="0 0 -.1"><joint name="bend" type="slide"/><geom size=".02"/></body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="m" joint="hip" kp="20" kv="1" forcerange="-5 5"/>
    <general name="g" joint="bend" dyntype="filter" dynprm="0.1" gaintype="affine" gainprm="10 1"/>
  </actuator>
  <sensor><gyro name="w" site="imu"/><accelerometer name="a" site="imu"/>
    <framezaxis name="up" objtype="body" objname="world" reftype="site" refname="imu"/>
    <subtreeangmom name="L" body="trunk"/><actuatorfrc name="f" actuator="m"/></sensor>
  <keyframe><key name="home" qpos="0 0 .4 1 0 0 0 .3 .01" ctrl="0.2 0.5"/></keyframe>
</mujoco>"""
FAR = FLOATING.replace(
    "</worldbody>", '<camera name="far" pos="0 -2 1" mode="trackcom" target="leg"/></worldbody>'
)


def built(text: str, folder: Path, mesh: str = TET, **recipe: object) -> Written:
    """text: "" for the hard arm."""
    made = read(text, folder / "read", tet_obj=mesh) if text else hard_arm(folder / "read")
    return write(made, folder / "out", **recipe)


def compared(written: Written, **fields: object) -> list[Finding]:
    out = written.inputs.parent / f"check{len(list(written.inputs.parent.iterdir()))}"
    return run_step(MjcfSource(robot="robot", **fields), written.inputs, out)  # type: ignore[arg-type] # fields of the test's choice


def proved(written: Written) -> list[Finding]:
    """What the reader of facts says of the MJCF beside the robot."""
    run_step(ReadMeshes(), written.inputs, written.inputs)
    run_step(MeasureAssets(), written.inputs, written.inputs)
    check = configured(MjcfFacts, source={"path": ".", "mjcf": "a.xml"})
    return run_step(check, written.inputs, written.inputs.parent / "proof")


def slivers(share: float, count: int) -> str:
    """A tetrahedron with needles whose short edge is a share of the longest edge, 3.6 m."""
    file = TET
    for number in range(count):
        file += f"v {number / 50!r} 0 0\nv {number / 50!r} {share * 3.6!r} 0\nv 1 1 1\n"
        file += "f -3 -2 -1\n"
    return file


def move_first_corner(written: Written, metres: float) -> None:
    """Along y, in the mesh of the bundle."""
    (mesh,) = (written.xml.parent / "assets").glob("*.obj")
    lines = mesh.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("v "))
    x, y, z = map(float, lines[at].split()[1:])
    lines[at] = f"v {x!r} {y + metres!r} {z!r}"
    mesh.write_text("\n".join(lines) + "\n")


def test_a_vertex_that_moved_is_a_difference_among_thin_triangles(tmp_path: Path):
    written = built(FLOATING, tmp_path, slivers(1e-6, 20))
    move_first_corner(written, 1e-4)
    assert {"equal.source.area", "equal.source.mean_corner"} <= rules(compared(written))


EVEN = """v 1 0 0\nv -1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1
f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n"""
"""An octahedron about its origin."""


@pytest.mark.parametrize(("moved_m", "is_found"), [(1e-9, False), (1e-4, True)])
def test_rounding_of_a_centred_mesh_passes(moved_m: float, is_found: bool, tmp_path: Path):
    """Its mean corner is nearly 0: what may differ is a share of the mesh's size, not of that."""
    centred = FLOATING.replace('refpos=".1 .2 .3" refquat="1 .3 .2 .1"', "")
    written = built(centred, tmp_path, EVEN)
    move_first_corner(written, moved_m)
    assert bool(compared(written)) == is_found


GREY = """<mujoco><worldbody><body name="a"><geom size=".1"/><geom name="g" size=".2"
  rgba=".5 .5 .5 1" contype="0" conaffinity="0" group="2"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("exclude", "stays"),
    [
        ("", False),
        ('<exclude body1="trunk" body2="shank"/><exclude body1="trunk" body2="foot"/>', False),
        ('<exclude body1="trunk" body2="shank"/>', True),
        ('<exclude body1="trunk" body2="foot"/>', True),
    ],
)
def test_a_foot_without_mass_touches_what_it_touches_in_the_source(
    exclude: str, stays: bool, tmp_path: Path
):
    text = f"""<mujoco><worldbody><body name="trunk"><freejoint/><geom size=".1"/>
    <body name="thigh"><joint name="hip"/><geom size=".1"/>
    <body name="shank"><joint name="knee"/><geom size=".1"/>
    <body name="foot" pos="0 0 -.3"><geom size=".03" mass="0"/></body></body></body></body>
    </worldbody><contact>{exclude}</contact></mujoco>"""
    written = built(text, tmp_path)
    assert ('<body name="foot"' in written.xml.read_text()) is stays
    assert compared(written) == []


RICH = """<mujoco><option solver="CG" iterations="7"/><asset><material name="gold"/></asset><worldbody>
  <body name="base"><geom size=".1"/>
    <body name="arm" gravcomp="0.5"><joint name="turn" pos="0 .1 0" solreflimit=".01 1" ref=".2"
      range="-40 40" axis="0 1 0"/><joint name="lift" type="slide" pos="0 .1 .1"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 .3" size=".02" solmix="2" rgba="0 0 1 1"/>
      <geom name="trim" size=".03" material="gold" rgba="1 0 0 1" contype="0" conaffinity="0"
        group="2"/>
      <body name="plate" pos="0 0 .3"><site name="hook" pos="0 0 .1"/>
        <camera name="eye" mode="targetbody" target="wheel"/><camera name="lens"
        sensorsize=".004 .002" focal=".002 .002" resolution="64 32"/></body>
      <body name="mass" pos=".1 0 0" euler="0 30 0"><geom size=".05"/></body></body>
    <body name="wheel" pos=".3 0 0"><joint name="spin"/><geom name="rim" size=".04"/>
      <site name="side" group="2"/></body></body>
</worldbody>
<contact><exclude body1="arm" body2="wheel"/></contact>
<equality><connect name="pin" body1="arm" body2="wheel" anchor="0 0 .1" active="false"/></equality>
<tendon><fixed name="cable"><joint joint="lift" coef="2"/><joint joint="spin" coef="-1"/></fixed>
  <spatial name="rope"><site site="hook"/><geom geom="rim" sidesite="side"/><site site="hook"/>
    <pulley divisor="2"/><site site="hook"/><site site="side"/></spatial>
</tendon>
<actuator><motor name="pull" tendon="cable" ctrlrange="-1 1"/>
  <position name="aim" joint="turn" kp="9"/></actuator>
<sensor><tendonpos name="slack" tendon="cable"/><framepos name="p" objtype="site" objname="hook"/>
</sensor>
<keyframe><key name="home" qpos=".3 .01 .1" ctrl=".5 .3"/></keyframe></mujoco>"""


def fitted(kind: str) -> str:
    """The floating robot, whose hull is a shape that MuJoCo fits to the mesh."""
    fit = f'type="{kind}" mesh="tet" fitscale="1.1"'
    return FLOATING.replace('type="mesh" mesh="tet"', fit)


NAMED_AS_ITS_BODY = """<mujoco><worldbody><body name="a"><geom size=".1"/>
  <body name="tip" pos="0 0 1"><joint name="bend"/><geom name="ball" size=".1"/>
  <site name="tip" pos="0 {} 0" size=".02"/></body></body></worldbody>
  <sensor><force name="f" site="tip"/><framepos name="p" objtype="site" objname="tip"/>
  <framepos name="x" objtype="xbody" objname="tip"/></sensor></mujoco>"""
WALLED = """<mujoco><worldbody><geom name="wall" type="box" size=".1 .1 .1"/>
  <frame pos="1 0 0"><geom name="post" size=".1"/></frame>
  <body name="a"><joint name="slide" type="slide"/><geom name="g" size=".1"/></body>
  <body name="b" pos="0 2 0"><geom name="h" size=".1"/></body></worldbody></mujoco>"""
SEEN_CLOSE = """<mujoco><visual><map znear=".003"/></visual><worldbody><body name="a">
  <geom name="g" size=".1"/><camera name="eye"/></body></worldbody></mujoco>"""
CLOSE = """<mujoco><worldbody><body><joint/>
  <inertial pos="0 0 .1" quat="1 0 0 .2" mass="1" diaginertia=".003 .002 .001"/>
  <geom name="g" type="capsule" size=".02 .05" pos="0 0 .1" quat="1 0 2e-7 .2"/>
</body></worldbody></mujoco>"""
"""MuJoCo's compiler gives the geom the frame of the inertia, 4e-7 rad away."""
WEIGHTLESS = FLOATING.replace(
    "<asset>", '<option><flag gravity="disable" contact="disable"/></option><asset>', 1
)
BUOY = """<mujoco><default><joint damping=".5" armature=".1" margin=".01" stiffness="2"/></default>
  <worldbody>
  <body pos="0 0 1"><joint type="free" frictionloss=".2"/><geom size=".1"/>
    <body><joint axis="0 1 0"/><geom size=".05" pos="0 0 .2"/></body></body>
</worldbody></mujoco>"""
"""A class gives a free joint damping and a spring as it does hinges; its margin means nothing."""
CART = """<mujoco><worldbody>
  <body name="base"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide"
    axis="0 1 0"/><joint name="turn"/>
    <body name="chassis" pos="0 0 .1"><geom size=".2"/></body>
    <body name="mast"><joint name="lift" type="slide"/><geom size=".1"/></body></body>
</worldbody></mujoco>"""
LOCKED = """<mujoco><worldbody><body><geom size=".1"/><body pos="0 0 .2">
  <joint name="turn" ref=".3" axis="0 1 0"/><geom size=".05"/></body></body></worldbody>
  <equality><joint joint1="turn" polycoef=".1 0 0 0 0"/></equality></mujoco>"""
BOUND = """<mujoco><compiler boundmass=".01" boundinertia=".0001"/><worldbody>
  <body name="arm" pos="0 0 1"><joint name="turn"/><geom size=".1"/></body></worldbody></mujoco>"""
FISH = """<mujoco><option density="1000"/><worldbody><body name="a"><freejoint/>
  <geom name="g" type="ellipsoid" size=".1 .05 .03"/><body name="fin"><joint name="flap"/>
  <geom name="f" type="box" size=".05 .02 .01" fluidshape="ellipsoid"/></body></body></worldbody>
</mujoco>"""
FACES = TET.split("f ")
PAINTED = FACES[0] + "usemtl red\n" + "usemtl blue\n".join(f"f {face}" for face in FACES[1:])
"""MuJoCo reads no material of an OBJ: cut into pieces, each would have a hull of its own."""
SKEW = """v 0 0 0\nv 2 0 0\nv 3 1 .5\nv 2 2 0\nv 0 2 0\nv 1 1 2
f 5 4 3 2 1\nf 1 2 6\nf 2 3 6\nf 3 4 6\nf 4 5 6\nf 5 1 6\n"""
FOCUSED = """<mujoco><worldbody><camera name="c" mode="targetbody" target="focus" fovy="70"/>
  <body name="a"><geom size=".1"/><body name="focus" pos="0 0 1"/></body></worldbody></mujoco>"""
MUSCLE = """<mujoco><worldbody><site name="anchor" pos="0 0 2"/>
  <body name="a">{free}<geom size=".1"/><site name="s"/></body></worldbody>
  <tendon><spatial name="t"><site site="anchor"/><site site="s"/></spatial></tendon>
  <actuator><muscle name="m" tendon="t" lengthrange="1 2"/></actuator></mujoco>"""
DRIVEN = """<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size=".1"/>
<body name="upper"><joint name="j" range="-1 1" limited="true" {joint}/><geom size=".1"/>
<site name="s"/><body name="lower" pos=".3 0 0"><joint name="k" type="slide" {other}/><geom size=".1"/>
<site name="tip"/></body></body></body></worldbody>{more}</mujoco>"""
ROPE = (
    '<tendon><spatial name="t"><site site="s"/><site site="tip"/></spatial></tendon>'
    '<actuator><motor name="m" joint="j"/></actuator>'
)
TEXTS = {
    "force of a joint's actuators": (ROPE + '<sensor><jointactuatorfrc joint="j"/></sensor>', "", ""),
    "force of a tendon's actuators": (ROPE + '<sensor><tendonactuatorfrc tendon="t"/></sensor>', "", ""),
    "rangefinder": ('<sensor><rangefinder site="s"/></sensor>', "", ""),
    "range of a joint's force": (ROPE, 'actuatorfrcrange="-7 9"', ""),
    "no range of a joint's force": (ROPE, 'actuatorfrcrange="-7 9" actuatorfrclimited="false"', ""),
    "gravity by the actuator": (ROPE, 'actuatorgravcomp="true" margin=".1"', ""),
    "weld": ('<equality><weld body1="base" body2="lower"/></equality>', 'pos=".1 0 0"', 'pos="0 .1 0"'),
    "weld by pose": ('<equality><weld body1="lower" body2="upper" relpose=".1 0 0 0 -1 0 0" anchor=".1 0 0"/></equality>', 'pos=".1 0 0"', 'pos="0 .1 0" ref=".2"'),
    "muscle": (ROPE.replace("motor", "muscle").replace('joint="j"', 'tendon="t"'), "", 'axis="1 0 0" range="-.1 .1" limited="true"'),
    "muscle of a joint": ('<actuator><muscle joint="j" lengthrange=".1 1"/></actuator>', "", ""),
    "two drives of a joint": ('<actuator><motor name="a" joint="j" ctrlrange="0 1" ctrllimited="true"/><motor name="b" joint="j"/></actuator>', "", ""),
    "user numbers": ('<actuator><motor joint="j" user="1 2"/></actuator>', "", ""),
    "geared motor at ref": ('<actuator><motor joint="j" gear="3"/></actuator>', 'ref=".2"', ""),
    "gain": ('<actuator><general joint="j" gainprm="20" ctrlrange="-1 2" ctrllimited="true"/></actuator>', "", ""),
    "gain behind a filter": ('<actuator><general joint="j" gainprm="20" ctrlrange="-1 1" ctrllimited="true" dyntype="filter" dynprm=".1"/></actuator>', "", ""),
    "keyframe without commands": ('<actuator><position joint="j" kp="3"/></actuator><keyframe><key name="k" qpos=".3 .1"/></keyframe>', "", ""),
    "keyframes without names": (ROPE.replace('joint="j"', 'tendon="t"') + '<size nkey="2"/><keyframe><key name="k" qpos=".3 .1"/></keyframe>', "", ""),
    "ranges that limit nothing": (ROPE.replace('joint="j"', 'tendon="t" forcerange="-2 2" forcelimited="false" ctrlrange="-1 1" ctrllimited="false"'), "", ""),
    "general motor with a range of forces": ('<actuator><general joint="j" forcerange="-8 8" forcelimited="true"/></actuator>', "", ""),
    "fixed tendon over a joint with ref": ('<tendon><fixed name="t" range="-1 2" limited="true" stiffness="3" springlength=".3"><joint joint="j" coef="2"/><joint joint="k" coef="-1"/></fixed></tendon><equality><tendon tendon1="t"/></equality><actuator><motor tendon="t"/></actuator><sensor><tendonpos tendon="t"/></sensor>', 'ref=".2"', 'ref="-.3"'),
    "fixed tendon with a spring at rest": ('<tendon><fixed name="t" stiffness="3"><joint joint="j" coef="2"/></fixed></tendon>', 'ref=".2"', ""),
    "quadrotor": ('<actuator><motor site="s" gear="0 0 1 0 0 .1"/></actuator>', "", ""),
    "adhesion": ('<actuator><adhesion body="lower" ctrlrange="0 1" gain="2"/></actuator>', "", ""),
}  # fmt: skip
SAME = {
    "floating": (FLOATING, TET),
    "a camera of the world that states a target in vain": (FAR, TET),
    "an ellipsoid of a mesh": (fitted("ellipsoid"), TET),
    "a capsule of a mesh": (fitted("capsule"), TET),
    "a box of a mesh": (fitted("box"), TET),
    # MuJoCo turns both meshes in float32, which makes a short edge shorter in one of them.
    "very thin triangles": (FLOATING, slivers(9.99e-7, 20)),
    "thin triangles": (FLOATING, slivers(1.0001e-6, 20)),
    "a mesh with materials": (FLOATING, PAINTED),
    "a polygon whose corners lie in no plane": (FLOATING, SKEW),
    "a site that is called as its body": (NAMED_AS_ITS_BODY.format(".1"), TET),
    "the same in its origin": (NAMED_AS_ITS_BODY.format("0"), TET),
    "walls of the world, whose density weighs nothing": (WALLED, TET),
    "a camera, and a near plane of all cameras": (SEEN_CLOSE, TET),
    "frames that are one for MuJoCo": (CLOSE, TET),
    "frames, rests and what only MJCF says": (RICH, TET),
    "a geom that states the grey of MuJoCo": (GREY, TET),
    "no gravity by a flag": (WEIGHTLESS, TET),
    "what brakes a free joint": (BUOY, TET),
    "a joint that an equality locks beside its `ref`": (LOCKED, TET),
    "the world, to which the compiler would give a least mass": (BOUND, TET),
    "a fin that collides, is drawn and is braked by the water": (FISH, TET),
    "three joints of a base that weighs by its fixed bodies alone": (CART, TET),
    "a camera whose target is no body": (FOCUSED, TET),
    "a muscle to the world": (MUSCLE.format(free=""), TET),
    "a muscle to a hinge": (MUSCLE.format(free="<joint/>"), TET),
    "a muscle to a floating body": (MUSCLE.format(free="<freejoint/>"), TET),
    "a hard arm": ("", TET),
} | {what: (DRIVEN.format(more=m, joint=j, other=o), TET) for what, (m, j, o) in TEXTS.items()}


@pytest.mark.parametrize("what", SAME)
def test_it_comes_out_as_it_went_in(what: str, tmp_path: Path):
    written = built(SAME[what][0], tmp_path, SAME[what][1])
    assert compared(written) == []
    assert proved(written) == []


def test_objects_of_a_mesh_that_mujoco_leaves_out_are_told(tmp_path: Path):
    """MuJoCo's reader takes the faces of the first object; the bundle has those of all."""
    other = TET.replace("v 0", "v 4").replace("f", "f -4 -2 -3\n#")
    found = compared(built(FLOATING, tmp_path, f"o a\n{TET}o b\n{other}"))
    assert ranked(found) == [("mjcf.first_object", "info")]


@pytest.mark.parametrize(
    ("text", "old", "new", "subject", "rule"),
    [
        (FLOATING, 'mass="', 'mass="1', "body root", "mass"),
        (FLOATING, 'range="-1 1"', 'range="-1 1.001"', "joint hip", "upper"),
        (FLOATING, 'condim="6"', 'condim="4"', "shape foot", "condim"),
        (FLOATING, 'kp="20"', 'kp="20.001"', "joint hip", "kp"),
        (FLOATING, '<gyro name="w"', '<gyro name="v"', "sensor w", "missing"),
        (FLOATING, 'name="imu" pos="0 0 0.1"', 'name="imu" pos="0 0 0.11"', "frame imu", "pose"),
        (FLOATING, 'integrator="Euler"', 'integrator="RK4"', "simulation", "integrator"),
        (FLOATING, 'ctrl="0.2 0.5"', 'ctrl="0.2 0.6"', "keyframe home/bend", "target"),
        (FLOATING, 'mode="trackcom" pos="1 0 0"', 'mode="trackcom" pos="1 0 0.01"', "camera view",
         "pose"),
        (RICH, 'solreflimit=".01 1"', "", "joint turn", "solref"),
        (RICH, 'active="false"', "", "loop pin", "extra"),
        (RICH, 'rgba="0 0 1 1"', 'rgba="0 1 0 1"', "shape rod", "rgba"),
        (RICH, 'coef="2"', 'coef="3"', "tendon cable", "path"),
        (RICH, 'sidesite="side"', "", "tendon rope", "path"),
        (RICH, 'target="wheel"', 'target="arm"', "camera eye", "target"),
        (RICH, 'sensorsize=".004 .002"', 'sensorsize=".004 .001"', "camera lens", "sensorsize"),
        (RICH, 'objname="hook"', 'objname="plate"', "sensor p", "object"),
        (RICH, '<exclude body1="arm" body2="wheel"', '<exclude body1="base" body2="wheel"',
         "pair rim rod", "touches"),
        (RICH, 'ctrlrange="-1 1"', 'ctrlrange="-1 2"', "actuator pull", "ctrlrange"),
        (FLOATING, "<mujoco", "<mujoco><mujoco", "robot", "load"),
        (GREY, 'rgba="0.5 0.5 0.5 1"', 'rgba="0.5 0.5 0.6 1"', "shape g", "rgba"),
        (WEIGHTLESS, 'gravity="0 0 0"', 'gravity="0 0 -1"', "simulation", "gravity"),
        (BUOY, 'damping="0.5" armature', 'damping="0.4" armature', "joint body_joint", "damping"),
    ],
)  # fmt: skip
def test_every_lie_is_found(text: str, old: str, new: str, subject: str, rule: str, tmp_path: Path):
    written = built(text, tmp_path)
    edit(written.xml, (old, new))
    found = about(compared(written))
    assert (f"equal.source.{rule}", subject) in found, found
    assert rule != "load" or found == {("equal.source.load", "robot")}


def test_what_the_recipe_says_itself_is_not_compared(tmp_path: Path):
    rows = [
        {"joints": "hip", "model": "pd", "kp": 7, "kd": 1, "effort": 9},
        {"joints": "bend", "model": "passive"},
    ]
    recipe = {"actuators": rows, "simulation": {"timestep": 0.001}, "mjcf": {"cone": "elliptic"}}
    written = built(FLOATING, tmp_path, **recipe)
    check = configured(MjcfSource, source={"path": ".", "mjcf": "r.xml"}, **recipe)
    assert isinstance(check, MjcfSource)
    assert {"actuators", "timestep", "cone"} <= set(check.stated)
    told = {finding.rule for finding in compared(written, stated=check.stated)}
    assert told == set()
    assert written.control.by_joint["hip"].kp == 7
    assert 'cone="elliptic"' in written.xml.read_text()
    assert 'timestep="0.001"' in written.xml.read_text()
    assert configured(MjcfSource) is None, "no MJCF as a source"


WALKER = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <body name="torso" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0"/>
    <joint name="z" type="slide" axis="0 0 1"/><geom name="{}" size=".1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("name", ["ball", "ground"])
def test_a_robot_on_the_floor_of_its_source_gets_no_second_one(name: str, tmp_path: Path):
    """Planar walkers hang on the world by slides: its floor is part of them."""
    written = built(WALKER.format(name), tmp_path)
    model = mujoco.load(written.xml.with_name("scene.xml")).model
    assert list(model.geom_type).count(0) == 1


def test_gravity_that_a_flag_switches_off_is_none_unless_the_recipe_wants_some(tmp_path: Path):
    assert built(WEIGHTLESS, tmp_path / "none").control.simulation.gravity == (0.0, 0.0, 0.0)
    moon = built(WEIGHTLESS, tmp_path / "moon", simulation={"gravity": [0, 0, -1.62]})
    option = mujoco.load(moon.xml).model.opt
    gravity = engine.mjtDisableBit.mjDSBL_GRAVITY
    assert option.gravity[2] == -1.62 and not option.disableflags & gravity


def test_drives_that_only_mjcf_holds_are_no_missing_table(tmp_path: Path):
    muscle = '<actuator><muscle joint="hip" lengthrange="-1 1"/></actuator></mujoco>'
    text = FLOATING[: FLOATING.index("<actuator>")] + muscle
    written = built(text, tmp_path)
    (told,) = [f for f in written.findings if f.rule == "actuator.none"]
    assert "the source's drives (1) exist in the MJCF alone" in told.message
    assert told.severity == "warning"


@pytest.mark.parametrize(("memory", "kept"), [("64M", 2**26), ("1M", None)])
def test_more_memory_than_mujoco_takes_is_kept(memory: str, kept: int | None, tmp_path: Path):
    text = FLOATING.replace("<worldbody>", f'<size memory="{memory}"/><worldbody>')
    written = built(text, tmp_path)
    assert ("<size" in written.xml.read_text()) is (kept is not None)
    if kept is not None:
        assert int(mujoco.load(written.xml).model.narena) == kept
    assert compared(written) == []


def test_geoms_that_collide_in_the_group_of_visual_ones_are_no_difference(tmp_path: Path):
    text = """<mujoco><worldbody><body name="a"><geom name="g" group="2" size=".1" priority="1"
    friction=".7 .005 .001" condim="1" solref=".015 1" solimp=".9 .9 .003 .5 2"/></body></worldbody>
    </mujoco>"""
    made = built(text, tmp_path)
    assert proved(made) == []
    edit(made.xml, ('condim="1"', 'condim="3"'))
    assert rules(proved(made)) == {"equal.mjcf.condim"}
