"""`init` on an MJCF: a short recipe that builds, since the file says most itself."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from hands import COUPLED, PINCHER, robot
from mjcfs import ROBOTS, TET
from proposals import proposed

from assetbuild.cli.check import check
from assetbuild.errors import SourceError
from assetbuild.init.mjcf import robot_name

LEG = '<mujoco model="one leg"><compiler meshdir="../meshes"/><asset><mesh file="a.obj"/></asset><worldbody><body name="trunk"><freejoint/><geom size=".1"/><geom type="mesh" mesh="a" contype="0" conaffinity="0"/></body></worldbody></mujoco>'  # noqa: E501 # one robot per line


def test_the_recipe_says_what_it_takes_from_the_source(tmp_path: Path):
    made = proposed(ROBOTS / "hard_arm.xml", tmp_path)
    recipe, text = made.recipe, made.text
    assert recipe.source.mjcf == "hard_arm.xml"
    assert recipe.collision.default.method == "keep"
    assert "base" not in recipe.model_fields_set, "the source says it"
    assert "# its keyframes: home" in text
    assert "# Drives of the source: " in text
    assert not recipe.actuators


@pytest.mark.parametrize("name", ["arm.mjcf", "arm.XML", "arm"])
def test_it_is_known_by_its_root_element_whatever_its_name(name: str, tmp_path: Path):
    (tmp_path / name).write_text(LEG.replace("../meshes", "."))
    (tmp_path / "a.obj").write_text(TET)
    assert proposed(tmp_path / name, tmp_path).recipe.source.mjcf == name
    assert not [f.rule for f in check(tmp_path / "recipe.yaml") if f.severity == "error"]


@pytest.mark.parametrize("folder", ["/home/author/robot", "parts"])
def test_meshes_that_are_not_there_are_counted_and_sought(folder: str, tmp_path: Path):
    """`meshdir` is often a folder of the author's machine."""
    text = LEG.replace("../meshes", folder).replace("<mesh ", '<mesh file="b.obj"/><mesh ')
    (tmp_path / "leg.xml").write_text(text)
    (tmp_path / "cad").mkdir()
    (tmp_path / "cad/a.obj").write_text(TET)
    with pytest.raises(SourceError) as error:
        proposed(tmp_path / "leg.xml", tmp_path)
    assert error.value.message == f"no file `{folder}/a.obj` (and 1 more: `{folder}/b.obj`)"
    assert error.value.hint == "is `cad/a.obj` meant? Correct `file` or `meshdir` in the MJCF"


@pytest.mark.parametrize("name", ["scene", "scene_mjx", "models"])
def test_a_robot_that_is_called_like_a_file_of_the_bundle_is_called_like_its_folder(
    tmp_path: Path, name: str
):
    folder = tmp_path / "one_leg"
    folder.mkdir()
    (folder / "a.obj").write_text(TET)
    text = LEG.replace('"one leg"', f'"{name}"').replace("../meshes", ".")
    (folder / "scene.xml").write_text(text)
    assert proposed(folder / "scene.xml", tmp_path).recipe.robot == "one_leg"


def test_files_that_it_includes_from_a_parent_folder_are_found(tmp_path: Path):
    scene = '<mujoco><include file="../leg.xml"/></mujoco>'
    (tmp_path / "robot/cell").mkdir(parents=True)
    (tmp_path / "robot/cell/scene.xml").write_text(scene)
    (tmp_path / "robot/leg.xml").write_text(LEG.replace("../meshes", ".."))
    (tmp_path / "robot/a.obj").write_text(TET)
    source = proposed(tmp_path / "robot/cell/scene.xml", tmp_path).recipe.source
    assert (source.path, source.mjcf) == ("robot", "cell/scene.xml")
    assert not [f.rule for f in check(tmp_path / "recipe.yaml") if f.severity == "error"]


