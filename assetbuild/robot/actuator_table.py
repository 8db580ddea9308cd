"""The actuator table: motors, the rows that put them on joints, and what comes of it for each."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from pydantic import Field, model_validator

from assetbuild.errors import RecipeError, did_you_mean, meant_pattern
from assetbuild.findings import Finding, Rule
from assetbuild.recipe_types import Model, NonNegative, Pattern, Positive, Real

ActuatorModel = Literal["pd", "ideal_pd", "dc_motor", "velocity", "motor", "general", "passive"]
Unlimited = Literal["unlimited"]


class Motor(Model):
    """A motor with its gear, reusable by several rows of the actuator table."""

    extends: str | None = Field(
        None, description="another motor, for every value that is not given here"
    )
    rotor_inertia: NonNegative | None = Field(None, description="kg m2, before the gear")
    gear: Positive | None = Field(
        None, description="reduction, without it 1; armature = rotor_inertia * gear^2"
    )
    effort: Positive | None = Field(None, description="N m or N, after the gear")
    velocity: Positive | None = Field(None, description="rad/s or m/s, after the gear")
    stall: Positive | None = Field(
        None, description="torque at rest that the motor itself can make, N m or N, after the gear"
    )
    friction: NonNegative | None = Field(None, description="dry friction, N m or N")
    damping: NonNegative | None = Field(
        None, description="viscous friction of motor and gear, N m s/rad or N s/m"
    )
    source: str = Field("", description="where the numbers come from")

    @property
    def armature(self) -> float | None:
        """Inertia that the joint feels: rotor_inertia * gear^2, kg m2; None without a rotor."""
        return None if self.rotor_inertia is None else self.rotor_inertia * (self.gear or 1.0) ** 2


class General(Model):
    """The parameters of MuJoCo's general actuator, in its own names, order and units."""

    dyntype: Literal["none", "integrator", "filter", "filterexact", "muscle"] = Field(
        "none", description="activation dynamics"
    )
    gaintype: Literal["fixed", "affine", "muscle"] = Field("fixed", description="kind of gain")
    biastype: Literal["none", "affine", "muscle"] = Field("none", description="kind of bias")
    dynprm: tuple[Real, ...] = Field((), max_length=10, description="parameters of the dynamics")
    gainprm: tuple[Real, ...] = Field((), max_length=10, description="parameters of the gain")
    biasprm: tuple[Real, ...] = Field((), max_length=10, description="parameters of the bias")


class ActuatorRow(Model):
    """One row of the actuator table; every moving joint matches exactly one."""

    joints: Pattern = Field(description="matches whole joint names")
    model: ActuatorModel = Field(
        "pd", description="pd is implicit: the simulator integrates the gains"
    )
    motor: str | None = Field(None, description="name in `motors`")
    unit: Literal["rotary", "linear"] | None = Field(
        None,
        description="what the numbers of this row are for: N m and rad, or N and m; "
        "an error where a joint of the other kind matches",
    )
    kp: NonNegative | None = Field(None, description="N m/rad or N/m")
    kd: NonNegative | None = Field(None, description="of the drive, N m s/rad or N s/m")
    frequency: Annotated[float, Field(gt=0, le=1e6)] | None = Field(
        None, description="instead of kp: natural frequency of the joint, Hz"
    )
    damping_ratio: Annotated[float, Field(ge=0, le=1e6)] | None = Field(
        None, description="instead of kd: of drive and joint together; 1 = critical"
    )
    inertia: Literal["home", "armature"] = Field(
        "home",
        description="what `frequency` moves: the joint with all it carries in its initial pose "
        "(keyframe `home`, else the first), "
        "or the motor's armature alone (mjlab's convention)",
    )
    damping: NonNegative | None = Field(
        None, description="passive, of the joint; without it the motor's, else the source's own"
    )
    friction: NonNegative | None = Field(
        None, description="dry; without it the motor's, else the source's own"
    )
    armature: NonNegative | None = Field(None, description="kg m2; without it the motor's")
    effort: Positive | Unlimited | None = Field(
        None, description="without it the motor's, else the source's"
    )
    velocity: Positive | Unlimited | None = Field(
        None, description="without it the motor's, else the source's"
    )
    stall: Positive | None = Field(
        None,
        description="of `dc_motor` alone: torque at rest, from which the motor's torque falls to 0 "
        "at `velocity`; without it the motor's, else `effort`",
    )
    ctrl: tuple[Real, Real] | Literal["limits", "reach"] | None = Field(
        None,
        description="range of the command. limits: of the joint (pd), its effort or velocity "
        "limit (the others), the default; reach: of pd, the limits and effort/kp beyond them",
    )
    general: General | None = Field(None, description="of the model `general` alone")
    measured: tuple[Literal["armature", "damping", "friction", "kp", "kd", "effort"], ...] = Field(
        (),
        description="numbers of this row that were measured, as `assetbuild identify --write` "
        "states them; a fit does not change them any more",
    )
    source: str = Field("", description="where the numbers come from; without it the motor's")
    guessed: bool = Field(
        False,
        description="nobody has stated these numbers: every build warns until they are replaced "
        "by the motor's and this key is removed",
    )

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> ActuatorRow:
        for plain, by in (("kp", "frequency"), ("kd", "damping_ratio")):
            if getattr(self, plain) is not None and getattr(self, by) is not None:
                raise ValueError(f"give `{plain}` or `{by}`, not both")
        if isinstance(self.ctrl, tuple) and not self.ctrl[0] < self.ctrl[1]:
            raise ValueError(f"`ctrl`: the low end must be below the high: {list(self.ctrl)}")
        return self


