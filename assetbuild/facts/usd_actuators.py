"""Newton's actuator prims: the law of a drive that acts outside of the solver, in SI and rad."""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.facts.table import Value
from assetbuild.robot.model import Actuator

EXPLICIT = frozenset({"ideal_pd", "dc_motor", "motor"})
"""Models of the actuator table that need such a prim."""
LAW = "NewtonPDControlAPI"
CLAMPS: Mapping[str, tuple[str, ...]] = {
    "NewtonMaxEffortClampingAPI": ("maxEffort",),
    "NewtonDCMotorClampingAPI": ("maxMotorEffort", "saturationEffort", "velocityLimit"),
}
"""Attributes of each schema that limits the effort, N m or N, rad/s or m/s."""


def explicit_law(row: Actuator) -> dict[str, Value]:
    """Gains and limits of a drive that acts outside of the solver; nothing for any other."""
    if row.model not in EXPLICIT:
        return {}
    gains: dict[str, Value] = {"kp": row.kp, "kd": row.kd}
    if row.model != "dc_motor":
        return gains | {"maxEffort": row.effort}
    stall = row.effort if row.stall is None else row.stall
    curve = {"saturationEffort": stall, "velocityLimit": row.velocity}
    return gains | {"maxMotorEffort": row.effort} | curve


def spelled(words: Mapping[str, Value]) -> dict[str, Value]:
    """The words of a joint for attributes of the prim that drives it."""
    return {f"usd:actuator {name}": value for name, value in words.items()}
