"""What was measured, as keys of a recipe: motors of BAM's files, and intervals of fits as ranges.

BAM is Rhoban's "Better Actuator Models", M1 to M6. Its motor is fed a voltage: torque =
kt / R (volts - kt v). Its friction is friction_base + friction_viscous |v| in M1; M2 to M6 add
terms of Stribeck and of the load, which a joint of MuJoCo, USD or URDF does not have. Duclusaud et
al., "Extended friction models for the physics simulation of servo actuators", 2024.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from assetbuild.errors import UsageError
from assetbuild.robot.identify import Fit, Parameter

PLAIN = ("kt", "R", "armature", "friction_base", "friction_viscous")
OF_THE_BENCH = ("q_offset",)
"""Of the test bench, not of the motor."""
WITH_OTHERS = {"dtheta_stribeck": "friction_stribeck", "alpha": "friction_stribeck"}
"""Shapes of a term: nothing without it."""
NOTHING = 1e-9


@dataclass(frozen=True)
class BamMotor:
    """motor: keys of `motors`; kd: of the row, N m s/rad, None = not stated by the file.

    lost: (name, value) of the terms that no joint of ours can hold.
    """

    name: str
    motor: Mapping[str, float | str]
    kd: float | None
    lost: tuple[tuple[str, float], ...]


def read_bam(text: str, file: str, volts: float | None) -> BamMotor:
    """Raises UsageError for a file that is none of BAM's. volts: of the supply."""
    try:
        raw = json.loads(text)
        values = {k: float(v) for k, v in raw.items() if isinstance(v, int | float)}
        name, model = str(raw["actuator"]), str(raw["model"])
        armature, friction = values["armature"], values["friction_base"]
        kt, viscous = values["kt"], values["friction_viscous"]
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise UsageError(f"{file}: not a parameter file of BAM: {error}") from None
    if not all(map(math.isfinite, values.values())) or min(armature, friction, viscous, kt) < 0.0:
        raise UsageError(f"{file}: a parameter is negative or not finite")
    motor: dict[str, float | str] = {
        "rotor_inertia": armature,
        "gear": 1.0,
        "friction": friction,
        "damping": viscous,
    }
    resistance = values.get("R")
    if volts is not None:
        if not resistance:
            raise UsageError(f"{file} states no resistance: `--volts` says nothing about it")
        motor |= {
            "effort": _short(kt * volts / resistance),
            "stall": _short(kt * volts / resistance),
            "velocity": _short(volts / kt),
        }
    motor["source"] = f"measured: BAM {model}, {file}"
    kd = _short(kt * kt / resistance) if resistance else None
    return BamMotor(name, motor, kd, tuple(_lost(values)))


def _lost(values: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    stribeck = any(
        v > NOTHING for k, v in values.items() if k.endswith("_stribeck") and "dth" not in k
    )
    for name, value in values.items():
        known = name in PLAIN or name in OF_THE_BENCH
        shape = name in WITH_OTHERS and not stribeck
        if not known and not shape and abs(value) > NOTHING:
            yield name, value


def _short(value: float) -> float:
    return float(f"{value:.6g}")


def as_ranges(fits: Sequence[Fit], timestep_s: float) -> str:
    """YAML to review and to paste. Factors of the identified values; delays in simulation steps."""
    rows = [row for fit in fits for row in _rows(fit, timestep_s)]
    return "\n".join(["randomize:", "  joints:", *rows]) if rows else ""


def _rows(fit: Fit, timestep_s: float) -> Iterator[str]:
    known = [p for p in fit.parameters if not p.refused]
    files = ", ".join(log.file for log in fit.logs)
    for joint in dict.fromkeys(name for p in known for name in p.joints):
        own = [p for p in known if joint in p.joints]
        for each in own:
            if not _has_range(each):
                yield f"    # {each.name} of {joint}: the interval begins at 0"
        ranges = {p.name: _range(p, timestep_s) for p in own if _has_range(p)}
        if ranges:
            ranges["source"] = f"95 % interval of {files}"
            keys = ", ".join(f"{key}: {json.dumps(value)}" for key, value in ranges.items())
            yield f"    {json.dumps(re.escape(joint))}: {{{keys}}}"


def _has_range(parameter: Parameter) -> bool:
    return parameter.name == "delay" or parameter.low > 0.0


def _range(parameter: Parameter, timestep_s: float) -> list[float] | list[int] | str:
    low, high = parameter.low, parameter.high
    if parameter.name == "delay":
        return [math.floor(low / timestep_s), math.ceil(high / timestep_s)]
    return [round(low / parameter.value, 4), round(high / parameter.value, 4)]