def test_a_file_that_an_include_finds_beside_itself_is_found(tmp_path: Path):
    """`robot/dog.xml` includes `leg.xml`, which MuJoCo misses in `cell` and finds in `robot`."""
    for name, inside in (("cell/scene", "../robot/dog.xml"), ("robot/dog", "leg.xml")):
        (tmp_path / name).parent.mkdir()
        (tmp_path / f"{name}.xml").write_text(f'<mujoco><include file="{inside}"/></mujoco>')
    (tmp_path / "robot/leg.xml").write_text(LEG.replace("../meshes", "../robot"))
    (tmp_path / "robot/a.obj").write_text(TET)
    source = proposed(tmp_path / "cell/scene.xml", tmp_path).recipe.source
    assert (source.path, source.mjcf) == (".", "cell/scene.xml")
    assert not [f.rule for f in check(tmp_path / "recipe.yaml") if f.severity == "error"]


LIMB = '<geom size=".1"/><body><joint/><geom size=".1"/></body>'


def test_of_several_robots_in_one_world_the_first_is_proposed(tmp_path: Path):
    ant = f'<body name="ant"><freejoint/>{LIMB}</body><body name="bee"><freejoint/>{LIMB}</body>'
    made = proposed(f"<mujoco><worldbody>{ant}</worldbody></mujoco>", tmp_path)
    assert made.recipe.source.body == "ant"
    assert "# or bee: one recipe builds one robot" in made.text


POST = '<body name="post"><geom size=".1"/></body>'
BALL = '<body name="ball"><freejoint/><geom size=".1"/></body>'
DRONE = '<body name="drone"><freejoint/><geom size=".1"/><body><geom size=".1"/></body></body>'


@pytest.mark.parametrize(("world", "body"), [(POST + BALL + DRONE, "drone"), (POST + DRONE, None)])
def test_where_nothing_is_driven_what_floats_is_the_robot(
    world: str, body: str | None, tmp_path: Path
):
    made = proposed(f"<mujoco><worldbody>{world}</worldbody></mujoco>", tmp_path)
    assert made.recipe.source.body == body
    assert "2 bodies" in made.text and "base: floating" in made.text


FINGER = '<mujoco model="finger"><option timestep="0.002"/><worldbody><body name="palm"><geom size=".04" mass=".3"/><body name="near" pos="0 0 .05"><joint name="knuckle" axis="0 1 0" range="0 90" armature="0.0003"/><geom size=".01" mass=".02"/></body></body></worldbody></mujoco>'  # noqa: E501 # one robot per line


def test_a_source_that_drives_nothing_gets_guessed_drives_with_its_own_rotors(tmp_path: Path):
    """A robot that nothing drives is never ready; mjlab's are driven from Python."""
    made = proposed(FINGER, tmp_path)
    (row,) = made.recipe.actuators
    assert (row.joints, row.model, row.guessed, row.armature) == ("knuckle", "pd", True, 0.0003)
    assert "The source drives no joint" in made.text


def dog(more: str = "") -> str:
    """Four legs of two links of 0.2 m, whose shanks end in a ball. more: after its world."""
    shape = '<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" contype="0" conaffinity="0"/>'
    ball = '<geom type="sphere" pos="0 0 -0.2" size="0.02"/>'
    legs = "".join(
        f"""<body name="{name}_thigh" pos="{x} {y} 0">
        <joint name="{name}_hip" axis="0 1 0" range="-1 2"/>
        <inertial mass="0.5" pos="0 0 -0.1" diaginertia="0.002 0.002 0.0002"/>{shape}
        <body name="{name}_shank" pos="0 0 -0.2">
        <joint name="{name}_knee" axis="0 1 0" range="-2.5 -0.5"/>
        <inertial mass="0.2" pos="0 0 -0.1" diaginertia="0.001 0.001 0.0001"/>{ball}
        </body></body>"""
        for name, x, y in (("a", 0.2, 0.1), ("b", 0.2, -0.1), ("c", -0.2, 0.1), ("d", -0.2, -0.1))
    )
    return f"""<mujoco model="dog"><compiler angle="radian"/><worldbody>
    <body name="trunk" pos="0 0 0.5">
    <freejoint/><inertial mass="5" pos="0 0 0" diaginertia="0.05 0.1 0.1"/>
    <geom type="box" size="0.2 0.1 0.05"/>{legs}</body></worldbody>{more}</mujoco>"""


