"""Facts of an Isaac Lab configuration: an `ArticulationCfg` in a Python file, read and never run.

Only what stands there in plain is read: numbers, texts, lists and maps of them, names that the
module gives such values to, and sums, products and powers of numbers. What is left to the USD
(`None`, or not written) is no fact.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from assetbuild.errors import UsageError
from assetbuild.report.snapshot import Facts

MODELS: Mapping[str, str] = {
    "ImplicitActuatorCfg": "pd",
    "IdealPDActuatorCfg": "ideal_pd",
    "DCMotorCfg": "dc_motor",
}
"""Isaac Lab's actuator -> the model of the table; others keep their name."""
QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "kp": ("stiffness",),
    "kd": ("damping",),
    "armature": ("armature",),
    "effort": ("effort_limit_sim", "joint_effort_limit", "effort_limit", "actuator_effort_limit"),
    "velocity": (
        "velocity_limit_sim",
        "joint_velocity_limit",
        "velocity_limit",
        "actuator_velocity_limit",
    ),
    "stall": ("saturation_effort",),
}
"""Fact -> the fields that state it, both generations. SI, as Isaac Lab counts angles in radians.

No friction: what its number means depends on the generation and the simulator.
"""
OPERATORS: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
LARGEST_EXPONENT = 64
MOST_DIGITS = 300


@dataclass(frozen=True)
class _Unknown:
    """A value that does not stand in the file."""


UNKNOWN = _Unknown()


def isaaclab_facts(path: Path, name: str, joints: Collection[str]) -> Facts:
    """Of the configuration `name` in a file; "" = the only one.

    joints: names that the configuration's patterns are meant for, of the robot that it is
    compared with; empty = the patterns themselves are the subjects. UsageError for a file that is
    no Python, or without that configuration.
    """
    try:
        module = ast.parse(path.read_bytes(), str(path))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise UsageError(f"`{path}` is no Python: {error}") from None
    known = _assigned(module)
    configs = {n: v for n, v in known.items() if _called(v) == "ArticulationCfg"}
    if not configs:
        raise UsageError(
            f"`{path}` has no `NAME = ArticulationCfg(...)`",
            hint="give the file that writes it out; `CFG.replace(...)` is not followed",
        )
    if name not in configs and (name or len(configs) > 1):
        raise UsageError(
            f"`{path}` has {', '.join(f'`{n}`' for n in configs)}",
            hint=f"say which: `{path}:{next(iter(configs))}`",
        )
    call = configs[name or next(iter(configs))]
    facts: Facts = {}
    for pattern, group in _groups(call, known):
        for joint in _matching(pattern, joints):
            _drive_facts(joint, group, known, facts)
    _start_facts(call, known, joints, facts)
    return facts


