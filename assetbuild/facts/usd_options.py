"""What the recipe's `usd` says to PhysX, and what holds where it says nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from assetbuild.facts.reference import Reference

SOLVER = {
    "solver_position_iterations": 8,
    "solver_velocity_iterations": None,
    "sleep_threshold": 0.0,
    "stabilization_threshold": 0.0,
}
RIGID = {
    "linear_damping": 0.0,
    "angular_damping": 0.0,
    "max_linear_velocity": 1000.0,
    "max_angular_velocity": 1000.0,
    "max_depenetration_velocity": 1.0,
}


def solver_of(reference: Reference) -> dict[str, float]:
    """How PhysX solves: the light rods of loops need 16 velocity iterations, others 1."""
    stated = _stated(reference, "articulation")
    usual = 16 if reference.control.loops else 1
    found = {key: stated.get(key, value) for key, value in SOLVER.items()}
    return {key: float(usual if value is None else value) for key, value in found.items()}


def rigid_of(reference: Reference) -> dict[str, float]:
    """What PhysX adds to every body."""
    stated = _stated(reference, "rigid_body")
    return {key: float(stated.get(key, value)) for key, value in RIGID.items()}


def touches_itself(reference: Reference) -> bool:
    """Whether parts of the robot touch one another."""
    return bool(_stated(reference, "articulation").get("self_collisions", True))


def _stated(reference: Reference, section: str) -> Mapping[str, Any]:  # Any: JSON
    found: Mapping[str, Any] = (reference.options.get("usd") or {}).get(section) or {}
    return found
