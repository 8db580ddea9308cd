"""Measured numbers written into the rows of a recipe, as literals that a person reviews.

Only the rows change; comments and all other text stay as they are.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import yaml

from assetbuild.errors import RecipeError, UsageError
from assetbuild.pipeline.identifying import Identified
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.model import Actuator

INSTEAD = {"kp": "frequency", "kd": "damping_ratio"}
"""A measured number takes the place of what it was computed from."""


def write_rows(found: Identified) -> int:
    """Rewrite the rows whose joints have measured numbers; how many rows now state them.

    RecipeError for a recipe without rows. The file is replaced at once, and only if it is valid.
    """
    loaded = found.loaded
    if loaded.variant is not None:
        raise UsageError("`--write` changes the recipe itself: omit `--variant`")
    measured = {row.joint: row for row in found.actuators if row.measured}
    text = loaded.path.read_bytes().decode("utf-8-sig")
    spans = _spans(text)
    if not spans:
        raise RecipeError(
            "the recipe has no rows in `actuators` that could state the numbers",
            where=loaded.where(("actuators",)),
            hint="build with `identify` alone, or write the rows first",
        )
    joints = [row.joint for row in found.actuators]
    count = 0
    rows = list(zip(loaded.recipe.actuators, spans, strict=True))
    for row, (first, last, indent) in reversed(rows):
        own = [name for name in joints if re.fullmatch(row.joints, name)]
        if not any(name in measured for name in own):
            continue
        written = list(_rows(row, own, measured))
        count += sum("measured" in each for each in written)
        text = text[:first] + f"\n{indent}- ".join(_flow(e, indent) for e in written) + text[last:]
    _replace(found, text)
    return count


def _replace(found: Identified, text: str) -> None:
    path = found.loaded.path
    half = path.with_name(f".{path.name}.new")
    half.write_text(text, encoding="utf-8", newline="")
    try:
        load_recipe(half)
        os.replace(half, path)  # noqa: PTH105 # says what it does
    finally:
        half.unlink(missing_ok=True)


def _spans(text: str) -> list[tuple[int, int, str]]:
    """(first, last, indent) of each item of `actuators`; comments below the last are not its."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    for key, value in root.value if root is not None else ():
        if key.value == "actuators" and isinstance(value, yaml.SequenceNode):
            found = []
            for item in value.value:
                first, last = item.start_mark.index, item.end_mark.index
                last = first + len(_without_tail(text[first:last]))
                line = text.rfind("\n", 0, first) + 1
                before = text[line:first]
                found.append((first, last, before[: len(before) - len(before.lstrip())]))
            return found
    return []


def _without_tail(text: str) -> str:
    """Without comments and empty lines at its end."""
    lines = text.rstrip().split("\n")
    while len(lines) > 1 and lines[-1].lstrip().startswith("#"):
        lines.pop()
    return "\n".join(lines).rstrip()


def _rows(
    row: ActuatorRow, joints: Sequence[str], measured: Mapping[str, Actuator]
) -> Iterator[dict[str, Any]]:  # Any: YAML
    """The rows in place of one: joints with equal numbers share a row, as do those with none."""
    stated = row.model_dump(exclude_unset=True)
    groups: dict[str, tuple[dict[str, Any], list[str]]] = {}  # Any: YAML
    for joint in joints:
        keys = {k: v for k, v in stated.items() if k not in ("joints", "measured", "source")}
        if joint in measured:
            keys |= _numbers(measured[joint], keys)
        elif row.source:
            keys["source"] = row.source
        groups.setdefault(json.dumps(keys), (keys, []))[1].append(joint)
    for keys, names in groups.values():
        yield {"joints": "|".join(map(re.escape, names)), **keys}


def _numbers(actuator: Actuator, keys: dict[str, Any]) -> dict[str, Any]:  # Any: YAML
    for name in actuator.measured:
        keys.pop(INSTEAD.get(name, ""), None)
    found = {name: float(f"{getattr(actuator, name):.6g}") for name in actuator.measured}
    return {**found, "measured": list(actuator.measured), "source": actuator.source}


def _flow(row: Mapping[str, Any], indent: str) -> str:  # Any: YAML
    """`{joints: .., ..}`; what was measured on lines of its own."""
    head = [f"{k}: {_text(v)}" for k, v in row.items() if k not in row.get("measured", ())]
    if "measured" not in row:
        return "{" + ", ".join(head) + "}"
    numbers = ", ".join(f"{name}: {row[name]!r}" for name in row["measured"])
    own = [part for part in head if not part.startswith(("measured:", "source:"))]
    names = ", ".join(row["measured"])
    return (
        "{" + ", ".join(own) + f",\n{indent}   {numbers},\n{indent}   measured: [{names}],\n"
        f"{indent}   source: {json.dumps(row['source'])}}}"
    )


def _text(value: Any) -> str:  # Any: YAML
    """A plain word or number as people write it, all else as JSON."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e9:
        return str(int(value))
    if isinstance(value, str) and re.fullmatch(r"[a-z]\w*_\w+|pd|ideal_pd", value, re.ASCII):
        return value
    return json.dumps(value)
