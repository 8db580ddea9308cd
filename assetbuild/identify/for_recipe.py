"""What was measured, as keys of a recipe: intervals of fits as ranges."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence

from assetbuild.robot.identify import Fit, Parameter


def as_ranges(fits: Sequence[Fit], timestep_s: float) -> str:
    """YAML to review and to paste. Factors of the identified values; delays in simulation steps."""
    rows = [row for fit in fits for row in _rows(fit, timestep_s)]
    return "\n".join(["randomize:", "  joints:", *rows]) if rows else ""


def _rows(fit: Fit, timestep_s: float) -> Iterator[str]:
    known = [p for p in fit.parameters if not p.refused]
    files = ", ".join(log.file for log in fit.logs)
    for joint in dict.fromkeys(name for p in known for name in p.joints):
        parameters = [p for p in known if joint in p.joints]
        for each in parameters:
            if not _has_range(each):
                yield f"    # {each.name} of {joint}: the interval begins at 0"
        ranges = {p.name: _range(p, timestep_s) for p in parameters if _has_range(p)}
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
