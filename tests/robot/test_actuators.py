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


def test_the_stall_torque_of_the_row_wins_over_the_motors():
    motors = {"m": Motor(effort=5.0, velocity=6.0, stall=12.0)}
    own = row_of("hip", "dc_motor", kp=1.0, motor="m", stall=9.0)
    hip, knee = resolve(TREE, (own, row_of("knee", "dc_motor", kp=1.0, motor="m")), motors)
    assert (hip.stall, knee.stall) == (9.0, 12.0)
    hip, _ = resolve(TREE, (row_of(".*", kp=1.0, motor="m"),), motors)
    assert hip.stall is None  # only a `dc_motor` has a torque-speed curve


def test_a_passive_joint_needs_no_limit():
    tree = leg(hinge("hip", limits=Limits(), damping=None, friction=None))
    (hip,) = resolve(tree, (row_of(".*", "passive"),), {})
    assert (hip.effort, hip.velocity, hip.damping, hip.friction) == (None, None, 0.0, 0.0)


def test_a_mimic_joint_without_a_row_is_passive_with_its_own_damping():
    tree = leg(HIP, hinge("finger", mimic=Mimic("hip"), damping=0.7))
    hip, finger = resolve(tree, (row_of("hip", kp=1.0),), {})
    assert hip.model == "pd"
    assert (finger.model, finger.damping) == ("passive", 0.7)


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
    assert (again.key[1], again.exit_code) == (0, 2)


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


def test_a_target_may_reach_beyond_the_limits_by_what_the_effort_can_push():
    (made,) = resolve(arm(), (row_of("swing", kp=10.0, ctrl="reach"),), {})
    assert made.ctrl == pytest.approx((-1.0 - 2.37, 1.0 + 2.37))


def test_a_motor_is_itself_then_the_one_it_extends_then_the_source_and_a_row_wins_over_all():
    data_sheet = Motor(rotor_inertia=1e-4, gear=6.0, velocity=20.0, friction=0.3, source="sheet")
    motors = {"hip": data_sheet, "knee": Motor(gear=9.0, effort=10.0, extends="hip")}
    hip, _ = resolve(TREE, (row_of(".*", kp=1.0, motor="knee"),), motors)
    assert (hip.effort, hip.velocity, hip.friction, hip.damping) == (10.0, 20.0, 0.3, 0.1)
    assert (hip.motor, hip.source, hip.armature) == ("knee", "sheet", pytest.approx(81e-4))
    row = row_of(".*", kp=1.0, motor="knee", effort=5.0, velocity=6.0, friction=0.0, damping=0.0)
    hip, _ = resolve(TREE, (row,), motors)
    assert (hip.effort, hip.velocity, hip.friction, hip.damping) == (5.0, 6.0, 0.0, 0.0)
    hip, _ = resolve(TREE, (row_of(".*", kp=1.0, motor="knee", effort="unlimited"),), motors)
    assert hip.effort is None


SLIDE = hinge("slide", kind="prismatic")
PLAIN = row_of(".*", kp=1.0)
HIP_ROW, KNEE_ROW = row_of("hip", kp=1.0), row_of("knee", kp=1.0)
GEARED = Motor(rotor_inertia=1e-4, gear=6.0)
WITHOUT_LIMITS = leg(hinge("hip", limits=Limits(-1.0, 1.0)))
NO_EFFORT = leg(hinge("hip", limits=Limits(-1.0, 1.0, effort=0.0)))
NO_SPEED = leg(hinge("hip", limits=Limits(-1.0, 1.0, effort=1.0)))


def curve(**keys) -> ActuatorRow:
    return row_of(".*", "dc_motor", kp=1.0, **keys)


