"""The actuator table in MJCF's words: joint attributes and one actuator element per joint.

| model | MJCF |
|---|---|
| pd | `<position>` kp, kv, forcerange; targets are clipped to the joint's range |
| ideal_pd, dc_motor, motor | `<motor>`, ctrlrange = effort: the torque comes from outside |
| velocity | `<velocity>` kv, forcerange, ctrlrange = the velocity limit |
| general | `<general>` with its own parameters, forcerange = effort |
| passive | no actuator |

A row's own range of the command (`ctrl`) comes before these rules; a motor that may be asked for
more than its effort has that as its forcerange. A drive of an MJCF keeps its `gear`: gains, limits
and commands are divided by it again. With a gear the laws of `<position>` and `<velocity>` are a
`<general>`, as Newton 1.8 drops the gear of these two.

Damping of the joint and `kv` of the drive add up in MuJoCo, as `damping` and `kd` do here.
`dampratio` is not written: its meaning changed between versions of MuJoCo.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.grouping import grouped
from assetbuild.robot.model import Actuator, Control, General, Joint, Softness, Tree
from assetbuild.targets.mjcf.classes import (
    FAMILY_MEMBERS,
    ClassNames,
    DefaultClass,
    Row,
    Said,
    class_of,
    joined,
    shared,
    shared_words,
    usual,
)
from assetbuild.targets.mjcf.xml import direction, number, numbers

EXTERNAL = ("ideal_pd", "dc_motor")
"""Models whose gains act outside the simulator."""
PLACING = frozenset({"type", "axis", "range", "inheritrange"})
"""Attributes that belong to the place of a joint, not to its motor."""

VELOCITY_LIMIT = Rule(
    "mjcf.velocity_limit", "info", "MJCF has no velocity limit", "enforce it in the controller"
)
EXTERNAL_GAINS = Rule(
    "mjcf.external_gains",
    "info",
    "torque motors: their gains belong to the controller",
    "apply them there, or `model: pd`",
)


@dataclass(frozen=True)
class JointRow(Row):
    """One moving joint: what its `<joint>` and its actuator, if any, say beyond their names.

    motor: the recipe's name, or ""; drive_name: or "".
    """

    motor: str = ""
    drive_name: str = ""

    @property
    def drive(self) -> str:
        """Tag of the actuator element: position, velocity, motor, general; "" for none."""
        return next((tag for tag in self.attributes if tag != "joint"), "")


def row_of(joint: Joint, actuator: Actuator, limits: Softness | None) -> JointRow:
    """A moving joint and its actuator; StepError for a range that MJCF cannot express."""
    attributes = {
        "type": "slide" if joint.kind == "prismatic" else None,
        "axis": direction(joint.axis),
        "range": _range(joint),
        "damping": number(actuator.damping) if actuator.damping else None,
        "frictionloss": number(actuator.friction) if actuator.friction else None,
        "armature": number(actuator.armature) if actuator.armature else None,
        "solreflimit": numbers(limits.solref) if limits else None,
        "solimplimit": numbers(limits.solimp) if limits else None,
    }
    stated = {
        tag: {key: value for key, value in values.items() if value is not None}
        for tag, values in {"joint": attributes, **_drive(joint, actuator)}.items()
    }
    return JointRow(joint.name, stated, actuator.motor, actuator.name)


def _range(joint: Joint) -> str | None:
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous" or (lower is None and upper is None):
        return None
    if lower is None or upper is None:
        raise StepError(
            f"joint {joint.name}: only one of lower and upper limit is given; MJCF needs both",
            hint="state both limits in the source",
        )
    if not lower < upper:
        return None  # MJCF wants a range that opens: see `locked_at`; `lint_links` judges the rest
    return numbers((lower, upper))


def locked_at(joint: Joint) -> float | None:
    """Where equal limits hold a joint, rad or m; None when it is free to move.

    Such a joint keeps its degree of freedom and is held by an equality: MJCF has no range of
    width 0. A mimic joint is held by the one it follows.
    """
    free = joint.kind not in ("revolute", "prismatic") or joint.mimic is not None
    return None if free or not joint.is_locked else joint.limits.lower


def _drive(joint: Joint, actuator: Actuator) -> dict[str, dict[str, str | None]]:
    """The attributes of the actuator element by its tag; nothing for a passive joint."""
    gear, square = actuator.gear, actuator.gear * actuator.gear
    force = (actuator.effort or 0.0) / abs(gear)
    effort = numbers((-force, force)) if force else None
    speed = numbers((-actuator.velocity, actuator.velocity)) if actuator.velocity else None
    match actuator.model:
        case "passive":
            return {}
        case "pd":
            tag = "position"
            attributes = {
                "kp": number(actuator.kp),
                "kv": number(actuator.kd) if actuator.kd else None,
                "forcerange": effort,
                "inheritrange": "1" if _range(joint) else None,
            }
            if gear != 1.0:
                tag, attributes = "general", _geared(actuator.kp, actuator.kd, square, actuator.kp)
                attributes["forcerange"] = effort
        case "velocity":
            tag = "velocity"
            attributes = {"kv": number(actuator.kd), "forcerange": effort, "ctrlrange": speed}
            if gear != 1.0:
                tag, attributes = "general", _geared(0.0, actuator.kd, square, actuator.kd)
                attributes |= {"forcerange": effort, "ctrlrange": speed}
        case "general":
            tag, attributes = "general", {"forcerange": effort, **_general(actuator)}
        case _:
            asked = max(-actuator.ctrl[0], actuator.ctrl[1]) if actuator.ctrl else 0.0
            beyond = effort if asked > (actuator.effort or math.inf) else None
            tag, attributes = "motor", {"ctrlrange": effort, "forcerange": beyond}
    if actuator.ctrl is not None:
        ends = sorted(end * actuator.command_gear for end in actuator.ctrl)
        attributes |= {"inheritrange": None, "ctrlrange": numbers(ends)}
    if gear != 1.0:
        attributes["gear"] = number(gear)
    return {tag: attributes}


def _geared(kp: float, kd: float, square: float, gain: float) -> dict[str, str | None]:
    """The law of a `<position>` or `<velocity>`; gains on the joint, square: of the gear."""
    bias = numbers((0.0, -kp / square, -kd / square))
    return {"gainprm": number(gain / square), "biastype": "affine", "biasprm": bias}


def _general(actuator: Actuator) -> dict[str, str | None]:
    """MuJoCo's own parameters, its defaults left out; the model's row always states them."""
    general, default = actuator.general or General(), General()
    words = ("dyntype", "gaintype", "biastype")
    vectors = ("dynprm", "gainprm", "biasprm")
    return {
        **{w: getattr(general, w) for w in words if getattr(general, w) != getattr(default, w)},
        **{v: numbers(getattr(general, v)) for v in vectors if getattr(general, v)},
    }


def actuator_names(rows: Sequence[JointRow]) -> dict[str, str]:
    """Actuator name by joint name: its own, else the joint's without `_joint`, where unique."""
    short = [row.drive_name or row.name.removesuffix("_joint") or row.name for row in rows]
    return {
        row.name: name if short.count(name) == 1 else row.name
        for row, name in zip(rows, short, strict=True)
    }