def test_a_shank_without_a_foot_of_its_own_ends_at_its_ball(tmp_path: Path):
    """The ball, not the knee, belongs below the hip."""
    joints = proposed(dog(), tmp_path).recipe.keyframes["home"].joints
    hip, knee = (next(v for k, v in joints.items() if k.endswith(end)) for end in ("hip", "knee"))
    assert hip == pytest.approx(-knee / 2.0, abs=0.02)


@pytest.mark.parametrize("drive", ['<position joint="{}" kp="80" kv="4"/>', '<motor joint="{}"/>'])
@pytest.mark.parametrize(
    ("name", "height", "raised"),
    [
        ("home", 0.371, False),
        ("home", 0.35, True),
        ("home", 0.4, True),
        ("standing", 0.35, True),  # a build starts there, too
        ("jumping", 0.4, False),
    ],
)
def test_a_home_that_is_not_on_the_floor_is_put_there(
    name: str, height: float, raised: bool, drive: str, tmp_path: Path
):
    """The legs reach 2 * 0.2 cos(0.5) + 0.02 m below the trunk, and a build would not be ready."""
    legs = [f"{leg}_{joint}" for leg in "abcd" for joint in ("hip", "knee")]
    drives, pose = "".join(map(drive.format, legs)), "0.5 -1 " * 4
    home = f'<key name="{name}" qpos="0 0 {height} 1 0 0 0 {pose}" ctrl="{pose}"/>'
    more = f"<actuator>{drives}</actuator><keyframe>{home}</keyframe>"
    made = proposed(dog(more), tmp_path)
    keyframes = {name: (key.base, key.joints) for name, key in made.recipe.keyframes.items()}
    assert keyframes == ({name: ("on_ground", {})} if raised else {})
    assert ("mm inside the floor" in made.text) == (height < 0.37)


@pytest.mark.parametrize(("option", "hangs"), [("", True), ('gravity="0 0 0"', False)])
def test_weak_drives_turn_home_only_where_there_is_weight(option: str, hangs: bool, tmp_path: Path):
    """The arm of Gymnasium's Pusher: 40 N m against motors of 2 N m, without gravity."""
    text = f"""<mujoco model="arm"><compiler angle="radian"/><option {option}/><worldbody>
    <body name="arm" pos="0 0 2"><joint name="lift" axis="0 1 0" range="-1.6 1.6"/>
    <geom type="capsule" fromto="0 0 0 1 0 0" size=".05"/></body></worldbody>
    <actuator><motor joint="lift" ctrlrange="-2 2"/></actuator></mujoco>"""
    assert bool(proposed(text, tmp_path).recipe.keyframes["home"].joints) == hangs


@pytest.mark.parametrize(("springs", "guessed"), [(3, False), (1, True)])
def test_a_mechanism_that_springs_move_gets_no_guessed_drives(
    springs: int, guessed: bool, tmp_path: Path
):
    """A soft finger: three joints in a row, of which the outer ones have springs."""
    inner = ""
    for number in range(3):
        spring = f'stiffness="{2.0 * (number < springs)}"'
        inner = f"""<body name="b{number}" pos="0 0 .1"><joint name="j{number}" axis="0 1 0"
        range="-1 1" {spring}/><geom type="capsule" fromto="0 0 0 0 0 .1" size=".01"/>
        {inner}</body>"""
    text = f'<mujoco><compiler angle="radian"/><worldbody>{inner}</worldbody></mujoco>'
    rows = proposed(text, tmp_path).recipe.actuators or ()
    assert any(row.guessed for row in rows) == guessed


