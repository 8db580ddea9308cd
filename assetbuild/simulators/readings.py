"""Readings of a robot that another program took: a small JSON file of facts."""

from __future__ import annotations

FORMAT = "assetbuild.readings/v1"
FALL_S, SETTLE_S = 0.3, 2.0
FALL = f"fall in {FALL_S:g} s, m"
HEIGHT = f"height after {SETTLE_S:g} s, m"


def fall_m(gravity_m_s2: float, timestep_s: float) -> float:
    """How far a body falls from rest in `FALL_S` by semi-implicit Euler, as both engines step."""
    steps = round(FALL_S / timestep_s)
    return 0.5 * gravity_m_s2 * timestep_s**2 * steps * (steps + 1)
