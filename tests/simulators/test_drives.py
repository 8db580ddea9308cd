"""The drives of a compiled model are read as MuJoCo itself applies them."""

from __future__ import annotations

import math

import mujoco
import pytest

from assetbuild.robot.model import Actuator, Control
from assetbuild.simulators.mujoco import Model
from assetbuild.simulators.mujoco import motion as mujoco_motion
from assetbuild.simulators.mujoco import stand as mujoco_stand
from assetbuild.simulators.mujoco import trials as mujoco_trials
from assetbuild.simulators.mujoco.drives import read_drives, servoed, torques

ARM = """<mujoco><option gravity="0 0 0"/><worldbody><body name="arm">
<joint name="elbow" type="{kind}" axis="0 0 1" {joint}/><geom size="0.1" mass="1"/>
<body pos="0.3 0 0"><joint name="wrist" type="ball"/><geom size="0.05" mass="0.1"/></body>
</body></worldbody>
<tendon><fixed name="cable"><joint joint="elbow" coef="2"/></fixed></tendon>
<actuator>{actuators}</actuator>
<keyframe><key name="home"/></keyframe></mujoco>"""

SERVO = '<position joint="elbow" kp="10" kv="2"/>'
GEARED = '<position joint="elbow" kp="10" kv="2" gear="3"/>'
LAWS = {
    "servo": SERVO,
    "geared servo": GEARED,
    "servo of negative gear": '<position joint="elbow" kp="10" kv="2" gear="-3"/>',
    "servo in its parent's frame": '<position jointinparent="elbow" kp="10" gear="2"/>',
    "servo in other units": '<general joint="elbow" gainprm="0.3" biastype="affine" '
    'biasprm="1 -100 -10" gear="2"/>',
    "speed": '<velocity joint="elbow" kv="3" gear="-2"/>',
    "motor": '<motor joint="elbow" gear="7"/>',
    "scaled motor": '<general joint="elbow" gainprm="5" gear="2"/>',
    "servo and damper": GEARED + '<velocity joint="elbow" kv="1.5" gear="2"/>',
    "servo beside a cable": SERVO + '<general tendon="cable" gainprm="0" gear="4"/>',
    "wrist": SERVO + '<motor joint="wrist" gear="1 0 0"/>',
}
WORDS = {
    "servo in other units": ["general"], "speed": ["velocity"], "motor": ["motor"],
    "scaled motor": ["motor"], "servo and damper": ["servo", "velocity"],
    "servo beside a cable": ["servo", "motor"],
}  # fmt: skip
"""Drives have the words of MJCF; the others are a servo."""


def arm(actuators: str, joint: str = "", kind: str = "hinge") -> Model:
    return mujoco.MjModel.from_xml_string(ARM.format(actuators=actuators, joint=joint, kind=kind))


def torque(model: Model, ctrl: float, q: float = 0.0, speed: float = 0.0) -> float:
    """What MuJoCo applies to the elbow, N m."""
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = q, speed
    data.ctrl[:] = ctrl
    mujoco.mj_forward(model, data)
    return float(data.qfrc_actuator[0])


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("law", LAWS)
def test_gains_and_words_are_those_of_mujoco_and_mjcf(law: str, kind: str) -> None:
    model = arm(LAWS[law], 'ref="0.2"', kind)
    found = read_drives(model)
    assert [drive.kind for drive in found] == WORDS.get(law, ["servo"])
    assert {drive.joint_name for drive in found} == {"elbow"}
    for ctrl, q, speed in ((0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.1, 0.5, 0.0), (0.0, -0.3, 0.9)):
        pushed = sum(drive.gain * ctrl + drive.constant for drive in found)
        held = sum(drive.kp * q + drive.kd * speed for drive in found)
        expected = pushed - held
        assert torque(model, ctrl, q, speed) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_at_its_command_a_drive_that_holds_positions_is_at_rest(law: str) -> None:
    model = arm(LAWS[law])
    holding = [drive for drive in read_drives(model) if drive.holds_position]
    assert bool(holding) == ("servo" in law or law == "wrist")
    for drive in holding:
        if len(read_drives(model)) > 1:
            continue  # the other drive pushes too
        assert torque(model, drive.command(0.4), 0.4) == pytest.approx(0.0, abs=1e-12)
        assert drive.target(drive.command(0.4)) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("text", "is_affine"),
    [
        ('<damper joint="elbow" kv="3" ctrlrange="0 1"/>', False),
        ('<intvelocity joint="elbow" kp="10" actrange="-1 1"/>', False),
        ('<muscle joint="elbow" lengthrange="0 1"/>', False),
        ('<position joint="elbow" kp="10" timeconst="0.1"/>', True),
    ],
)
def test_what_is_no_law_of_position_and_speed_says_so(text: str, is_affine: bool) -> None:
    (drive,) = read_drives(arm(text))
    assert (drive.is_affine, drive.holds_position, drive.filtered) == (is_affine,) * 3
    assert drive.kind == ("servo" if is_affine else "general")