def _assigned(module: ast.Module) -> dict[str, ast.expr]:
    """What the module gives its names to."""
    found: dict[str, ast.expr] = {}
    for node in module.body:
        if isinstance(node, ast.Assign):
            found |= {t.id: node.value for t in node.targets if isinstance(t, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and node.value and isinstance(node.target, ast.Name):
            found[node.target.id] = node.value
    return found


def _called(node: ast.expr) -> str:
    """The last name of what is called, "" for anything else."""
    if not isinstance(node, ast.Call):
        return ""
    function = node.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _field(call: ast.expr, name: str, known: Mapping[str, ast.expr]) -> ast.expr | None:
    if not isinstance(call, ast.Call):
        return None
    found = next((k.value for k in call.keywords if k.arg == name), None)
    while isinstance(found, ast.Name) and found.id in known and found is not known[found.id]:
        found = known[found.id]
    return found


def _groups(call: ast.expr, known: Mapping[str, ast.expr]) -> Iterator[tuple[str, ast.Call]]:
    """(pattern of joints, actuator) of all groups."""
    actuators = _field(call, "actuators", known)
    for value in actuators.values if isinstance(actuators, ast.Dict) else ():
        group = known.get(value.id, value) if isinstance(value, ast.Name) else value
        names = _value(_field(group, "joint_names_expr", known), known)
        if isinstance(group, ast.Call):
            for pattern in names if isinstance(names, list) else [names]:
                if isinstance(pattern, str):
                    yield pattern, group


def _drive_facts(joint: str, group: ast.Call, known: Mapping[str, ast.expr], facts: Facts) -> None:
    facts["joint", joint, "model"] = MODELS.get(_called(group), _called(group))
    for quantity, fields in QUANTITIES.items():
        for field in fields:
            number = _number_for(joint, _value(_field(group, field, known), known))
            if number is not None:
                facts["joint", joint, quantity] = number
                break


def _start_facts(
    call: ast.expr, known: Mapping[str, ast.expr], joints: Collection[str], facts: Facts
) -> None:
    """The initial state is the pose `home`."""
    start = _field(call, "init_state", known)
    if start is None:
        return
    place = _value(_field(start, "pos", known), known)
    if isinstance(place, list) and len(place) == 3 and all(isinstance(v, float) for v in place):
        facts["robot", "robot", "keyframe home, base, m"] = tuple(place)
    positions = _value(_field(start, "joint_pos", known), known)
    if isinstance(positions, dict):
        for joint in joints or positions:  # Isaac Lab starts the others at 0
            facts["joint", joint, "keyframe home"] = _number_for(joint, positions) or 0.0


def _number_for(joint: str, value: object) -> float | None:
    """A number for all joints, or that of the last pattern that matches this one."""
    if isinstance(value, float):
        return value
    found = None
    for pattern, number in value.items() if isinstance(value, dict) else ():
        if isinstance(number, float) and (pattern == joint or _matching(pattern, (joint,))):
            found = number
    return found


def _matching(pattern: str, joints: Collection[str]) -> list[str]:
    if not joints:
        return [pattern]
    try:
        return [joint for joint in joints if re.fullmatch(pattern, joint)]
    except re.error:
        return []


def _value(node: ast.expr | None, known: Mapping[str, ast.expr], deep: int = 0) -> object:
    """A float, a text, a list or a dict of them; `UNKNOWN` for anything else."""
    if node is None or deep > 50:
        return UNKNOWN
    if isinstance(node, ast.Constant):
        return _constant(node.value)
    if isinstance(node, ast.Name) and node.id in known:
        return _value(known[node.id], known, deep + 1)
    if isinstance(node, ast.List | ast.Tuple):
        return [_value(item, known, deep + 1) for item in node.elts]
    if isinstance(node, ast.Dict):
        keys = [_value(key, known, deep + 1) for key in node.keys]
        values = [_value(value, known, deep + 1) for value in node.values]
        return {k: v for k, v in zip(keys, values, strict=True) if isinstance(k, str)}
    return _calculated(node, known, deep)


def _constant(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value) if abs(value) < 10.0**MOST_DIGITS else UNKNOWN
    return value if isinstance(value, str) else UNKNOWN


def _calculated(node: ast.expr, known: Mapping[str, ast.expr], deep: int) -> object:
    """Sums and products; math.pi."""
    if isinstance(node, ast.Attribute) and node.attr == "pi":
        return math.pi
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = _value(node.operand, known, deep + 1)
        return -value if isinstance(value, float) else UNKNOWN
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        left, right = (_value(side, known, deep + 1) for side in (node.left, node.right))
        if isinstance(left, float) and isinstance(right, float):
            if isinstance(node.op, ast.Pow) and abs(right) > LARGEST_EXPONENT:
                return UNKNOWN
            try:
                found = OPERATORS[type(node.op)](left, right)
            except (ArithmeticError, ValueError):
                return UNKNOWN
            return found if isinstance(found, float) and math.isfinite(found) else UNKNOWN
    return UNKNOWN
