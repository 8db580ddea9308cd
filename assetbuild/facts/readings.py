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


def _read_key(kind: str, name: str, quantity: str) -> Key:
    other, named = READ_AS.get(quantity, ("", quantity))
    return Key(other or kind, "" if kind == "robot" else name, named)


def readings_table(raw: Any) -> tuple[Table, str]:  # Any: JSON
    """(facts, simulator). ValueError, TypeError or KeyError where these are no readings."""
    if raw["format"] != FORMAT:
        raise ValueError(f"its format is `{raw['format']}`, not `{FORMAT}`")
    facts = {
        _read_key(str(kind), str(name), str(quantity)): _value(value)
        for kind, name, quantity, value in raw["facts"]
    }
    return Table(facts), str(raw.get("simulator", "unnamed"))


def _value(value: object) -> Value:
    if isinstance(value, list):
        return tuple(float(part) for part in value)
    return value if value is None or isinstance(value, str) else float(str(value))