def explain_losses(tree: Tree, control: Control) -> Iterator[Finding]:
    """What of the actuator table MJCF cannot hold."""
    actuators = [control.by_joint[j.name] for j in tree.moving_joints if j.name in control.by_joint]
    limited = [a for a in actuators if a.velocity is not None]
    if limited:
        yield VELOCITY_LIMIT(
            "robot",
            f"MJCF has no velocity limit: those of {len(limited)} joints are not in it",
            hint="enforce them in the controller, or use the USD",
            data={"joints": len(limited)},
        )
    outside = [a for a in actuators if a.model in EXTERNAL]
    if outside:
        yield EXTERNAL_GAINS(
            "robot",
            f"{len(outside)} joints have plain torque motors: the controller applies kp and kd",
            hint="use the model `pd` where MuJoCo should integrate the gains",
            data={"joints": len(outside)},
        )


# --- the classes of joints and drives ------------------------------------------------------------


def joint_classes(robot: str, rows: Sequence[JointRow], names: ClassNames) -> DefaultClass:
    """The class of the robot with those of its motors and families below it.

    Three levels: the robot (what all joints share), its motors (what all joints with one motor,
    gains and limits share), and families (joints of one motor with one axis and range: all hips).
    robot: name of the class, already taken from `names`.
    """
    axis = {"joint": usual(rows, "joint", "axis")}
    adds = joined(axis, shared(rows, axis))
    by_motor = grouped(rows, lambda row: (row.motor, row.drive, _stated(row, placing=False)))
    motors = [_motor_class(group, adds, names) for group in by_motor.values()]
    return class_of(robot, adds, rows, [motor for motor in motors if motor is not None])


def _motor_class(rows: Sequence[JointRow], above: Said, names: ClassNames) -> DefaultClass | None:
    """The class of the joints with one motor, with its families; None: they share nothing."""
    adds = shared(rows, above)
    inside = joined(above, adds)
    families = [
        (group, attributes)
        for group in grouped(rows, partial(_stated, placing=True)).values()
        if len(group) >= FAMILY_MEMBERS and (attributes := shared(group, inside))
    ]
    if not adds and not families:
        return None
    first = rows[0]
    wanted = first.motor or shared_words([row.name for row in rows]) or first.drive or "free"
    name = names.take(wanted, first.name)
    children = []
    for group, attributes in families:
        family = names.take(shared_words([row.name for row in group]) or "joints", group[0].name)
        children.append(DefaultClass(family, attributes, group))
    return class_of(name, adds, rows, children)


def _stated(row: JointRow, *, placing: bool) -> frozenset[tuple[str, str, str]]:
    """(tag, attribute, value) of all that says where the joint is, or of all that does not."""
    return frozenset(
        (tag, key, value)
        for tag, attributes in row.attributes.items()
        for key, value in attributes.items()
        if (key in PLACING) == placing
    )
