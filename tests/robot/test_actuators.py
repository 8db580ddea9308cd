"""The actuator table covers each moving joint once, and its numbers have one order of origin."""

from __future__ import annotations

import math
import pickle

import pytest

from assetbuild.robot.actuator_table import ActuatorRow, Motor
from assetbuild.robot.actuators import RowError, resolve
from assetbuild.robot.model import Body, Inertial, Joint, Limits, Mimic, Tree
from assetbuild.robot.pose import Pose

LIMITS = Limits(-1.0, 1.0, effort=23.7, velocity=30.1)


def leg(*joints: Joint) -> Tree:
    return Tree("leg", "floating", (Body("base"), *(Body(j.child) for j in joints)), joints)


def hinge(name: str, parent: str = "base", **fields: object) -> Joint:
    settings = {"kind": "revolute", "limits": LIMITS, "damping": 0.1, "friction": 0.2}
    return Joint(name=name, parent=parent, child=f"{name}_link", **(settings | fields))


HIP, KNEE = hinge("hip"), hinge("knee", "hip_link")
TREE = leg(HIP, KNEE)


def row_of(joints: str, model: str = "pd", **keys) -> ActuatorRow:
    return ActuatorRow(joints=joints, model=model, **keys)


def refused(tree: Tree, *rows: ActuatorRow, **motors: Motor) -> RowError:
    with pytest.raises(RowError) as caught:
        resolve(tree, rows, motors)
    return caught.value


def test_each_joint_gets_one_actuator_in_tree_order():
    rows = (row_of("knee", kp=30.0), row_of("hip", kp=20.0, kd=0.5))
    hip, knee = resolve(TREE, rows, {})
    assert (hip.joint, hip.kp, hip.kd) == ("hip", 20.0, 0.5)
    assert (knee.joint, knee.kp, knee.kd) == ("knee", 30.0, 0.0)


def test_without_row_or_motor_the_source_s_numbers_hold():
    hip, _ = resolve(TREE, (row_of(".*", kp=1.0),), {})
    assert (hip.effort, hip.velocity, hip.damping, hip.friction) == (23.7, 30.1, 0.1, 0.2)
    assert hip.armature == 0.0


def test_the_motor_goes_before_the_source_and_the_row_before_the_motor():
    motors = {"m": Motor(effort=10.0, velocity=20.0, friction=0.3, source="data sheet")}
    hip, _ = resolve(TREE, (row_of(".*", kp=1.0, motor="m"),), motors)
    assert (hip.effort, hip.velocity, hip.friction) == (10.0, 20.0, 0.3)
    assert (hip.motor, hip.source) == ("m", "data sheet")
    row = row_of(".*", kp=1.0, motor="m", effort=5.0, velocity=6.0, friction=0.0, damping=0.0)
    hip, _ = resolve(TREE, (row,), motors)
    assert (hip.effort, hip.velocity, hip.friction, hip.damping) == (5.0, 6.0, 0.0, 0.0)


def test_armature_is_the_rotor_seen_through_the_gear():
    # mjlab's Go1: I = 1.11842e-4 kg m2 through 6:1 is 0.00403 kg m2, through 9:1 0.00906 kg m2.
    motors = {
        "a": Motor(rotor_inertia=1.11842e-4, gear=6.0),
        "b": Motor(rotor_inertia=1.11842e-4, gear=9.0),
    }
    hip, knee = resolve(
        TREE, (row_of("hip", kp=1.0, motor="a"), row_of("knee", kp=1.0, motor="b")), motors
    )
    assert hip.armature == pytest.approx(0.00403, abs=5e-6)
    assert knee.armature == pytest.approx(0.00906, abs=5e-6)
    hip, _ = resolve(TREE, (row_of(".*", kp=1.0, motor="a", armature=0.01),), motors)
    assert hip.armature == 0.01


def test_joints_left_over_are_listed():
    error = refused(leg(HIP, KNEE, hinge("ankle", "knee_link")), row_of("hip", kp=1.0))
    assert error.message == "actuators: no row matches joints `knee`, `ankle`"
    assert error.key == ("actuators",)
    assert error.index is None


