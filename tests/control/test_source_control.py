"""What an MJCF says is joined with the recipe; what other steps read of it is kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcfs import Reading, Written, compared, hard_arm, read, write, written
from robot_files import run_step, write_robot_ports
from tiny import box_inertial, pendulum, tiny_quadruped, with_drives

from assetbuild.control.keep import KeepPose, KeepRatings
from assetbuild.control.only_mjcf import wider_excludes
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Contact, Control, MjcfOnly
from assetbuild.robot.shapes import SourceShapes
from assetbuild.robot.sides import Side
from assetbuild.robot.softness import CouplingError, LimitError, softened
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.targets.urdf import Urdf

PAIR = '<mujoco><option timestep="0.003"/><worldbody><body name="a"><geom name="ga" size=".1" friction="2 0.1 0.1" group="3"/><body name="b" pos="0 0 1"><joint name="j" armature="0.2" damping="0.5"/><geom name="gb" size=".1" group="3"/><body name="c"><geom name="gc" size=".1" group="3"/></body></body></body></worldbody><contact><exclude body1="a" body2="c"/></contact><actuator><position name="p" joint="j" kp="5"/></actuator><sensor><actuatorfrc name="f" actuator="p"/></sensor><keyframe><key name="home" qpos="0.5"/></keyframe></mujoco>'  # noqa: E501 # one robot per line


def made(folder: Path, text: str = PAIR, **recipe: object) -> Written:
    return write(read(text, folder / "read"), folder / "out", **recipe)


@pytest.fixture
def arm(tmp_path: Path) -> Reading:
    return hard_arm(tmp_path / "arm")


def test_the_source_holds_where_the_recipe_is_silent(tmp_path: Path):
    control = made(tmp_path).control
    assert control.simulation.timestep == 0.003
    assert (control.by_joint["j"].kp, control.by_joint["j"].armature) == (5.0, 0.2)
    assert control.excludes == (("a", "c"),), "no pairs but the source's"
    assert control.keyframes[0].joints == (("j", 0.5),)
    assert dict(control.contacts)["ga"] == Contact(friction=(2.0, 0.1, 0.1))


def test_the_recipe_wins_key_by_key(tmp_path: Path):
    control = made(
        tmp_path,
        simulation={"gravity": [0, 0, -1]},
        contact={"condim": 6},
        collision={"exclude": {"adjacent": True}},
        keyframes={"home": {"joints": {"j": 0.25}}, "other": {}},
    ).control
    assert (control.simulation.timestep, control.simulation.gravity[2]) == (0.003, -1.0)
    assert dict(control.contacts)["ga"] == Contact(friction=(2.0, 0.1, 0.1), condim=6)
    assert control.excludes == (("a", "b"), ("a", "c"), ("b", "c"))
    assert [(key.name, key.joints) for key in control.keyframes] == [
        ("home", (("j", 0.25),)),
        ("other", (("j", 0.0),)),
    ]


def test_a_keyframe_without_joints_keeps_the_source_s_and_a_rule_for_links_its_friction(
    tmp_path: Path,
):
    only = {
        "keyframes": {"home": {"base": "on_ground"}},
        "contact": {"links": {"a": {"condim": 1}}},
    }
    control = made(tmp_path, **only).control
    assert [(key.name, key.joints) for key in control.keyframes] == [("home", (("j", 0.5),))]
    assert dict(control.contacts)["ga"] == Contact(friction=(2.0, 0.1, 0.1), condim=1)


def test_a_table_of_drives_replaces_them_all_but_leaves_the_armature(tmp_path: Path):
    row = {"joints": "j", "model": "pd", "kp": 9, "kd": 1, "effort": 3}
    drive = made(tmp_path / "1", actuators=[row]).control.by_joint["j"]
    assert (drive.kp, drive.armature, drive.damping) == (9.0, 0.2, 0.5)
    drive = made(tmp_path / "2", actuators=[{**row, "armature": 0.1}]).control.by_joint["j"]
    assert drive.armature == 0.1


def test_another_cone_than_the_sources_brings_its_own_impratio(tmp_path: Path):
    """MuJoCo's default of 1, which nobody states, would let what an elliptic cone holds slip."""
    stated = PAIR.replace("timestep", 'impratio="3" timestep')
    for text, recipe, cone, impratio in (
        (PAIR, {}, 0, 1.0),
        (PAIR, {"mjcf": {"cone": "elliptic"}}, 1, 50.0),
        (stated, {"mjcf": {"cone": "elliptic"}}, 1, 3.0),
    ):
        folder = tmp_path / f"{cone} {impratio}"
        option = mujoco.MjModel.from_xml_path(str(made(folder, text, **recipe).xml)).opt
        assert (option.cone, option.impratio) == (cone, impratio)


