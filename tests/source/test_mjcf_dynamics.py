"""The forces on an MJCF's joints, their limits, gears and springs come out as they went in."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path

import mujoco
import pytest
from mjcfs import Written, arm, compared, read, same_motion, usd_findings, write, written

from assetbuild.robot.model import Actuator

CAPPED = '<position name="j" joint="j" kp="200" kv="1" forcerange="-100 100"/>'
OPEN = '<position name="j" joint="j" kp="100" kv="1"/>'
MOTOR = '<motor name="j" joint="j" ctrlrange="-20 20"/>'
BARE_MOTOR = '<motor name="j" joint="j"/>'
GENERAL = '<general name="j" joint="j" gainprm="3" biastype="affine" biasprm="1 -2 -.3 .1"/>'
SEVEN = 'actuatorfrcrange="-7 7"'


def drive_of(done: Written) -> Actuator:
    return done.control.by_joint["j"]


# --- actuatorfrcrange -----------------------------------------------------------------------


THRUSTER = '<general name="j" joint="j" gainprm="30" ctrlrange="-.1 2"/>'


@pytest.mark.parametrize("drive", [CAPPED, OPEN, MOTOR, BARE_MOTOR, GENERAL, THRUSTER, ""])
def test_the_range_of_a_joint_s_force_is_its_effort_limit(drive: str, tmp_path: Path):
    text = arm(SEVEN, drive)
    reading = read(text, tmp_path / "read")
    assert reading.links.by_joint["j"].limits.effort == 7.0, "for URDF, and for a recipe's rows"
    done = write(reading, tmp_path / "out")
    assert drive_of(done).effort == 7.0
    assert compared(done) == set()
    same_motion(text, done.xml, span=30.0)
    assert not {f.rule for f in done.findings} & {"mjcf.uneven_effort"}
    told = [f.message for f in done.findings if f.rule == "mjcf.only"]
    assert not [text for text in told if "actuatorfrcrange" in text], "every format has it"


@pytest.mark.parametrize(
    ("joint", "drive", "effort"),
    [
        (SEVEN, CAPPED.replace("100", "5"), 5.0),
        (f'{SEVEN} actuatorfrclimited="false"', OPEN, None),
    ],
)
def test_a_narrower_limit_of_the_drive_wins_over_a_range_and_one_switched_off_is_none(
    joint: str, drive: str, effort: float | None, tmp_path: Path
):
    text = arm(joint, drive)
    done = written(text, tmp_path)
    assert drive_of(done).effort == effort
    assert compared(done) == set()
    same_motion(text, done.xml, span=30.0)


def test_an_uneven_range_is_exact_in_mjcf_and_reported_for_the_other_formats(tmp_path: Path):
    text = arm('actuatorfrcrange="-7 3"', OPEN)
    done = written(text, tmp_path)
    assert drive_of(done).effort == 7.0
    same_motion(text, done.xml, span=30.0)
    (said,) = [f for f in done.findings if f.rule == "mjcf.uneven_effort"]
    assert (said.severity, said.data) == ("warning", {"lower": -7.0, "upper": 3.0})


def test_an_effort_of_the_recipe_takes_the_place_of_the_range(tmp_path: Path):
    row = {"joints": "j", "model": "pd", "kp": 50, "kd": 1, "effort": 20}
    text = written(arm(SEVEN, OPEN), tmp_path / "a", actuators=[row]).xml.read_text()
    assert 'forcerange="-20 20"' in text
    assert "actuatorfrcrange" not in text
    del row["effort"]
    text = written(arm(SEVEN, OPEN), tmp_path / "b", actuators=[row]).xml.read_text()
    assert 'forcerange="-7 7"' in text


# --- gear -----------------------------------------------------------------------------------

SERVO = '<position name="j" joint="j" kp="20" kv="0.5" gear="{}" forcerange="-4 4"/>'
AIMED = '<position name="j" joint="j" kp="3" kv="0.1" gear="{}" ctrlrange="-2 6"/>'
WHEEL = '<velocity name="j" joint="j" kv="0.7" gear="{}" ctrlrange="-9 9" forcerange="-3 3"/>'
GEARED = '<motor name="j" joint="j" gear="{}" ctrlrange="-1 1"/>'
LOOSE = '<motor name="j" joint="j" gear="{}"/>'
LAW = GENERAL.replace("/>", ' gear="{}" forcerange="-8 8" ctrlrange="-2 3"/>')
GROWING = '<general name="j" joint="j" gear="{}" gaintype="affine" gainprm="2 .5 .1"/>'
GAIN = THRUSTER.replace("/>", ' gear="{}"/>')
EVERY = [GAIN, SERVO, AIMED, WHEEL, GEARED, LOOSE, LAW, GROWING]


REFERENCE = 'ref="0.2" range="-2 2"'


@pytest.mark.parametrize(
    ("drive", "gear", "joint"),
    [
        *zip(EVERY, cycle(("6", "-3", "0.7")), cycle(("", SEVEN)), strict=False),
        *zip(EVERY[::3], cycle(("-3", "0.7")), cycle((REFERENCE,)), strict=False),
    ],
)
def test_a_geared_drive_moves_as_in_the_source_under_its_own_commands(
    drive: str, gear: str, joint: str, tmp_path: Path
):
    text = arm(joint, drive.format(gear))
    done = written(text, tmp_path)
    assert drive_of(done).gear == float(gear)
    assert compared(done) == set()
    assert [f.data for f in done.findings if f.rule == "mjcf.gear"] == [{"j": float(gear)}]
    if "ref" not in joint:
        same_motion(text, done.xml, span=30.0)


@pytest.mark.parametrize(
    ("drive", "model", "said"),
    [
        (SERVO, "pd", {"kp": 720.0, "kd": 18.0, "effort": 24.0, "ctrl": None}),
        (AIMED, "pd", {"kp": 108.0, "ctrl": (-2 / 6, 1.0), "effort": None}),
        (WHEEL, "velocity", {"kd": 25.2, "effort": 18.0, "ctrl": (-1.5, 1.5)}),
        (GEARED, "motor", {"effort": 6.0, "ctrl": (-6.0, 6.0)}),
        (LOOSE, "motor", {"effort": None, "ctrl": None}),
        (LAW, "general", {"effort": 48.0, "ctrl": (-2.0, 3.0)}),
    ],
)
def test_a_gear_is_folded_into_what_acts_on_the_joint(
    drive: str, model: str, said: dict[str, object], tmp_path: Path
):
    row = drive_of(written(arm("", drive.format(6)), tmp_path))
    assert row.model == model
    for name, value in said.items():
        assert getattr(row, name) == (value if value is None else pytest.approx(value)), name


@pytest.mark.parametrize("drive", [SERVO, WHEEL])
def test_a_gear_is_written_where_newton_reads_it(drive: str, tmp_path: Path):
    """Newton 1.8 takes the gear of a `<position>` and of a `<velocity>` for 1."""
    text = written(arm("", drive.format(6)), tmp_path).xml.read_text()
    assert "<general " in text and "<position" not in text and "<velocity" not in text


def test_a_keyframe_s_command_of_a_geared_servo_holds_its_pose(tmp_path: Path):
    pose = {"home": {"joints": {"j": 0.3}}}
    done = written(arm("", SERVO.format(6)), tmp_path, keyframes=pose)
    model = mujoco.MjModel.from_xml_path(str(done.xml))
    assert model.key_ctrl[0, 0] == pytest.approx(1.8)


def test_a_row_of_the_recipe_has_no_gear(tmp_path: Path):
    row = {"joints": "j", "model": "pd", "kp": 50, "kd": 1, "effort": 20}
    done = written(arm("", SERVO.format(6)), tmp_path, actuators=[row])
    assert drive_of(done).gear == 1.0
    assert "gear" not in done.xml.read_text()


# --- springs --------------------------------------------------------------------------------

SPRUNG = 'stiffness="12" springref="0.4"'


def test_a_spring_stays_in_the_mjcf_and_both_losses_are_reported(tmp_path: Path):
    text = arm(f'{SPRUNG} {SEVEN} solreflimit=".01 1"', OPEN)
    done = written(text, tmp_path)
    same_motion(text, done.xml, span=30.0)
    assert compared(done) == set()
    (warning,) = [f for f in done.findings if f.rule == "mjcf.spring"]
    assert (warning.severity, warning.data) == ("warning", {"j": "12"})
    assert warning.message.startswith("1 joint has a spring (N m/rad or N/m): `j` (12); ")
    (error,) = [f for f in usd_findings(done) if f.rule == "usd.spring"]
    assert (error.severity, error.subject) == ("error", "joint j")
    (only,) = [f for f in done.findings if f.rule == "mjcf.only"]
    assert "`solreflimit` of joint `j`" in only.data["said"], "one finding lists all"


@pytest.mark.parametrize("joint", ["", 'springref="0.4"', 'stiffness="0"'])
def test_a_joint_without_stiffness_has_no_spring(joint: str, tmp_path: Path):
    done = written(arm(joint, OPEN), tmp_path)
    rules = {f.rule for f in (*done.findings, *usd_findings(done))}
    assert not rules & {"mjcf.spring", "usd.spring"}


def test_a_pose_of_the_recipe_keeps_how_the_source_holds_the_root(tmp_path: Path):
    """The torso of dm_control's CMU humanoid lies along its z: here a box of 0.2 x 0.6 x 0.2 m."""
    text = """<mujoco><worldbody><body name="torso" pos="0 0 1" euler="90 0 0"><freejoint/>
    <geom type="box" size=".1 .3 .1"/></body></worldbody></mujoco>"""
    done = written(text, tmp_path, keyframes={"home": {}})
    key = mujoco.MjModel.from_xml_path(str(done.xml)).key_qpos[0]
    assert key == pytest.approx([0, 0, 0.3, 2**-0.5, 2**-0.5, 0, 0])