@dataclass(frozen=True)
class Actuator:
    """What drives, brakes and limits one moving joint. Each moving joint has exactly one.

    kp: N m/rad (N/m); kd: of the drive, N m s/rad; damping: passive, of the joint; they add up.
    effort: N m or N; velocity: rad/s or m/s; armature: reflected rotor inertia, kg m2 or kg;
    friction: dry, N m or N. None = unlimited.
    stall: of a `dc_motor`, its torque at rest, N m or N; None = not stated.
    ctrl: range of the command in the unit of the model; None = the target's rule.
    general: of the model `general` alone.
    motor: name in the recipe's motor table; source: where its numbers come from; measured: which of
    them were fitted to logs of the real robot.
    name: of the drive where it is not the joint's own.
    gear: of the drive in MuJoCo, which its commands there count in. All numbers here are already
    on the joint: with the force f of MuJoCo's actuator and its length l, effort = gear f and
    l = gear q. The parameters of `general` alone are the actuator's own.
    """

    joint: str
    model: ActuatorModel
    kp: float = 0.0
    kd: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0
    effort: float | None = None
    velocity: float | None = None
    stall: float | None = None
    ctrl: tuple[float, float] | None = None
    general: General | None = None
    motor: str = ""
    source: str = ""
    name: str = ""
    gear: float = 1.0
    measured: tuple[str, ...] = ()

    @property
    def command_gear(self) -> float:
        """MuJoCo's command for a command of 1 on the joint: a position, a speed or an effort."""
        if self.model in ("pd", "velocity"):
            return self.gear
        return 1.0 if self.model == "general" else 1.0 / self.gear

    @property
    def saturation(self) -> float | None:
        """Torque of a `dc_motor` at rest, N m or N; where none is stated, its effort limit."""
        return self.effort if self.stall is None else self.stall

    @property
    def undriven(self) -> Actuator:
        """The joint's own numbers."""
        kept = Actuator(self.joint, "passive", damping=self.damping, friction=self.friction)
        return replace(kept, armature=self.armature)


def without_stall(rule: Rule, actuators: Iterable[Actuator]) -> Iterator[Finding]:
    """One finding for all `dc_motor`s whose torque at rest a trainer has to guess."""
    unstated = [a.joint for a in actuators if a.model == "dc_motor" and a.stall is None]
    if unstated:
        yield rule(
            f"actuator {unstated[0]}",
            f"the table states no stall torque: {len(unstated)} joints take their effort limit for "
            "it, so half of the torque is left at half of the velocity limit",
            hint="a motor's stall torque is often higher: give `stall` in the row or the motor",
            data={"joints": tuple(unstated)},
        )


Key = tuple[str | int, ...]


class RowError(RecipeError):
    """A table of the recipe does not fit the robot.

    key: the place in the recipe, as a path; steps know no lines.
    """

    def __init__(self, message: str, *, key: Key, hint: str = "") -> None:
        super().__init__(message, hint=hint)
        self.key = key


def must_match(key: Key, pattern: str, names: Collection[str], what: str, hint: str = "") -> None:
    """RowError for a pattern at `key` of the recipe that matches none of the names."""
    if not any(re.fullmatch(pattern, name) for name in names):
        message = f"{'.'.join(map(str, key[:2]))}: pattern `{pattern}` matches no {what}"
        raise RowError(message, key=key, hint=hint or meant_pattern(pattern, names))


def extended(name: str, motors: Mapping[str, Motor]) -> Motor:
    """A motor with what it does not say taken from the one it extends, and so on.

    Raises RowError for a parent that is not there, or a circle.
    """
    chain = [name]
    motor = motors[name]
    while motor.extends is not None:
        parent, key = motor.extends, ("motors", chain[-1], "extends")
        if parent not in motors:
            message = f"motors.{chain[-1]}: no motor named `{parent}`"
            raise RowError(message, key=key, hint=did_you_mean(parent, motors))
        if parent in chain:
            circle = " -> ".join((*chain, parent))
            raise RowError(f"motors extend each other in a circle: {circle}", key=key)
        chain.append(parent)
        above = motors[parent]
        stated = {k: v for k, v in motor if v not in (None, "") and k != "extends"}
        motor = above.model_copy(update=stated)
    return motor
