"""The actuator table: rows and motors of the recipe onto the moving joints of a tree.

Rules. Every moving joint that does not mimic another is matched by exactly one row, by its whole
name. A number comes from the row, else from the row's motor, else from the source's joint, else it
is zero (damping, friction, armature) or absent (velocity). A mimic joint that no row matches is
`passive`, with its own damping and friction. Without any row every moving joint is `passive`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from assetbuild.errors import RecipeError, did_you_mean
from assetbuild.robot.model import Actuator, ActuatorModel, Joint, Tree

Key = tuple[str | int, ...]

DRIVEN: frozenset[str] = frozenset({"pd", "ideal_pd", "dc_motor", "velocity", "motor"})
"""Models that push, so they need an effort limit."""
_NEEDS: Mapping[str, tuple[str, ...]] = {
    "pd": ("kp",),
    "ideal_pd": ("kp",),
    "velocity": ("kd",),
}
_REFUSES: Mapping[str, tuple[str, ...]] = {
    "velocity": ("kp",),
    "motor": ("kp", "kd"),
    "passive": ("kp", "kd"),
}


class RowError(RecipeError):
    """A table of the recipe does not fit the robot.

    key: the place in the recipe, as a path for `LoadedRecipe.where`; steps know no lines.
    """

    def __init__(self, message: str, *, key: Key, hint: str = "") -> None:
        super().__init__(message, hint=hint)
        self.key = key

    @property
    def index(self) -> int | None:
        """The row of the actuator table; None when the error is about the table as a whole."""
        numbers = [part for part in self.key[1:2] if isinstance(part, int)]
        return numbers[0] if numbers else None

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (self.message, self.key, self.hint)


def _rebuild(message: str, key: Key, hint: str) -> RowError:
    return RowError(message, key=key, hint=hint)


@dataclass(frozen=True)
class MotorSpec:
    """A motor with its gear. rotor_inertia: kg m2 before the gear; the rest after the gear, SI."""

    rotor_inertia: float | None = None
    gear: float = 1.0
    effort: float | None = None
    velocity: float | None = None
    friction: float | None = None
    source: str = ""

    @property
    def armature(self) -> float | None:
        """Inertia that the joint feels: rotor_inertia * gear^2, kg m2; None without a rotor."""
        return None if self.rotor_inertia is None else self.rotor_inertia * self.gear**2


NO_MOTOR = MotorSpec()


@dataclass(frozen=True)
class RowSpec:
    """One row of the table. joints: pattern for whole joint names; None = the row says nothing."""

    joints: str
    model: ActuatorModel = "pd"
    motor: str | None = None
    kp: float | None = None
    kd: float | None = None
    damping: float | None = None
    friction: float | None = None
    armature: float | None = None
    effort: float | None = None
    velocity: float | None = None


@dataclass(frozen=True)
class _Matched:
    """A row with its index in the table and its motor."""

    index: int
    row: RowSpec
    motor: MotorSpec = field(default=NO_MOTOR)

    def error(self, key: str, message: str, hint: str = "") -> RowError:
        return RowError(
            f"actuators[{self.index}]: {message}", key=("actuators", self.index, key), hint=hint
        )


def resolve(
    tree: Tree, rows: Sequence[RowSpec], motors: Mapping[str, MotorSpec]
) -> tuple[Actuator, ...]:
    """One actuator for each moving joint, in tree order. Raises RowError, see the module."""
    table = [_Matched(i, row, _motor_of(i, row, motors)) for i, row in enumerate(rows)]
    for entry in table:
        _check_gains(entry)
    by_joint = _match(tree, table) if table else {}
    made = []
    for joint in tree.moving_joints:
        matched = by_joint.get(joint.name)
        made.append(_driven(joint, matched) if matched else _passive(joint))
    return tuple(made)


def check_rows(tree: Tree, rows: Sequence[RowSpec], motors: Mapping[str, MotorSpec]) -> None:
    """Raise the RowError that `resolve` would raise; for a plan that knows the tree."""
    resolve(tree, rows, motors)


def _motor_of(index: int, row: RowSpec, motors: Mapping[str, MotorSpec]) -> MotorSpec:
    if row.motor is None:
        return NO_MOTOR
    if row.motor not in motors:
        hint = did_you_mean(row.motor, motors) or "the recipe has no `motors`"
        message = f"no motor named `{row.motor}`"
        raise _Matched(index, row).error("motor", message, hint)
    return motors[row.motor]


def _check_gains(entry: _Matched) -> None:
    row = entry.row
    for name in _REFUSES.get(row.model, ()):
        if getattr(row, name) is not None:
            raise entry.error(
                name,
                f"model `{row.model}` takes no `{name}`",
                "`damping` is the passive one" if name == "kd" else "remove it, or use `pd`",
            )
    for name in _NEEDS.get(row.model, ()):
        if getattr(row, name) is None:
            raise entry.error("model", f"model `{row.model}` needs `{name}`", f"add `{name}: ...`")


def _match(tree: Tree, table: list[_Matched]) -> dict[str, _Matched]:
    """The row of each joint. Raises RowError for idle rows, double matches, joints left over."""
    moving = [joint.name for joint in tree.moving_joints]
    found: dict[str, _Matched] = {}
    for entry in table:
        names = [name for name in moving if re.fullmatch(entry.row.joints, name)]
        if not names:
            raise _idle(entry, tree, moving)
        twice = [name for name in names if name in found]
        if twice:
            first = found[twice[0]]
            raise entry.error(
                "joints",
                f"{_listed(twice)} already matched by row {first.index} (`{first.row.joints}`)",
                "each moving joint matches exactly one row; narrow one of the two patterns",
            )
        found |= dict.fromkeys(names, entry)
    left = [j.name for j in tree.moving_joints if j.mimic is None and j.name not in found]
    if left:
        raise RowError(
            f"actuators: no row matches {_listed(left)}",
            key=("actuators",),
            hint="add a row; `model: passive` for a joint without a drive",
        )
    return found


def _idle(entry: _Matched, tree: Tree, moving: list[str]) -> RowError:
    pattern = entry.row.joints
    still = [j.name for j in tree.joints if re.fullmatch(pattern, j.name)]
    if still:
        return entry.error("joints", f"`{pattern}` matches only joints that do not move")
    return entry.error(
        "joints", f"pattern `{pattern}` matches no moving joint", did_you_mean(pattern, moving)
    )


def _driven(joint: Joint, entry: _Matched) -> Actuator:
    row, motor, limits = entry.row, entry.motor, joint.limits
    # A source that says effort or velocity 0 says nothing: the joint could never move.
    effort = row.effort or motor.effort or limits.effort or None
    velocity = row.velocity or motor.velocity or limits.velocity or None
    if effort is None and row.model in DRIVEN:
        raise _without(entry, joint, "effort", limits.effort)
    if velocity is None and row.model == "dc_motor":
        raise _without(entry, joint, "velocity", limits.velocity)
    return Actuator(
        joint=joint.name,
        model=row.model,
        kp=row.kp or 0.0,
        kd=row.kd or 0.0,
        damping=_first(row.damping, joint.damping),
        friction=_first(row.friction, motor.friction, joint.friction),
        armature=_first(row.armature, motor.armature),
        effort=effort,
        velocity=velocity,
        motor=row.motor or "",
        source=motor.source,
    )


def _without(entry: _Matched, joint: Joint, name: str, stated: float | None) -> RowError:
    source = f"the source says {stated:g}" if stated is not None else "the source states none"
    return entry.error(
        "model",
        f"model `{entry.row.model}` needs the limit `{name}` of joint `{joint.name}`; {source}",
        f"add `{name}` to the row or its motor",
    )


def _passive(joint: Joint) -> Actuator:
    return Actuator(
        joint=joint.name,
        model="passive",
        damping=_first(joint.damping),
        friction=_first(joint.friction),
        effort=joint.limits.effort or None,
        velocity=joint.limits.velocity or None,
    )


def _first(*values: float | None) -> float:
    return next((value for value in values if value is not None), 0.0)


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(f"`{name}`" for name in names[:8])
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return f"{'joint' if len(names) == 1 else 'joints'} {shown}{more}"