@pytest.mark.parametrize("driven", [True, False])
def test_springs_are_proposed_as_usd_where_nothing_else_drives_the_joint(
    driven: bool, tmp_path: Path
):
    """A spring beside a drive has no place in a USD, which would move otherwise."""
    joint = '<joint name="j" axis="0 1 0" range="-1 1" stiffness="3"/>'
    below = '<body name="c" pos="0 0 1"><joint name="k" range="-1 1"/><geom size=".1"/></body>'
    body = f'<body name="b" pos="0 0 1">{joint}<geom size=".1"/>{below}</body>'
    driver = f'<position joint="{"j" if driven else "k"}" kp="50" kv="2" forcerange="-9 9"/>'
    made = proposed(of_bodies(body, f"<actuator>{driver}</actuator>"), tmp_path)
    assert made.recipe.targets == (("urdf", "mjcf") if driven else ALL)
    assert ("it cannot hold the springs of j" in made.text) == driven


ALL = ("urdf", "mjcf", "usd")


def of_bodies(bodies: str, more: str = "") -> str:
    return f'<mujoco><compiler angle="radian"/><worldbody>{bodies}</worldbody>{more}</mujoco>'


def test_a_root_that_weighs_by_a_fixed_body_alone_becomes_one_with_it(tmp_path: Path):
    """The build keeps the bodies of an MJCF, and PhysX would make up a mass for the root."""
    head = '<body name="head" pos="0 0 1"><geom size=".1"/></body>'
    foot = '<body name="foot"><geom size=".1"/></body>'
    leg = f'<body name="leg"><joint name="j"/><geom size=".1"/>{foot}</body>'
    pelvis = f'<body name="pelvis"><geom size=".1"/>{head}{leg}</body>'
    made = proposed(of_bodies(f'<body name="root"><freejoint/>{pelvis}</body>'), tmp_path)
    assert made.recipe.targets == ALL
    assert "kg, 3 bodies, 1 moving joint" in made.text, "the root, the leg and its foot"
    assert "fixed_joints: {merge: true, keep_bodies: [foot]}" in made.text
    assert "# root cannot be simulated alone" in made.text


def test_a_foot_that_touches_on_its_own_is_not_proposed_as_usd(tmp_path: Path):
    foot = '<body name="foot"><geom size=".03" mass="0"/></body>'
    shank = f'<body name="shank"><joint name="knee"/><geom size=".1"/>{foot}</body>'
    thigh = f'<body name="thigh"><joint name="hip"/><geom size=".1"/>{shank}</body>'
    exclude = '<contact><exclude body1="trunk" body2="shank"/></contact>'
    trunk = f'<body name="trunk"><freejoint/><geom size=".1"/>{thigh}</body>'
    made = proposed(of_bodies(trunk, exclude), tmp_path)
    assert made.recipe.targets == ("urdf", "mjcf")
    assert "foot has no mass, and is excluded from other pairs than shank" in made.text


def test_a_root_without_mass_and_marks_without_inertia_are_merged_at_once(tmp_path: Path):
    """onshape-to-robot marks a foot by a body of 1e-9 kg."""
    mark = '<body name="mark"><inertial pos="0 0 0" mass="1e-9" diaginertia="0 0 0"/></body>'
    leg = f'<body name="leg"><joint name="j"/><geom size=".1"/>{mark}</body>'
    trunk = f'<body name="trunk"><geom size=".1"/>{leg}</body>'
    made = proposed(of_bodies(f'<body name="root"><freejoint/>{trunk}</body>'), tmp_path)
    assert made.recipe.targets == ALL
    assert "# root, mark cannot be simulated alone" in made.text