def test_a_joint_matched_twice_names_both_rows():
    error = refused(TREE, row_of(".*", kp=1.0), row_of("knee", kp=2.0))
    assert error.message == "actuators[1]: joint `knee` already matched by row 0 (`.*`)"
    assert error.key == ("actuators", 1, "joints")
    assert error.index == 1


def test_a_pattern_must_match_the_whole_name():
    assert "`hi` matches no moving joint" in refused(TREE, row_of("hi", kp=1.0)).message


def test_a_row_that_matches_nothing_is_told_the_nearest_joint():
    error = refused(TREE, row_of("hip", kp=1.0), row_of("kne", kp=1.0))
    assert error.key == ("actuators", 1, "joints")
    assert error.hint == "did you mean `knee`?"


def test_a_row_for_a_joint_that_does_not_move_says_so():
    tree = leg(HIP, hinge("mount", "hip_link", kind="fixed"))
    error = refused(tree, row_of("hip", kp=1.0), row_of("mount", kp=1.0))
    assert "do not move" in error.message


def test_an_unknown_motor_is_told_the_nearest():
    error = refused(TREE, row_of(".*", kp=1.0, motor="go1_hp"), go1_hip=Motor())
    assert error.key == ("actuators", 0, "motor")
    assert error.hint == "did you mean `go1_hip`?"


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (row_of(".*"), "model `pd` needs `kp`"),
        (row_of(".*", "ideal_pd"), "model `ideal_pd` needs `kp`"),
        (row_of(".*", "velocity"), "model `velocity` needs `kd`"),
        (row_of(".*", "velocity", kp=1.0, kd=1.0), "takes no `kp`"),
        (row_of(".*", "passive", kp=1.0), "takes no `kp`"),
        (row_of(".*", "passive", kd=1.0), "takes no `kd`"),
        (row_of(".*", "motor", kp=1.0), "takes no `kp`"),
    ],
)
def test_each_model_takes_its_own_gains(row, said):
    assert said in refused(TREE, row).message


@pytest.mark.parametrize(
    "row",
    [
        row_of(".*", "pd", kp=1.0),
        row_of(".*", "ideal_pd", kp=1.0),
        row_of(".*", "dc_motor", kp=1.0, velocity=3.0),
        row_of(".*", "velocity", kd=1.0),
        row_of(".*", "motor"),
    ],
)
@pytest.mark.parametrize("effort", [None, 0.0])
def test_what_pushes_needs_an_effort_limit(row, effort):
    tree = leg(hinge("hip", limits=Limits(-1, 1, effort=effort)))
    assert "needs the limit `effort` of joint `hip`" in refused(tree, row).message


def test_a_torque_speed_curve_needs_a_speed():
    tree = leg(hinge("hip", limits=Limits(-1, 1, effort=1.0)))
    error = refused(tree, row_of(".*", "dc_motor", kp=1.0))
    assert "needs the limit `velocity`" in error.message


@pytest.mark.parametrize("name", ["effort", "velocity"])
def test_a_torque_speed_curve_has_an_end(name):
    error = refused(TREE, row_of(".*", "dc_motor", kp=1.0, **{name: "unlimited"}))
    assert f"needs the limit `{name}` of joint `hip`; its row says `unlimited`" in error.message


def test_the_stall_torque_of_the_row_wins_over_the_motors():
    motors = {"m": Motor(effort=5.0, velocity=6.0, stall=12.0)}
    own = row_of("hip", "dc_motor", kp=1.0, motor="m", stall=9.0)
    hip, knee = resolve(TREE, (own, row_of("knee", "dc_motor", kp=1.0, motor="m")), motors)
    assert (hip.stall, knee.stall) == (9.0, 12.0)
    hip, _ = resolve(TREE, (row_of(".*", kp=1.0, motor="m"),), motors)
    assert hip.stall is None  # only a `dc_motor` has a torque-speed curve


def test_a_stall_torque_below_the_effort_limit_is_refused():
    row = row_of(".*", "dc_motor", kp=1.0, effort=5.0, velocity=6.0, stall=4.0)
    error = refused(TREE, row)
    assert "the stall torque 4 is below the effort limit 5" in error.message
    assert error.key == ("actuators", 0, "stall")


