"""A drive over a tendon, or with a scaled command, is one of a joint wherever MJCF is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcfs import Written, compared, read, usd_findings, write, written

from assetbuild.edits.set_limits import SetLimits
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Actuator, Mimic

TENDON = '<tendon><fixed name="both" {more}><joint joint="l" coef="{a}"/><joint joint="r" coef="{b}"/></fixed></tendon>'  # noqa: E501
COUPLED = '<equality><joint joint1="r" joint2="l" polycoef="{c0} {c1} {c2} 0 0"/></equality>'
SERVO = '<position name="grip" tendon="both" kp="80" kv="6" ctrlrange="0 1" forcerange="-9 9"/>'
HAND = """<general name="grip" {on} ctrlrange="0 255" forcerange="-9 9" gainprm="0.4"
  biastype="affine" biasprm="0 -80 -6" {more}/>"""


def hand(
    drive: str = SERVO,
    *,
    a: float = 0.5,
    b: float = 0.5,
    c: tuple[float, float, float] = (0, 1, 0),
    more: str = "",
    joint: str = "",
    extra: str = "",
) -> str:
    """Two fingers; `c`: the polynomial by which the right one follows the left one."""
    equality = COUPLED.format(c0=c[0], c1=c[1], c2=c[2]) if any(c) else ""
    fingers = "".join(
        f"""<body name="f{n}" pos="0 {y} .1"><joint name="{n}" axis="0 1 0" range="-1 1"
        damping=".5" {joint if n == "r" else ""}/>
        <geom type="capsule" size=".02" fromto="0 0 0 0 0 .2"/></body>"""
        for n, y in (("l", 0.1), ("r", -0.1))
    )
    return f"""<mujoco><compiler angle="radian"/><worldbody><body name="palm"><geom size=".05"/>
    {fingers}</body></worldbody>{equality}{TENDON.format(more=more, a=a, b=b)}
    <actuator>{drive}</actuator>{extra}</mujoco>"""


def row(done: Written) -> Actuator:
    return done.control.by_joint["l"]


def lost(done: Written) -> set[str]:
    """Rules by which the loss of its motion is reported."""
    return {f.rule for f in (*done.findings, *usd_findings(done)) if f.rule.endswith(".motion")}


def command(model: mujoco.MjModel, position: float) -> float:
    """The only drive's command at a position of the leading joint, from compiled numbers."""
    gain, bias = float(model.actuator_gainprm[0, 0]), model.actuator_biasprm[0]
    data = mujoco.MjData(model)
    length = data.actuator_length
    mujoco.mj_kinematics(model, data)
    followed = float(model.eq_data[0, 1])
    data.qpos[:] = (position, position * followed)
    mujoco.mj_fwdPosition(model, data)
    return -(float(bias[0]) + float(bias[1]) * float(length[0])) / gain


@pytest.mark.parametrize(
    ("a", "b", "follows"), [(0.5, 0.5, 1.0), (1.0, -1.0, -1.0), (2.0, 0.3, 0.5), (-1.0, 0.5, 1.0)]
)
@pytest.mark.parametrize(
    "drive", [SERVO, SERVO.replace("kp", 'gear="3" kp'), HAND.format(on='tendon="both"', more="")]
)
def test_what_a_tendon_does_to_its_joints_the_drive_of_the_leading_one_does(
    drive: str, a: float, b: float, follows: float, tmp_path: Path
):
    """Virtual work: the tendon's forces, along the motion that the coupling leaves."""
    text = hand(drive, a=a, b=b, c=(0, follows, 0))
    done = written(text, tmp_path)
    model, drive_of = mujoco.MjModel.from_xml_string(text), row(done)
    data, random = mujoco.MjData(model), np.random.default_rng(1)
    assert drive_of.model == "pd"
    for _ in range(20):
        q, v, target = random.uniform(-1.0, 1.0, 3)
        data.qpos[:], data.qvel[:] = (q, follows * q), (v, follows * v)
        data.ctrl[0] = command(model, target)
        model.actuator_ctrllimited[:] = 0
        mujoco.mj_forward(model, data)
        along = float(data.qfrc_actuator @ (1.0, follows))
        ours = drive_of.kp * (target - q) - drive_of.kd * v
        assert drive_of.effort is not None
        assert along == pytest.approx(np.clip(ours, -drive_of.effort, drive_of.effort), rel=1e-9)


def test_it_stays_in_the_mjcf_and_nothing_is_lost_elsewhere(tmp_path: Path):
    text = hand()
    done = written(text, tmp_path)
    assert compared(done) == set()
    assert 'tendon="both"' in done.xml.read_text()
    assert lost(done) == set()
    (said,) = [f for f in done.findings if f.rule == "mjcf.own_drive"]
    assert (said.severity, said.subject) == ("info", "joint l")
    assert row(done).ctrl == (0.0, 1.0)
    assert done.control.by_joint["r"].model == "passive"


MIRROR = """<tendon><fixed name="m1"><joint joint="r" coef="{0}"/>{1}</fixed>{2}</tendon>
<equality><tendon name="mirror" tendon1="m1" {3} solref=".01 1"/></equality>"""


