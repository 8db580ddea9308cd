"""The actuator table in MJCF's words: joint attributes and one actuator element per joint.

| model | MJCF |
|---|---|
| pd | `<position>` kp, kv, forcerange; targets are clipped to the joint's range |
| ideal_pd, dc_motor, motor | `<motor>`, ctrlrange = effort: the torque comes from outside |
| velocity | `<velocity>` kv, forcerange, ctrlrange = the velocity limit |
| general | `<general>` with its own parameters, forcerange = effort |
| passive | no actuator |

A row's own range of the command (`ctrl`) comes before these rules.

Damping of the joint and `kv` of the drive add up in MuJoCo, as `damping` and `kd` do here.
`dampratio` is not written: its meaning changed between versions of MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Actuator, Control, General, Joint, Tree
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
class Drive:
    """One actuator element without its name and joint. tag: position, velocity or motor."""

    tag: str
    attributes: Mapping[str, str]


@dataclass(frozen=True)
class Row:
    """One moving joint: what its `<joint>` and its actuator say beyond their names.

    attributes: of the joint, MuJoCo's defaults left out; motor: the recipe's name, or "";
    name: of the drive, or "".
    """

    joint: Joint
    attributes: Mapping[str, str]
    drive: Drive | None = None
    motor: str = ""
    name: str = ""


def row_of(joint: Joint, actuator: Actuator | None) -> Row:
    """A moving joint and its actuator; StepError for a range that MJCF cannot express.

    Without an actuator the joint keeps the damping and friction of the source.
    """
    damping = actuator.damping if actuator else joint.damping or 0.0
    friction = actuator.friction if actuator else joint.friction or 0.0
    armature = actuator.armature if actuator else 0.0
    attributes = {
        "type": "slide" if joint.kind == "prismatic" else None,
        "axis": direction(joint.axis),
        "range": _range(joint),
        "damping": number(damping) if damping else None,
        "frictionloss": number(friction) if friction else None,
        "armature": number(armature) if armature else None,
    }
    return Row(
        joint,
        {key: value for key, value in attributes.items() if value is not None},
        _drive(joint, actuator) if actuator else None,
        actuator.motor if actuator else "",
        actuator.name if actuator else "",
    )


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
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind not in ("revolute", "prismatic") or joint.mimic is not None:
        return None
    return lower if lower is not None and lower == upper else None


def _drive(joint: Joint, actuator: Actuator) -> Drive | None:
    effort = numbers((-actuator.effort, actuator.effort)) if actuator.effort else None
    match actuator.model:
        case "passive":
            return None
        case "pd":
            attributes = {
                "kp": number(actuator.kp),
                "kv": number(actuator.kd) if actuator.kd else None,
                "forcerange": effort,
                "inheritrange": "1" if _range(joint) else None,
            }
            tag = "position"
        case "velocity":
            speed = actuator.velocity
            attributes = {
                "kv": number(actuator.kd),
                "forcerange": effort,
                "ctrlrange": numbers((-speed, speed)) if speed else None,
            }
            tag = "velocity"
        case "ideal_pd" | "dc_motor" | "motor":
            attributes, tag = {"ctrlrange": effort}, "motor"
        case "general":
            attributes, tag = {"forcerange": effort, **_general(actuator)}, "general"
    if actuator.ctrl is not None:
        attributes |= {"inheritrange": None, "ctrlrange": numbers(actuator.ctrl)}
    return Drive(tag, {key: value for key, value in attributes.items() if value is not None})


def _general(actuator: Actuator) -> dict[str, str | None]:
    """MuJoCo's own parameters, its defaults left out; StepError without any."""
    general = actuator.general
    if general is None:
        raise StepError(f"actuator {actuator.joint}: model `general` without its parameters")
    default = General()
    words = ("dyntype", "gaintype", "biastype")
    vectors = ("dynprm", "gainprm", "biasprm")
    return {
        **{w: getattr(general, w) for w in words if getattr(general, w) != getattr(default, w)},
        **{v: numbers(getattr(general, v)) for v in vectors if getattr(general, v)},
    }


def actuator_names(rows: tuple[Row, ...]) -> dict[str, str]:
    """Actuator name by joint name: its own, else the joint's without `_joint`, where unique."""
    short = [row.name or row.joint.name.removesuffix("_joint") or row.joint.name for row in rows]
    return {
        row.joint.name: name if short.count(name) == 1 else row.joint.name
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