def test_only_a_dc_motor_takes_a_stall_torque():
    assert "takes no `stall`" in refused(TREE, row_of(".*", kp=1.0, stall=4.0)).message


def test_a_passive_joint_needs_no_limit():
    tree = leg(hinge("hip", limits=Limits(), damping=None, friction=None))
    (hip,) = resolve(tree, (row_of(".*", "passive"),), {})
    assert (hip.effort, hip.velocity, hip.damping, hip.friction) == (None, None, 0.0, 0.0)


def test_a_mimic_joint_without_a_row_is_passive_with_its_own_damping():
    tree = leg(HIP, hinge("finger", mimic=Mimic("hip"), damping=0.7))
    hip, finger = resolve(tree, (row_of("hip", kp=1.0),), {})
    assert hip.model == "pd"
    assert (finger.model, finger.damping) == ("passive", 0.7)


def test_a_mimic_joint_with_a_row_gets_what_the_row_says():
    tree = leg(HIP, hinge("finger", mimic=Mimic("hip")))
    assert [a.model for a in resolve(tree, (row_of(".*", kp=1.0),), {})] == ["pd", "pd"]


def test_without_a_table_every_moving_joint_is_passive():
    tree = leg(HIP, hinge("mount", "hip_link", kind="fixed"), hinge("w", kind="continuous"))
    made = resolve(tree, (), {})
    assert [(a.joint, a.model, a.damping) for a in made] == [
        ("hip", "passive", 0.1),
        ("w", "passive", 0.1),
    ]


def test_an_error_survives_the_way_between_processes():
    error = refused(TREE, row_of("kne", kp=1.0))
    again = pickle.loads(pickle.dumps(error))  # noqa: S301 # our own bytes
    assert (again.message, again.key, again.hint) == (error.message, error.key, error.hint)
    assert again.exit_code == 2


# --- gains by frequency, units, motors that extend others -----------------------------------


def arm(mass: float = 1.0, **fields: object) -> Tree:
    """A point mass at 0.5 m: its inertia about the hinge is mass / 4 (and a little)."""
    tiny = Inertial(mass, (0.5, 0.0, 0.0), (1e-9, 1e-9, 1e-9, 0.0, 0.0, 0.0))
    joint = hinge("swing", axis=(0.0, 1.0, 0.0), damping=0.0, **fields)
    return Tree("arm", "fixed", (Body("base"), Body("swing_link", tiny)), (joint,))


def test_a_frequency_and_a_ratio_become_gains_of_the_joint_with_what_it_carries():
    row = row_of("swing", frequency=2.0, damping_ratio=0.7, armature=0.05, damping=0.1)
    (made,) = resolve(arm(), (row,), {})
    inertia, omega = 0.25 + 0.05, 2 * math.pi * 2.0
    assert made.kp == pytest.approx(inertia * omega**2)
    assert made.kd + made.damping == pytest.approx(2 * 0.7 * inertia * omega)


def test_mjlab_s_convention_takes_the_rotor_alone():
    row = row_of("swing", motor="m", frequency=10.0, damping_ratio=2.0, inertia="armature")
    (made,) = resolve(arm(), (row,), {"m": Motor(rotor_inertia=1.11842e-4, gear=6.0)})
    assert made.kp == pytest.approx(15.895, abs=1e-3)  # as mjlab's Go1 hip has
    assert made.kd == pytest.approx(1.0119, abs=1e-4)


def test_the_inertia_is_that_of_the_home_pose():
    """Two links: folded, the shoulder carries less far out."""
    rod = Inertial(1.0, (0.5, 0.0, 0.0), (1e-9, 1e-9, 1e-9, 0.0, 0.0, 0.0))
    shoulder = hinge("a", axis=(0.0, 0.0, 1.0), damping=0.0)
    elbow = hinge("b", "a_link", axis=(0.0, 0.0, 1.0), damping=0.0, X_parent_joint=Pose((1.0, 0.0, 0.0)))  # fmt: skip # noqa: E501
    tree = Tree("arm", "fixed", (Body("base"), Body("a_link", rod), Body("b_link", rod)), (shoulder, elbow))  # fmt: skip # noqa: E501
    row = (row_of(".*", frequency=1.0, armature=10.0),)
    stretched = resolve(tree, row, {})[0].kp
    folded = resolve(tree, row, {}, {"b": 3.0})[0].kp
    assert stretched > 1.1 * folded


