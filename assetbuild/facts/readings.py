"""Facts out of the readings that a bundle's `<robot>_isaaclab_measure.py` wrote in Isaac Lab."""

from __future__ import annotations

from typing import Any

from assetbuild.facts.table import Key, Table, Value
from assetbuild.simulators.readings import FORMAT

READ_AS = {
    "mass, kg": ("", "mass"),
    "timestep, s": ("simulation", "timestep"),
    "gravity, m/s2": ("simulation", "gravity"),
}
"""Quantity of a reading -> (kind where it is another, name in the vocabulary)."""


def readings_table(raw: Any) -> tuple[Table, str]:  # Any: JSON
    """(facts, simulator). ValueError, TypeError or KeyError where these are no readings."""
    if raw["format"] != FORMAT:
        raise ValueError(f"its format is `{raw['format']}`, not `{FORMAT}`")
    facts: dict[Key, Value] = {}
    for kind, name, quantity, value in raw["facts"]:
        other, named = READ_AS.get(quantity, ("", str(quantity)))
        facts[Key(other or str(kind), "" if kind == "robot" else str(name), named)] = _value(value)
    return Table(facts), str(raw.get("simulator", "unnamed"))


def _value(value: object) -> Value:
    if isinstance(value, list):
        return tuple(float(part) for part in value)
    return value if value is None or isinstance(value, str) else float(str(value))
