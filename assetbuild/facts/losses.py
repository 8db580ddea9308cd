"""What a format goes without, and what that is worth: derived from what its reader `lacks`."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from assetbuild.facts.table import Table
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.findings import Finding, Rule, Severity

SHOWN = 4
MOVES = frozenset(
    ("joint type", "joint axis", "joint lower", "joint upper", "joint mimics", "loop")
)
"""`kind` or `kind quantity`: without it the robot moves otherwise."""

LOST = Rule(
    "lost.*",
    ("error", "warning", "info"),
    "facts of the robot that a format cannot hold (error where it is simulated and moves otherwise "
    "without them, warning where it only describes the robot)",
    "take them from another format of the bundle",
)


class Lost(str):
    """Why a format lacks a fact; a plain text says instead where the format has it."""

    __slots__ = ()


def losses(
    table: Table, form: str, called: str, lacks: Mapping[str, str], *, simulated: bool
) -> Iterator[Finding]:
    """One finding for all that a format goes without.

    table: all that the robot says. form, called: as its reader is called. simulated: robots are
    simulated from it, so that what moves otherwise is an error; else it only describes them.
    """
    lost = [
        key
        for key, value in table.facts.items()
        if isinstance(lacks.get(f"{key.kind} {key.quantity}", lacks.get(key.kind)), Lost)
        and value != VOCABULARY[key.kind, key.quantity].unstated
    ]
    if not lost:
        return
    moves = any({key.kind, f"{key.kind} {key.quantity}"} & MOVES for key in lost)
    severity: Severity = "info" if not moves else "error" if simulated else "warning"
    names: dict[str, dict[str, None]] = {}
    quantities: dict[str, dict[str, None]] = {}
    for kind, name, quantity in lost:
        # `home/FR_hip_joint` is part of the keyframe `home`.
        subject = name.partition("/")[0] if kind == "keyframe" else name
        names.setdefault(kind, {})[subject] = None
        quantities.setdefault(kind, {})[quantity] = None
    told = []
    for kind, own in names.items():
        counted = f"{len(own)} {kind}{'s' if len(own) > 1 else ''}" if any(own) else f"the {kind}"
        if kind not in lacks:
            counted = f"{_listed(quantities[kind])} of {counted}"
        elif any(own):
            counted = f"{counted} ({_listed(own)})"
        told.append(counted)
    data = {kind: len(own) for kind, own in names.items()}
    text = f"{called} lacks {'; '.join(told)}"
    yield LOST.named(form)("robot", text, severity=severity, data=data)


def _listed(names: Collection[str]) -> str:
    shown = [f"`{name}`" for name in names]
    return ", ".join(shown[:SHOWN]) + (", ..." if len(shown) > SHOWN else "")