def test_more_passive_damping_than_the_ratio_asks_for_is_refused():
    error = refused(arm(), row_of("swing", kp=1.0, damping_ratio=0.1, damping=5.0))
    assert "its passive damping alone makes a ratio of 5" in error.message
    assert error.key == ("actuators", 0, "damping_ratio")


def test_a_motor_takes_what_it_does_not_say_from_the_one_it_extends():
    motors = {
        "hip": Motor(
            rotor_inertia=1e-4,
            gear=6.0,
            effort=24.0,
            velocity=30.0,
            friction=0.2,
            source="datasheet",
        ),
        "knee": Motor(gear=9.0, effort=36.0, extends="hip"),
    }
    (made, *_) = resolve(TREE, (row_of(".*", motor="knee", kp=1.0),), motors)
    assert (made.armature, made.effort, made.velocity) == (pytest.approx(81e-4), 36.0, 30.0)
    assert made.source == "datasheet"


def test_a_target_may_reach_beyond_the_limits_by_what_the_effort_can_push():
    (made,) = resolve(arm(), (row_of("swing", kp=10.0, ctrl="reach"),), {})
    assert made.ctrl == pytest.approx((-1.0 - 2.37, 1.0 + 2.37))


def test_unlimited_effort_is_said_and_not_forgotten():
    (made,) = resolve(arm(), (row_of("swing", kp=10.0, effort="unlimited"),), {})
    assert made.effort is None


SLIDE = hinge("slide", kind="prismatic")
ERRORS = {
    "joint `knee` already matched by row 0": (row_of(".*", kp=1.0), row_of("knee", kp=1.0)),
    "no row matches joint `knee`": (row_of("hip", kp=1.0),),
    "no motor named `m`": (row_of(".*", kp=1.0, motor="m"),),
    "model `pd` needs `kp` or `frequency`": (row_of(".*"),),
    "model `general` needs `general`": (row_of(".*", model="general"),),
    "model `motor` takes no `frequency`": (row_of(".*", model="motor", frequency=1.0),),
    "`inertia` says what": (row_of(".*", kp=1.0, inertia="armature"),),
    "`reach` needs model `pd`": (row_of(".*", model="motor", ctrl="reach"),),
}  # fmt: skip


@pytest.mark.parametrize("message", ERRORS)
def test_each_wrong_table_has_its_message(message: str):
    assert message in refused(TREE, *ERRORS[message]).message


def test_effort_missing():
    tree = leg(hinge("hip", limits=Limits(-1.0, 1.0)))
    error = refused(tree, row_of("hip", kp=1.0))
    assert "needs the limit `effort` of joint `hip`; the source states none" in error.message
    assert error.hint == "add `effort` to the row or its motor"


def test_prismatic_joints_do_not_share_numbers_with_joints_that_turn():
    tree = leg(HIP, SLIDE)
    mixed = refused(tree, row_of(".*", kp=1.0))
    assert "`kp` cannot be in N m/rad and N/m for both" in mixed.message
    rotary = refused(
        leg(SLIDE), row_of("slide", kp=1.0, motor="m"), m=Motor(rotor_inertia=1e-4, gear=6.0)
    )
    assert "slides, but motor `m` is a rotary one" in rotary.message
    stated = refused(leg(SLIDE), row_of("slide", kp=1.0, unit="rotary"))
    assert "the row is in rotary units, but joint `slide` is prismatic" in stated.message
    resolve(
        leg(SLIDE),
        (row_of("slide", kp=1.0, motor="m", unit="linear"),),
        {"m": Motor(rotor_inertia=1.0)},
    )


def test_motors_in_a_circle_or_without_a_parent():
    circle = {"a": Motor(extends="b"), "b": Motor(extends="a")}
    assert "in a circle: a -> b -> a" in refused(TREE, row_of(".*", kp=1.0, motor="a"), **circle).message  # fmt: skip # noqa: E501
    lost = refused(TREE, row_of(".*", kp=1.0, motor="a"), a=Motor(extends="c"))
    assert lost.key == ("motors", "a", "extends")
