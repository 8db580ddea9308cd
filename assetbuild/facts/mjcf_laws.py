"""What an MJCF must say of the drive and the limits of a joint."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

from assetbuild.facts.table import Value
from assetbuild.robot.model import Actuator, Control, General, Joint

DEFAULT_PRM = (1.0, *(0.0,) * 9)


def drive_facts(joint: Joint, control: Control, names: Mapping[str, str]) -> dict[str, Value]:
    """Where they differ from the robot's own. names: of the drives, by joint."""
    lower, upper = joint.limits.lower, joint.limits.upper
    opens = lower is not None and upper is not None and lower < upper
    locked = lower is not None and lower == upper and joint.kind != "continuous"
    facts: dict[str, Value] = {}
    if not opens and not (locked and joint.mimic is None):
        facts |= {"lower": None, "upper": None}
    name = names.get(joint.name, joint.name)
    facts["drive name"] = name if name != joint.name else ""
    row = control.by_joint.get(joint.name)
    if row is None or row.model == "passive":
        return facts | {"effort": None, "drive name": ""}
    reach = (lower, upper) if opens and joint.kind != "continuous" and row.gear == 1.0 else None
    return facts | _law(row, reach)  # type: ignore[arg-type] # both stated


def _law(row: Actuator, reach: tuple[float, float] | None) -> dict[str, Value]:
    """As MuJoCo drives it: limits of the command, and what acts outside of the simulator."""
    ends = sorted(end * row.command_gear for end in row.ctrl) if row.ctrl else None
    ctrl = (ends[0], ends[1]) if ends else None
    match row.model:
        case "pd":
            return {"command range": ctrl or reach}
        case "velocity":
            speed = (-row.velocity, row.velocity) if row.velocity else None
            return {"command range": ctrl or speed, "kp": 0.0}
        case "general" if row.general is not None:
            return {"command range": ctrl} | _general(row, row.general, ctrl)
    own = row.effort / abs(row.gear) if row.effort else None
    ctrl = ctrl or ((-own, own) if own else None)
    asked = max(-ctrl[0], ctrl[1]) * abs(row.gear) if ctrl else row.effort
    effort = min(asked, row.effort or asked) if asked else None
    return {"model": "motor", "command range": ctrl, "effort": effort, "kp": 0.0, "kd": 0.0}


def _general(row: Actuator, said: General, ctrl: tuple[float, float] | None) -> dict[str, Value]:
    """A general actuator may say what a plainer one says too.

    ctrl: the range of the command, which limits a force that is the command times a gain.
    """
    prm = [(*own, *usual[len(own) :]) for own, usual in (
        (said.dynprm, DEFAULT_PRM), (said.gainprm, DEFAULT_PRM), (said.biasprm, (0.0,) * 10),
    )]  # fmt: skip
    numbers = [tuple(map(float, own)) for own in prm]
    kind, gain, bias = "general", numbers[1][0], list(numbers[2][:3])
    if said.dyntype == "none" and said.gaintype == "fixed":
        if said.biastype == "none" or not any(bias):
            kind = "motor"
        elif said.biastype == "affine" and gain > 0.0 and bias[:2] == [0.0, -gain]:
            kind = "pd"
        elif said.biastype == "affine" and gain > 0.0 and bias == [0.0, 0.0, -gain]:
            kind = "velocity"
    square = row.gear * row.gear
    law = json.dumps([said.dyntype, said.gaintype, said.biastype, *numbers])
    plain = kind in ("pd", "velocity") or (kind == "motor" and gain == 1.0)
    facts: dict[str, Value] = {}
    filtered = said.dyntype in ("none", "filter", "filterexact")
    if ctrl and filtered and said.gaintype == "fixed" and said.biastype == "none":
        low, high = sorted(row.gear * gain * end for end in ctrl)
        most = math.inf if row.effort is None else row.effort
        reached = max(low, -most), min(high, most)
        facts["effort"] = max(-reached[0], reached[1])
        facts["mjcf:effort range"] = reached if reached[0] != -reached[1] else None
    return facts | {
        "model": kind,
        "kp": gain * square if kind == "pd" else 0.0,
        "kd": -bias[2] * square if kind in ("pd", "velocity") else 0.0,
        "drive parameters": "" if plain else law,
    }