# The robot, its rows and motors | words of the error and of its hint, the key that they are about.
REFUSED = {
    "left over": (leg(HIP, KNEE, hinge("ankle", "knee_link")), (HIP_ROW,), {},
                  "no row matches joints `knee`, `ankle`", ("actuators",)),
    "matched twice": (TREE, (PLAIN, KNEE_ROW), {},
                      "joint `knee` already matched by row 0 (`.*`)", ("actuators", 1, "joints")),
    "part of a name": (TREE, (row_of("hi", kp=1.0),), {}, "`hi` matches no moving joint",
                       ("actuators", 0, "joints")),
    "a wrong name": (TREE, (HIP_ROW, row_of("kne", kp=1.0)), {}, "did you mean `knee`?",
                     ("actuators", 1, "joints")),
    "a fixed joint": (leg(HIP, hinge("mount", "hip_link", kind="fixed")),
                      (HIP_ROW, row_of("mount", kp=1.0)), {}, "do not move",
                      ("actuators", 1, "joints")),
    "no motor": (TREE, (row_of(".*", kp=1.0, motor="m"),), {}, "no motor named `m`",
                 ("actuators", 0, "motor")),
    "a motor's wrong name": (TREE, (row_of(".*", kp=1.0, motor="go1_hp"),), {"go1_hip": Motor()},
                             "did you mean `go1_hip`?", ("actuators", 0, "motor")),
    "motors in a circle": (TREE, (row_of(".*", kp=1.0, motor="a"),),
                           {"a": Motor(extends="b"), "b": Motor(extends="a")},
                           "in a circle: a -> b -> a", None),
    "a motor without its parent": (TREE, (row_of(".*", kp=1.0, motor="a"),),
                                   {"a": Motor(extends="c")}, "`c`", ("motors", "a", "extends")),
    "pd": (TREE, (row_of(".*"),), {}, "model `pd` needs `kp` or `frequency`", None),
    "ideal pd": (TREE, (row_of(".*", "ideal_pd"),), {}, "model `ideal_pd` needs `kp`", None),
    "velocity": (TREE, (row_of(".*", "velocity"),), {}, "model `velocity` needs `kd`", None),
    "velocity with kp": (TREE, (row_of(".*", "velocity", kp=1.0, kd=1.0),), {}, "takes no `kp`",
                         None),
    "passive with kp": (TREE, (row_of(".*", "passive", kp=1.0),), {}, "takes no `kp`", None),
    "passive with kd": (TREE, (row_of(".*", "passive", kd=1.0),), {}, "takes no `kd`", None),
    "motor with kp": (TREE, (row_of(".*", "motor", kp=1.0),), {}, "takes no `kp`", None),
    "general": (TREE, (row_of(".*", "general"),), {}, "model `general` needs `general`", None),
    "motor with a frequency": (TREE, (row_of(".*", "motor", frequency=1.0),), {},
                               "model `motor` takes no `frequency`", None),
    "an inertia without use": (TREE, (row_of(".*", kp=1.0, inertia="armature"),), {},
                               "`inertia` says what", None),
    "a reach of a motor": (TREE, (row_of(".*", "motor", ctrl="reach"),), {},
                           "`reach` needs model `pd`", None),
    "no effort": (WITHOUT_LIMITS, (PLAIN,), {},
                  "needs the limit `effort` of joint `hip`; the source states none", None),
    "what to do without one": (WITHOUT_LIMITS, (PLAIN,), {}, "add `effort` to the row", None),
    **{
        f"no effort for {row.model}": (NO_EFFORT, (row,), {},
                                       "needs the limit `effort` of joint `hip`", None)
        for row in (PLAIN, row_of(".*", "ideal_pd", kp=1.0), curve(velocity=3.0),
                    row_of(".*", "velocity", kd=1.0), row_of(".*", "motor"))
    },
    "no speed": (NO_SPEED, (curve(),), {}, "needs the limit `velocity`", None),
    "unlimited effort": (TREE, (curve(effort="unlimited"),), {},
                         "limit `effort` of joint `hip`; its row says `unlimited`", None),
    "unlimited speed": (TREE, (curve(velocity="unlimited"),), {},
                        "limit `velocity` of joint `hip`; its row says `unlimited`", None),
    "a weak stall": (TREE, (curve(effort=5.0, velocity=6.0, stall=4.0),), {},
                     "the stall torque 4 is below the effort limit 5", ("actuators", 0, "stall")),
    "a stall of pd": (TREE, (row_of(".*", kp=1.0, stall=4.0),), {}, "takes no `stall`", None),
    "too much damping": (arm(), (row_of("swing", kp=1.0, damping_ratio=0.1, damping=5.0),), {},
                         "its passive damping alone makes a ratio of 5",
                         ("actuators", 0, "damping_ratio")),
    "a slide and a hinge": (leg(HIP, SLIDE), (PLAIN,), {},
                            "`kp` cannot be in N m/rad and N/m for both", None),
    "a rotary motor": (leg(SLIDE), (row_of("slide", kp=1.0, motor="m"),), {"m": GEARED},
                       "slides, but motor `m` is a rotary one", None),
    "a rotary row": (leg(SLIDE), (row_of("slide", kp=1.0, unit="rotary"),), {},
                     "the row is in rotary units, but joint `slide` is prismatic", None),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_each_wrong_table_has_its_message(case: str):
    tree, rows, motors, words, key = REFUSED[case]
    error = refused(tree, *rows, **motors)
    assert words in f"{error.message}\n{error.hint}"
    assert key in (None, error.key)


def test_a_slide_may_have_a_linear_motor():
    row = row_of("slide", kp=1.0, motor="m", unit="linear")
    (made,) = resolve(leg(SLIDE), (row,), {"m": Motor(rotor_inertia=1.0)})
    assert made.armature == 1.0