def test_each_kind_of_thing_that_only_mjcf_has_is_told_once(arm: Reading, tmp_path: Path):
    written = write(arm, tmp_path / "out")
    (only,) = [f for f in written.findings if f.rule == "mjcf.only"]
    told = only.data["said"]
    assert isinstance(told, tuple)
    assert len(told) == len(set(told))
    assert "<spatial> of tendon `string`" in told
    assert "`solreflimit` of joint `elbow`" in told


def test_what_stands_on_a_merged_body_is_dropped_aloud(tmp_path: Path):
    text = PAIR.replace("<sensor>", '<sensor><subtreecom name="s" body="c"/>')
    reading = read(text.replace('name="c"', 'name="c" gravcomp="0.5"'), tmp_path / "read")
    reading.source = reading.source.__class__(reading.source.control, ("a", "b"), ())
    (reading.read / "source_control.json").write_bytes(encode(reading.source))
    written = write(reading, tmp_path / "out")
    dropped = [f for f in written.findings if f.rule == "mjcf.dropped"]
    told = [f.message.partition(" was left out")[0] for f in dropped]
    assert told == ['<body gravcomp="0.5"/>', "sensor `s`"]
    assert {f.subject for f in dropped} == {"link c"} and "keep_bodies" in dropped[0].hint
    assert written.control.excludes == (("a", "b"),), "the pair follows the merged link"


EGG = """<mujoco><worldbody><body name="a"><freejoint/><geom size=".1"/>
  <body name="b" pos=".1 .2 .3" euler="10 20 30">
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <geom name="egg" type="ellipsoid" size=".1 .2 .3" pos="0 .1 .2" quat=".5 .1 .2 .3"/>
  <light name="lamp" pos=".1 0 0" dir="0 .6 .8"/></body></body></worldbody></mujoco>"""


def test_a_shape_and_a_light_stay_where_they_are_when_their_body_is_merged(tmp_path: Path):
    reading = read(EGG, tmp_path / "read")
    reading.source = reading.source.__class__(reading.source.control, ("a",), ())
    (reading.read / "source_control.json").write_bytes(encode(reading.source))
    there, here = (
        mujoco.MjModel.from_xml_string(EGG),
        mujoco.MjModel.from_xml_path(str(write(reading, tmp_path / "out").xml)),
    )
    assert (there.nbody, here.nbody) == (3, 2)
    places = []
    for model in (there, here):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        egg, lamp = data.geom("egg"), data.light("lamp")
        places.append(np.concatenate([egg.xpos, egg.xmat, lamp.xpos, lamp.xdir]))
    np.testing.assert_allclose(places[1], places[0], atol=1e-12)