@pytest.mark.parametrize(
    ("actuators", "joint", "expected"),
    [
        (SERVO, "", (-math.inf, math.inf)),
        ('<position joint="elbow" kp="1e4" forcerange="-4 5" gear="-3"/>', "", (-15, 12)),
        ('<position joint="elbow" kp="1e4" forcerange="-4 4" gear="3"/>',
         'actuatorfrcrange="-8 6"', (-8, 6)),
        ('<position joint="elbow" kp="1e4" forcerange="-4 5"/>',
         'actuatorfrcrange="-8 6"', (-4, 5)),
        ('<motor joint="elbow" ctrlrange="-1 1" gear="20" forcerange="-0.5 0.5"/>', "", (-10, 10)),
        ('<general joint="elbow" ctrlrange="-1 2" gainprm="-5" gear="2"/>', "", (-20, 10)),
        ('<position joint="elbow" kp="1e4" forcerange="-4 5"/><motor joint="elbow" gear="2" '
         'ctrlrange="-1 1"/>', "", (-6, 7)),
        ('<position joint="elbow" kp="1e4" ctrlrange="-1 1" forcerange="-4 5"/>', "", (-4, 5)),
        ("", 'actuatorfrcrange="-8 6"', (0, 0)),
    ],
)  # fmt: skip
def test_the_effort_limit_is_what_mujoco_pushes_with_at_most(
    actuators: str, joint: str, expected: tuple[float, float]
) -> None:
    model = arm(actuators, joint)
    assert torques(model).get(0, (0.0, 0.0)) == pytest.approx(expected)
    if math.isfinite(expected[0]) and actuators:
        reached = [torque(model, ctrl, q) for ctrl in (-1e3, 1e3) for q in (-1.0, 1.0)]
        assert (min(reached), max(reached)) == pytest.approx(expected)


# --- what the experiments make of it ------------------------------------------------------------


def test_a_geared_servo_is_told_to_swing_in_its_own_units() -> None:
    moved = [mujoco_trials.answers(arm(text))["elbow"][1] for text in (
        '<position joint="elbow" kp="900" kv="18"/>',
        '<position joint="elbow" kp="100" kv="2" gear="3"/>',
        '<general joint="elbow" gainprm="9" biasprm="0 -900 -18" biastype="affine"/>',
    )]  # fmt: skip
    assert moved[0] > 0.05
    assert moved[1:] == pytest.approx([moved[0]] * 2)


def test_a_servo_that_replaces_a_geared_motor_has_the_gains_of_the_table() -> None:
    model = arm('<motor joint="elbow" gear="50"/><motor tendon="cable"/>')
    law = Actuator("elbow", "ideal_pd", kp=30.0, kd=2.0, effort=4.0)
    mujoco_motion.drive_as(model, {"elbow": law})
    gains = [sum(getattr(drive, gain) for drive in read_drives(model)) for gain in ("kp", "kd")]
    assert (*gains, torques(model)[0]) == (30.0, 2.0, (-4.0, 4.0))
    assert model.actuator_biasprm[1].tolist() == [0.0] * 10


def test_the_load_of_a_joint_counts_the_gear_and_its_own_limit() -> None:
    floor = '<geom name="floor" type="plane" size="1 1 1" pos="0 0 -2"/>'
    text = ARM.format(actuators=GEARED, joint='actuatorfrcrange="-4 4"', kind="hinge")
    text = text.replace("<worldbody>", f"<worldbody>{floor}").replace(
        '<key name="home"/>', '<key name="home" ctrl="9"/>'
    )
    stood = mujoco_stand.stand(mujoco.MjModel.from_xml_string(text), "home", 0.01)
    assert stood.load == {"elbow": pytest.approx(1.0)}


def test_a_model_without_laws_outside_of_it_is_not_copied():
    """A model of hundreds of meshes has nearly a gigabyte."""
    model = mujoco.MjModel.from_xml_string(ARM.format(kind="hinge", joint="", actuators=SERVO))
    drives = {law: Control(actuators=(Actuator("elbow", model=law),)) for law in ("pd", "ideal_pd")}
    assert servoed(model, drives["pd"]) is model
    assert servoed(model, drives["ideal_pd"]) is not model
