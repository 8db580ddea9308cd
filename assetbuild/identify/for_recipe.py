"""What was measured, as keys of a recipe: intervals of fits as ranges."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence

from assetbuild.robot.identify import Fit


def as_ranges(fits: Sequence[Fit], timestep_s: float) -> str:
    """YAML to review and to paste. Factors of the identified values; delays in simulation steps."""
    rows = [row for fit in fits for row in _rows(fit, timestep_s)]
    return "\n".join(["randomize:", "  joints:", *rows]) if rows else ""


def _rows(fit: Fit, timestep_s: float) -> Iterator[str]:
    known = [p for p in fit.parameters if not p.refused]
    files = ", ".join(log.file for log in fit.logs)
    for joint in dict.fromkeys(name for p in known for name in p.joints):
        ranges: dict[str, object] = {}
        for each in (p for p in known if joint in p.joints):
            low, high = each.low, each.high
            if each.name == "delay":
                ranges["delay"] = [math.floor(low / timestep_s), math.ceil(high / timestep_s)]
            elif low > 0.0:
                ranges[each.name] = [round(low / each.value, 4), round(high / each.value, 4)]
            else:
                yield f"    # {each.name} of {joint}: the interval begins at 0"
        if ranges:
            ranges["source"] = f"95 % interval of {files}"
            keys = ", ".join(f"{key}: {json.dumps(value)}" for key, value in ranges.items())
            yield f"    {json.dumps(re.escape(joint))}: {{{keys}}}"