def test_a_robot_without_a_usd_shares_no_mass(tmp_path: Path):
    """Water acts on the size of a body, which follows from its inertia: it feels moved mass."""
    joints = "".join(f'<joint name="{a}" axis="{v}"/>' for a, v in (("x", "1 0 0"), ("y", "0 1 0")))
    fin = f'<body name="fin" pos=".2 0 0">{joints}<geom size=".1"/></body>'
    body = f'<body name="b"><geom size=".1"/>{fin}</body>'
    for density, shares in (("0", True), ("1000", False)):
        made = proposed(of_bodies(body, f'<option density="{density}"/>'), tmp_path)
        assert ("share_mass" in made.text) == shares
        assert (made.recipe.targets == ALL) == shares


@pytest.mark.parametrize(("moment", "option", "proposed_too"), [
    ("1e-2", "", True), ("1e-2", '<option integrator="implicit"/>', False), ("1e-5", "", False),
])  # fmt: skip
def test_a_wheel_whose_inertia_is_repaired_is_integrated_implicitly(
    moment: str, option: str, proposed_too: bool, tmp_path: Path
):
    """Authors inflate an inertia until Euler bears the drive."""
    wheel = f"""<body name="wheel" pos="0 0 -.1"><joint name="spin" axis="0 1 0"/><inertial
    pos="0 0 0" mass=".05" diaginertia="{moment} {moment} {moment}"/><geom type="cylinder"
    size=".023 .004" euler="1.57 0 0"/></body>"""
    text = of_bodies(f'<body name="base"><freejoint/><geom size=".1"/>{wheel}</body>', option)
    drive = '<actuator><velocity joint="spin" kv="1"/></actuator></mujoco>'
    recipe = proposed(text.replace("</mujoco>", drive), tmp_path).recipe
    assert bool(recipe.edits) == (moment == "1e-2")
    assert ("integrator" in recipe.mjcf.model_fields_set) == proposed_too


@pytest.mark.parametrize(
    ("stated", "file", "called"),
    [
        ("go9 scene", "scene.xml", "go9"),
        ("scene", "scene_hexapod.xml", "hexapod"),
        ("scene", "hexapod/xmls/scene_flat_terrain.xml", "hexapod"),
        ("robot", "hexapod.xml", "hexapod"),  # a model without a name reads as `robot`
        ("scenery_bot", "scene.xml", "scenery_bot"),
        ("arm_model", "scene.xml", "arm_model"),
    ],
)
def test_a_scene_is_called_like_the_robot_in_it(
    stated: str, file: str, called: str, tmp_path: Path
):
    (tmp_path / "floor.xml").write_text("<mujoco><asset/></mujoco>")
    (tmp_path / "hexapod.xml").write_text(
        '<mujoco><worldbody><body name="b"/></worldbody></mujoco>'
    )
    if file == "scene.xml":
        text = '<mujoco><include file="floor.xml"/><include file="hexapod.xml"/></mujoco>'
        (tmp_path / file).write_text(text)
    assert robot_name(stated, tmp_path / file) == called


def test_a_gripper_without_contacts_of_its_own_gets_ones_that_hold(tmp_path: Path):
    """What the source says itself stays: a cone, or how a pad gives way."""
    text = robot(PINCHER, ["left"], tmp_path, COUPLED).read_text()
    bare = text.replace('cone="elliptic" impratio="50"', "")
    pad = 'size=".01 .005 .03"'
    for said, cone, pads in (
        (bare, "elliptic", True),
        (text, None, True),
        (bare.replace(pad, f'{pad} solref="0.01 1"'), "elliptic", False),
        (bare[: bare.index("<actuator>")] + "</mujoco>", "elliptic", True),
    ):
        recipe = proposed(said, tmp_path).recipe
        assert recipe.validate_.grip is not None
        assert recipe.mjcf.cone == cone
        assert bool(recipe.contact.links) == pads