@pytest.mark.parametrize(
    "coupling",
    [
        MIRROR.format(1, '<joint joint="l" coef="-1"/>', "", ""),
        MIRROR.format(-1, "", '<fixed name="m2"><joint joint="l" coef="1"/></fixed>',
                      'tendon2="m2" polycoef="0 -1 0 0 0"'),
    ],
    ids=["one tendon", "two tendons"],
)  # fmt: skip
def test_tendons_that_couple_two_joints_as_an_equality_of_joints_does_are_that(
    coupling: str, tmp_path: Path
):
    text = hand(c=(0, 0, 0), extra=coupling)
    done = written(text, tmp_path)
    assert compared(done) == set()
    assert lost(done) == set()
    mimic = RobotFiles(done.inputs).tree.by_joint["r"].mimic
    assert mimic == Mimic("l", 1.0, 0.0)
    assert row(done).model == "pd"
    ours, theirs = (mujoco.MjModel.from_xml_string(t) for t in (done.xml.read_text(), text))
    ends = []
    for model in (ours, theirs):
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.7
        mujoco.mj_step(model, data, 100)
        ends.append(data.joint("r").qpos[0])
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)


LOST = {
    "loose": hand(c=(0, 0, 0)),
    "geared tendon": hand(
        c=(0, 0, 0), extra=MIRROR.format(1, '<joint joint="l" coef="-2"/>', "", "")
    ),
    "curved": hand(c=(0, 1, 0.2)),
    "offset": hand(c=(0.1, 1, 0)),
    "no lever": hand(a=1.0, b=-1.0),
    "limit": hand(more='actuatorfrcrange="-1 1"'),
    "joint's limit": hand(joint='actuatorfrcrange="-1 1"'),
    "two drives": hand(SERVO + SERVO.replace("grip", "again")),
}


@pytest.mark.parametrize("what", LOST)
def test_what_is_no_drive_of_one_joint_is_still_lost_motion(what: str, tmp_path: Path):
    done = written(LOST[what], tmp_path)
    assert row(done).model == "passive"
    assert {"mjcf.motion", "usd.motion"} <= lost(done)


def test_a_command_of_0_to_255_is_a_position_of_the_joint_elsewhere(tmp_path: Path):
    text = hand(HAND.format(on='joint="l"', more='gear="2"'))
    done = written(text, tmp_path)
    assert row(done).model == "pd"
    assert (row(done).kp, row(done).kd, row(done).effort) == (320.0, 24.0, 18.0)
    assert row(done).ctrl == pytest.approx((0.0, 0.4 * 255 / 80 / 2))
    assert lost(done) == set()
    assert compared(done) == set()


@pytest.mark.parametrize("on", ['joint="l"', 'tendon="both"'])
def test_a_pose_of_the_recipe_is_held_by_the_mjcf_s_own_command(on: str, tmp_path: Path):
    pose = {"home": {"joints": {"l": 0.4}}}
    done = written(hand(HAND.format(on=on, more="")), tmp_path, keyframes=pose)
    model = mujoco.MjModel.from_xml_path(str(done.xml))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    model.opt.gravity[:] = 0.0
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert data.joint("l").qpos[0] == pytest.approx(0.4, abs=1e-3)


def test_an_effort_that_an_edit_sets_is_that_of_the_source_s_drive(tmp_path: Path):
    servo = '<position joint="l" kp="20" kv="1" forcerange="-30 30"/>'
    reading = read(hand(servo), tmp_path / "read")
    edit = SetLimits.model_validate({"joint": "[lr]", "effort": 5})
    edited = tuple(edit.change(joint)[0] for joint in reading.links.joints)
    (reading.read / "links.json").write_bytes(encode(replace(reading.links, joints=edited)))
    done = write(reading, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(done.xml))
    assert model.actuator_forcerange[0].tolist() == [-5.0, 5.0]


def test_a_cable_holds_still_in_a_pose_of_which_the_source_says_nothing(tmp_path: Path):
    """Its command is the length that it has there, not 0, which would pull at it."""
    cable = "<spatial name='cable'><site site='a'/><site site='b'/></spatial></tendon>"
    pull = '<position name="pull" tendon="cable" kp="900" kv="9" ctrlrange="0.03 0.5"/>'
    text = hand(pull).replace("</tendon>", cable).replace("<geom", "<site name='b'/><geom", 1)
    text = text.replace(
        '<geom type="capsule"', '<site name="a" pos="0 0 .2"/><geom type="capsule"', 1
    )
    pose = {"home": {"joints": {}}}
    done = written(text, tmp_path, keyframes=pose)
    model = mujoco.MjModel.from_xml_path(str(done.xml))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ctrl[0] == pytest.approx(float(data.ten_length[1])) and data.ctrl[0] > 0.03
    assert data.actuator_force[0] == pytest.approx(0.0, abs=1e-6)


def test_a_drive_without_gain_is_the_same_drive(tmp_path: Path):
    """MuJoCo compiles its bias from `-kp`, which is a zero with a sign."""
    drive = '<position name="grip" joint="l" kp="0"/>'
    assert compared(written(hand(drive), tmp_path)) == set()
