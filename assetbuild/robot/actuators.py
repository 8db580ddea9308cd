"""The actuator table: rows and motors of the recipe onto the moving joints of a tree.

Rules. Every moving joint that does not mimic another is matched by exactly one row, by its whole
name. A number comes from the row, else from the row's motor, else from the source's joint, else it
is zero (damping, friction, armature) or absent (velocity). A mimic joint that no row matches is
`passive`, with its own damping and friction. Without any row every moving joint is `passive`.
Gains by natural frequency f and damping ratio z act on an inertia I, of the joint with all that it
carries in the initial pose, or of the motor alone: kp = I (2 pi f)^2 and
kd = 2 z sqrt(kp I) - damping, because drive and joint damp together.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from assetbuild.errors import Gather, did_you_mean, meant_pattern, quoted
from assetbuild.robot.actuator_table import ActuatorRow, Motor, extended
from assetbuild.robot.actuator_table import RowError as RowError
from assetbuild.robot.closure import felt_inertia
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.model import Actuator, Joint, Loop, Tree

DRIVEN: frozenset[str] = frozenset({"pd", "ideal_pd", "dc_motor", "velocity", "motor"})
"""Models that push, so they need an effort limit."""
_NEEDS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "pd": (("kp", "frequency"),),
    "ideal_pd": (("kp", "frequency"),),
    "velocity": (("kd",),),
    "general": (("general",),),
}
"""What a model needs: of each tuple one."""
_BY_FREQUENCY = ("frequency", "damping_ratio")
_REFUSES: Mapping[str, tuple[str, ...]] = {
    "pd": ("general", "stall"),
    "ideal_pd": ("general", "stall"),
    "dc_motor": ("general",),
    "velocity": ("kp", "general", "stall", *_BY_FREQUENCY),
    "motor": ("kp", "kd", "general", "stall", *_BY_FREQUENCY),
    "general": ("kp", "kd", "stall", *_BY_FREQUENCY),
    "passive": ("kp", "kd", "general", "stall", "ctrl", *_BY_FREQUENCY),
}
UNITS = {"prismatic": "linear", "revolute": "rotary", "continuous": "rotary"}


NO_MOTOR = Motor.model_validate({})


@dataclass(frozen=True)
class _Matched:
    """A row with its index in the table and its motor."""

    index: int
    row: ActuatorRow
    motor: Motor = field(default=NO_MOTOR)

    @property
    def is_tuned(self) -> bool:
        """Whether a natural frequency or a damping ratio makes its gains."""
        return self.row.frequency is not None or self.row.damping_ratio is not None

    def error(self, key: str, message: str, hint: str = "") -> RowError:
        return RowError(
            f"actuators[{self.index}]: {message}", key=("actuators", self.index, key), hint=hint
        )


def resolve(
    tree: Tree,
    rows: Sequence[ActuatorRow],
    motors: Mapping[str, Motor],
    start: Mapping[str, float] | None = None,
    driven: Collection[str] = (),
    loops: Sequence[Loop] = (),
) -> tuple[Actuator, ...]:
    """One actuator for each moving joint, in tree order. Raises RowError, see the module.

    start: positions by joint name at which `inertia: home` is taken, rad or m; None = all 0.
    driven: joints that need no row, because their source says what drives them. loops: closed at
    `start`; what a joint of theirs moves there is taken with all that follows through them.
    """
    wrong, table = Gather(RowError), []
    for index, row in enumerate(rows):
        with wrong:
            table.append(_Matched(index, row, NO_MOTOR))
            table[-1] = _Matched(index, row, motor_of(index, row, motors))
            _check_gains(table[-1])
    by_joint = _match(tree, table, driven, wrong) if table else {}
    wrong.stop()
    for joint in tree.moving_joints:
        if joint.name in by_joint:
            with wrong:
                _check_units(joint, by_joint[joint.name], by_joint, tree)
    wrong.stop()
    made = {
        joint.name: _driven(joint, by_joint[joint.name])
        if joint.name in by_joint
        else joint.undriven
        for joint in tree.moving_joints
    }
    armature = {name: actuator.armature for name, actuator in made.items()}
    carried: Mapping[str, float] = {}
    if any(entry.is_tuned and entry.row.inertia == "home" for entry in by_joint.values()):
        # No position says where a ball joint stands.
        balls = any(joint.kind == "ball" for joint in tree.joints)
        carried = felt_inertia(() if balls else loops, dynamics(tree, start or {}, armature))
    for name, entry in by_joint.items():
        if entry.is_tuned:
            inertia = (carried if entry.row.inertia == "home" else armature).get(name, 0.0)
            made[name] = _tuned(made[name], entry, inertia)
        if entry.row.ctrl == "reach":
            made[name] = replace(made[name], ctrl=_reach(entry, tree.by_joint[name], made[name]))
    return tuple(made.values())


def motor_of(index: int, row: ActuatorRow, motors: Mapping[str, Motor]) -> Motor:
    """The motor that a row of the table names, with what it extends. RowError."""
    if row.motor is None:
        return NO_MOTOR
    if row.motor not in motors:
        hint = did_you_mean(row.motor, motors) or "the recipe has no `motors`"
        message = f"no motor named `{row.motor}`"
        raise _Matched(index, row).error("motor", message, hint)
    return extended(row.motor, motors)


def _check_gains(entry: _Matched) -> None:
    row = entry.row
    for name in _REFUSES.get(row.model, ()):
        if getattr(row, name) is not None:
            raise entry.error(
                name,
                f"model `{row.model}` takes no `{name}`",
                "`damping` is the passive one" if name == "kd" else "remove it, or use `pd`",
            )
    for names in _NEEDS.get(row.model, ()):
        if all(getattr(row, name) is None for name in names):
            wanted = " or ".join(f"`{name}`" for name in names)
            raise entry.error("model", f"model `{row.model}` needs {wanted}", f"add {wanted}")
    if row.damping_ratio is not None and row.kp is None and row.frequency is None:
        raise entry.error("damping_ratio", "`damping_ratio` needs `kp` or `frequency` beside it")
    if row.inertia != "home" and not entry.is_tuned:
        raise entry.error("inertia", "`inertia` says what `frequency` or `damping_ratio` move")


def _check_units(
    joint: Joint, entry: _Matched, by_joint: Mapping[str, _Matched], tree: Tree
) -> None:
    """Numbers of one row cannot be in N m and in N: RowError where they would have to be."""
    row, unit = entry.row, UNITS[joint.kind]
    if row.unit is not None and row.unit != unit:
        message = f"the row is in {row.unit} units, but joint `{joint.name}` is {joint.kind}"
        raise entry.error("unit", message, _OWN_ROW)
    if unit != "linear":
        return
    if row.unit is None and entry.motor.rotor_inertia is not None and row.armature is None:
        raise entry.error(
            "motor",
            f"joint `{joint.name}` slides, but motor `{row.motor}` is a rotary one: "
            "rotor_inertia * gear^2 is kg m2 where the joint needs kg",
            "give the row an `armature` in kg; or `unit: linear` when `gear` is in rad/m",
        )
    stated = [name for name in _WITH_UNIT if getattr(row, name)]
    turning = [j for j in tree.moving_joints if UNITS[j.kind] == "rotary"]
    also = [j.name for j in turning if by_joint.get(j.name) is entry]
    if stated and also:
        raise entry.error(
            stated[0],
            f"the row matches `{also[0]}`, which turns, and `{joint.name}`, which slides: "
            f"its `{stated[0]}` cannot be in {_WITH_UNIT[stated[0]]} for both",
            _OWN_ROW,
        )


_OWN_ROW = "give joints that slide a row of their own, in N, N/m and N s/m"
_WITH_UNIT: Mapping[str, str] = {
    "kp": "N m/rad and N/m",
    "kd": "N m s/rad and N s/m",
    "damping": "N m s/rad and N s/m",
    "friction": "N m and N",
    "armature": "kg m2 and kg",
    "effort": "N m and N",
    "stall": "N m and N",
    "velocity": "rad/s and m/s",
}


def _match(
    tree: Tree, table: list[_Matched], driven: Collection[str], wrong: Gather
) -> dict[str, _Matched]:
    """The row of each joint; idle rows, double matches and joints left over go to `wrong`."""
    moving = [joint.name for joint in tree.moving_joints]
    by_joint: dict[str, _Matched] = {}
    for entry in table:
        names = [name for name in moving if re.fullmatch(entry.row.joints, name)]
        twice = [name for name in names if name in by_joint]
        with wrong:
            if not names:
                raise _idle(entry, tree, moving)
            if twice:
                first = by_joint[twice[0]]
                raise entry.error(
                    "joints",
                    f"{_listed(twice)} already matched by row {first.index} (`{first.row.joints}`)",
                    "each moving joint matches exactly one row; narrow one of the two patterns",
                )
        by_joint |= dict.fromkeys(names, entry)
    free = [joint.name for joint in tree.moving_joints if joint.mimic is None]
    left = [name for name in free if name not in by_joint and name not in driven]
    with wrong:
        if left and not wrong.gathered:  # an idle row was meant for them
            raise RowError(
                f"actuators: no row matches {_listed(left)}",
                key=("actuators",),
                hint="add a row; `model: passive` for a joint without a drive",
            )
    return by_joint


def _idle(entry: _Matched, tree: Tree, moving: list[str]) -> RowError:
    pattern = entry.row.joints
    still = [j.name for j in tree.joints if re.fullmatch(pattern, j.name)]
    if still:
        return entry.error("joints", f"`{pattern}` matches only joints that do not move")
    return entry.error(
        "joints", f"pattern `{pattern}` matches no moving joint", meant_pattern(pattern, moving)
    )


def _driven(joint: Joint, entry: _Matched) -> Actuator:
    row, motor, limits = entry.row, entry.motor, joint.limits
    # A source that says effort or velocity 0 says nothing: the joint could never move.
    effort = _limit(row.effort, motor.effort, limits.effort)
    velocity = _limit(row.velocity, motor.velocity, limits.velocity)
    is_dc_motor = row.model == "dc_motor"
    if effort is None and row.model in DRIVEN and (is_dc_motor or row.effort != "unlimited"):
        raise _without(entry, joint, "effort", limits.effort)
    if velocity is None and is_dc_motor:
        raise _without(entry, joint, "velocity", limits.velocity)
    stall = (row.stall or motor.stall) if is_dc_motor else None
    if effort is not None and stall is not None and stall < effort:
        raise entry.error(
            "stall" if row.stall else "motor",
            f"joint `{joint.name}`: the stall torque {stall:g} is below the effort limit "
            f"{effort:g}, which the motor could never reach",
            "correct `stall`, or lower `effort`",
        )
    return Actuator(
        joint=joint.name,
        model=row.model,
        kp=row.kp or 0.0,
        kd=row.kd or 0.0,
        damping=_first(row.damping, motor.damping, joint.damping),
        friction=_first(row.friction, motor.friction, joint.friction),
        armature=_first(row.armature, motor.armature),
        effort=effort,
        velocity=velocity,
        stall=stall,
        ctrl=row.ctrl if isinstance(row.ctrl, tuple) else None,
        general=row.general,
        motor=row.motor or "",
        source=row.source or motor.source,
        measured=row.measured,
    )


def _limit(row: float | str | None, *others: float | None) -> float | None:
    if row == "unlimited":
        return None
    return next(
        (value for value in (row, *others) if isinstance(value, float | int) and value), None
    )


def _tuned(actuator: Actuator, entry: _Matched, inertia: float) -> Actuator:
    """Return the drive with kp and kd from its row and the inertia that it moves, kg m2 or kg."""
    row, kp, kd = entry.row, actuator.kp, actuator.kd
    if not 0.0 < inertia < math.inf:
        what = "nothing that has mass" if row.inertia == "home" else "no armature"
        raise entry.error(
            "frequency" if row.frequency is not None else "damping_ratio",
            f"joint `{actuator.joint}` moves {what}: a frequency or damping ratio means nothing",
            "give kp and kd, or the motor's rotor_inertia",
        )
    if row.frequency is not None:
        kp = inertia * (2.0 * math.pi * row.frequency) ** 2
    if row.damping_ratio is not None:
        kd = 2.0 * row.damping_ratio * math.sqrt(kp * inertia) - actuator.damping
        if kd < 0.0:
            ratio = actuator.damping / (2.0 * math.sqrt(kp * inertia))
            raise entry.error(
                "damping_ratio",
                f"joint `{actuator.joint}`: its passive damping alone makes a ratio of {ratio:.3g}",
                "ask for more, or state a smaller `damping`",
            )
    return replace(actuator, kp=kp, kd=kd)


def _reach(entry: _Matched, joint: Joint, actuator: Actuator) -> tuple[float, float]:
    """Targets that still make more force: effort / kp beyond the limits."""
    if actuator.model != "pd" or not actuator.kp or actuator.effort is None:
        raise entry.error("ctrl", "`reach` needs model `pd` with kp and an effort limit")
    if joint.range is None:
        raise entry.error("ctrl", f"`reach`: joint `{joint.name}` has no limits to go beyond")
    (lower, upper), beyond = joint.range, actuator.effort / actuator.kp
    return lower - beyond, upper + beyond


def _without(entry: _Matched, joint: Joint, name: str, stated: float | None) -> RowError:
    source = f"the source says {stated:g}" if stated is not None else "the source states none"
    if getattr(entry.row, name) == "unlimited":
        source = "its row says `unlimited`"
    return entry.error(
        "model",
        f"model `{entry.row.model}` needs the limit `{name}` of joint `{joint.name}`; {source}",
        f"add `{name}` to the row or its motor",
    )


def _first(*values: float | None) -> float:
    return next((value for value in values if value is not None), 0.0)


def _listed(names: Sequence[str]) -> str:
    word = "joint" if len(names) == 1 else "joints"
    return f"{word} {quoted(names, 8, ' and {} more')}"