@pytest.mark.parametrize(
    ("stated", "firm"), [('solref="0.005 1"', True), ('solref="0.005 1" solimp=".8 .9 .01"', False)]
)
def test_a_loop_of_a_hand_whose_impedance_nobody_states_is_stated_firmer(
    stated: str, firm: bool, tmp_path: Path
):
    """What the source says of it, its time constant, stays."""
    held = f"<connect body1='left' body2='palm' anchor='0 0 0' {stated}/></equality>"
    source = robot(PINCHER, ["left"], tmp_path, COUPLED.replace("</equality>", held))
    loops = proposed(source, tmp_path).recipe.loops
    assert [(row.name, row.solref, row.solimp[0]) for row in loops] == (
        [("left_connect", (0.005, 1.0), 0.999)] if firm else []
    )


LONE = """<mujoco><compiler angle="radian"/><worldbody><body name="torso"><geom size=".1" mass="9"/>
<body name="{name}" pos="0 0 .1"><joint name="{joint}" range="0 1.5"/><geom size=".02" mass=".1"/>
</body></body></worldbody><actuator><position joint="{joint}" kp="5" kv=".5" ctrlrange=".25 1.25"/>
</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("name", "joint", "is_hand"),
    [("left_hand", "elbow_yaw", False), ("arm", "lift", False), ("moving_jaw", "jaw", True)],
)
def test_a_lone_limb_is_no_hand_unless_it_is_called_like_one_that_presses(
    name: str, joint: str, is_hand: bool, tmp_path: Path
):
    """It starts where its drive can hold it: 0 is no command of it."""
    recipe = proposed(LONE.format(name=name, joint=joint), tmp_path).recipe
    assert bool(recipe.contact.links) == is_hand
    assert (recipe.validate_.grip is not None) == is_hand
    assert recipe.keyframes["home"].joints == {joint: 0.75}


def test_a_hand_of_which_nothing_collides_gets_no_surfaces(tmp_path: Path):
    seen = LONE.format(name="jaw", joint="jaw").replace(
        'mass=".1"', 'mass=".1" contype="0" conaffinity="0"'
    )
    assert "jaw" not in str(proposed(seen, tmp_path).recipe.contact.links)
    assert not [f.rule for f in check(tmp_path / "recipe.yaml") if f.severity == "error"]


FOUR_BAR = """<mujoco><compiler angle="radian"/><worldbody><body name="frame"><geom size=".1"/>
<body name="front" pos=".2 0 0"><joint name="front" axis="0 1 0" range="-1 1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/>
  <body name="bar" pos="0 0 -.2"><joint name="bar" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 -.2 0 0" size=".02"/></body></body>
<body name="back"><joint name="back" axis="0 1 0" range="-1 1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/></body>
</body></worldbody><equality><connect body1="back" body2="bar" anchor="0 0 -.2"/></equality>
<actuator><position joint="front" kp="5" kv=".5" ctrlrange=".2 .8"/>
<position joint="back" kp="5" kv=".5" ctrlrange="{}"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("commands", "home"), [(".2 .8", {"(front|back)": 0.5}), ("-.8 .8", None), ("-.8 -.2", None)]
)
def test_drives_of_one_loop_that_would_open_it_start_as_it_is_drawn(
    commands: str, home: dict[str, float] | None, tmp_path: Path
):
    """Exporters drive every joint, and the cranks of a parallelogram turn alike."""
    stated = proposed(FOUR_BAR.format(commands), tmp_path).recipe.keyframes.get("home")
    assert (stated and stated.joints) == home


def test_a_mesh_that_mujoco_does_not_make_is_refused_with_the_file(tmp_path: Path):
    vast = '<asset><mesh name="m" builtin="plate" params="99999 99999"/></asset></mujoco>'
    (tmp_path / "leg.xml").write_text(LEG.replace("../meshes", ".").replace("</mujoco>", vast))
    (tmp_path / "a.obj").write_text(TET)
    # In a process of its own: MuJoCo does not compile any more after that.
    words = (sys.executable, "-m", "assetbuild", "init", "leg.xml", "-o", "leg.yaml")
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert re.search("leg.xml.*does not make it", done.stderr)