TWO_HINGES = """<mujoco><option>{}</option><worldbody><body name="a" pos="0 0 1"><freejoint/>
  <geom size=".1"/><body name="b" pos="0 0 .1"><joint name="x" axis="1 0 0"/>
  <joint name="y" axis="0 1 0"/><geom size=".1"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("flag", "contacts"),
    [("", 0), ('<flag filterparent="enable"/>', 0), ('<flag filterparent="disable"/>', 1)],
)
def test_a_mass_between_two_joints_lets_nothing_touch_that_passed(
    flag: str, contacts: int, tmp_path: Path
):
    text = TWO_HINGES.format(flag)
    reading = read(text, tmp_path / "read")
    bodies = [
        replace(body, inertial=box_inertial(0.1, (0.1, 0.1, 0.1))) if body.name == "b_x" else body
        for body in reading.links.bodies
    ]
    heavy = replace(reading.links, bodies=tuple(bodies))
    (reading.read / "links.json").write_bytes(encode(heavy))
    here = mujoco.MjModel.from_xml_path(str(write(reading, tmp_path / "out").xml))
    assert here.nbody == 4, "the link between the joints is a body of its own"
    for model in (mujoco.MjModel.from_xml_string(text), here):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert data.ncon == contacts


def test_surfaces_of_shapes_made_anew_are_told(tmp_path: Path):
    reading = read(PAIR, tmp_path / "read")
    renamed = (reading.read / "shapes.json").read_text().replace('"ga"', '"hull_of_a"')
    (reading.read / "shapes.json").write_text(renamed)
    reading.shapes = decode(SourceShapes, renamed.encode())
    written = write(reading, tmp_path / "out")
    assert "mjcf.new_surface" in {f.rule for f in written.findings}


def test_commands_of_keyframes_follow_their_drives(arm: Reading, tmp_path: Path):
    model = mujoco.MjModel.from_xml_path(str(write(arm, tmp_path / "out").xml))
    stated = {model.actuator(i).name: ctrl for i, ctrl in enumerate(model.key_ctrl[-1])}
    assert (stated["grip"], stated["geared"], stated["spin"]) == (100.0, 0.5, 0.1)
    assert stated["pull"] == pytest.approx(0.4 - 0.3490658503988659), "counted from `ref`"


def test_a_drive_whose_joint_the_recipe_moves_is_sent_there(tmp_path: Path):
    text = PAIR.replace('qpos="0.5"', 'qpos="0.5" ctrl="0.4"')
    kept = made(tmp_path / "1", text, keyframes={"home": {"joints": {"j": 0.5}}})
    assert 'ctrl="0.4"' in kept.xml.read_text(), "the source's own command for its own pose"
    moved = made(tmp_path / "2", text, keyframes={"home": {"joints": {"j": 0.25}}})
    assert 'ctrl="0.25"' in moved.xml.read_text()


@pytest.mark.parametrize(
    ("excludes", "merge", "lost"),
    [
        ([("FR_calf", "trunk")], True, ["pair FR_calf trunk"]),
        ([("FR_calf", "trunk")], False, []),
        ([("FR_calf", "trunk"), ("FR_foot", "trunk")], True, []),
        ([("FR_calf", "FR_thigh")], True, []),
    ],
)
def test_what_no_longer_touches_is_reported(
    excludes: list[tuple[str, str]], merge: bool, lost: list[str]
):
    """A foot that is merged into the calf, or is not."""
    robot = tiny_quadruped()
    tree, _ = merge_fixed_joints(robot.links, merge, ())
    found = wider_excludes(excludes, tree, robot.shapes)
    assert [(f.rule, f.subject) for f in found] == [("mjcf.wider_exclude", pair) for pair in lost]


LIMITS, COUPLINGS = LimitError.model_validate({}), CouplingError.model_validate({})


SAID = MjcfOnly("joint", '<joint solreflimit="0.03 1"/>', "swing_joint")


@pytest.mark.parametrize(
    ("effort", "side", "said", "stiffer"),
    [
        (500.0, Side(), (), True),
        (5.0, Side(), (), False),
        (500.0, Side(from_mjcf=True), (), False),
        (500.0, Side(from_mjcf=True, stated=("limits",)), (), True),
        (500.0, Side(from_mjcf=True, stated=("limits",)), (SAID,), False),
    ],
    ids=["strong", "weak", "of an MJCF", "the recipe's wish", "the source states the softness"],
)
def test_a_strong_motor_gets_stiffer_limits_unless_the_source_has_its_own(
    effort: float, side: Side, said: tuple[MjcfOnly, ...], stiffer: bool
):
    robot = with_drives(pendulum(), effort=effort)
    control = replace(robot.control, mjcf_only=said)
    made = softened(robot.tree, control, (side,), LIMITS, COUPLINGS)
    assert [name for name, _ in made.soft_limits] == ["swing_joint"] * stiffer


@pytest.mark.parametrize("mask", [-2, -(2**31), 2**31 - 1])
def test_a_mask_of_all_bits_but_one_is_a_negative_number(mask: int, tmp_path: Path):
    """`conaffinity="-2"`: the robot touches the floor and never itself."""
    text = f"""<mujoco><worldbody><body name="base"><freejoint/><geom name="hull" size=".1"/>
    <body name="leg" pos="0 0 -.3"><joint name="hip"/><geom name="foot" size=".1"
    conaffinity="{mask}"/></body></body></worldbody></mujoco>"""
    done = made(tmp_path, text)
    assert mujoco.MjModel.from_xml_path(str(done.xml)).geom("foot").conaffinity == mask
    assert compared(done) == set()
    (tmp_path / "in").mkdir()
    (tmp_path / "in/control.json").write_bytes(encode(done.control))
    run_step(KeepPose(), tmp_path / "in", tmp_path / "kept")
    seen = decode(Control, (tmp_path / "kept/control.json").read_bytes())
    assert dict(seen.contacts)["foot"].conaffinity == mask


def kept(folder: Path, control: Control) -> bytes:
    (folder / "inputs").mkdir(parents=True)
    (folder / "inputs/control.json").write_bytes(encode(control))
    run_step(KeepRatings(), folder / "inputs", folder / "outputs")
    return (folder / "outputs/ratings.json").read_bytes()


def changed(control: Control, **values: float) -> Control:
    rows = [replace(row, **values) for row in control.actuators]
    return replace(control, actuators=tuple(rows))


@pytest.mark.parametrize(
    ("name", "is_rating"),
    [*((name, True) for name in ("effort", "velocity", "damping", "friction")),
     *((name, False) for name in ("kp", "kd", "armature"))],
)  # fmt: skip
def test_ratings_are_kept_and_gains_keyframes_and_contacts_are_not(
    tmp_path: Path, name: str, is_rating: bool
):
    control = tiny_quadruped().control
    other = with_drives(tiny_quadruped(), **{name: 1.25}).control
    other = replace(other, keyframes=(), excludes=())
    assert (kept(tmp_path / "a", control) != kept(tmp_path / "b", other)) is is_rating


def test_the_urdf_is_the_same_from_ratings_as_from_all_control_data(tmp_path: Path):
    robot = tiny_quadruped()
    texts = []
    for name in ("all", "ratings"):
        folder = write_robot_ports(tmp_path / name, robot)
        if name == "ratings":
            (folder / "ratings.json").write_bytes(kept(tmp_path / "kept", robot.control))
        run_step(Urdf(robot="it"), folder, tmp_path / f"{name}-out")
        texts.append((tmp_path / f"{name}-out/urdf/it.urdf").read_bytes())
    assert texts[0] == texts[1]
    assert b"effort" in texts[0]


@pytest.mark.parametrize("pad", ["", '<geom type="ellipsoid" size=".02 .02 .03" mass="0"/>'])
def test_an_exclude_of_a_merged_body_counts_where_that_body_touches_anything(
    pad: str, tmp_path: Path
):
    """Tools exclude every two bodies of a hand but the tips, the empty ones too."""
    text = f"""<mujoco><worldbody><body name="palm"><geom size=".1"/>
    <body name="thumb" pos=".2 0 0"><joint name="a"/><geom name="thumb" size=".05"/></body>
    <body name="index" pos="0 .2 0"><joint name="b"/><geom name="index" size=".05"/>
    <body name="pad" pos="0 .1 0">{pad}<site name="tip"/></body></body></body></worldbody>
    <contact><exclude body1="thumb" body2="pad"/></contact></mujoco>"""
    done = written(text, tmp_path)
    excludes = mujoco.MjModel.from_xml_path(str(done.xml)).nexclude
    assert excludes == (1 if pad else 0)
    assert compared(done) == set()
