"""What a format goes without, and what that is worth: derived from what its reader `lacks`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from assetbuild.facts.table import Key, Table
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
    """Why a format goes without a fact; a plain text says instead where the format has it."""

    __slots__ = ()


def lost_facts(table: Table, lacks: Mapping[str, str]) -> tuple[Key, ...]:
    """The facts that a format goes without. table: all that the robot says."""
    return tuple(
        key
        for key, value in table.facts.items()
        if isinstance(lacks.get(f"{key.kind} {key.quantity}", lacks.get(key.kind)), Lost)
        and value != VOCABULARY[key.kind, key.quantity].unstated
    )


def worth(lost: Collection[Key], *, simulated: bool) -> Severity:
    """What a loss is worth, whichever format it is. simulated: robots are simulated from it."""
    moves = any({key.kind, f"{key.kind} {key.quantity}"} & MOVES for key in lost)
    return "info" if not moves else "error" if simulated else "warning"


def losses(
    table: Table, form: str, called: str, lacks: Mapping[str, str], *, simulated: bool
) -> Iterator[Finding]:
    """One finding for all that a format goes without. form, called: as its reader is called."""
    lost = lost_facts(table, lacks)
    if lost:
        kinds = dict.fromkeys(key.kind for key in lost)
        told = [_told(kind, [key for key in lost if key.kind == kind], lacks) for kind in kinds]
        yield LOST.named(form)(
            "robot",
            f"{called} goes without {'; '.join(told)}",
            severity=worth(lost, simulated=simulated),
            data={kind: len(_names(kind, lost)) for kind in kinds},
        )


def _told(kind: str, lost: list[Key], lacks: Mapping[str, str]) -> str:
    """`2 sensors (`a`, `b`)` of a whole kind; else what is lost of how many."""
    names = _names(kind, lost)
    counted = f"{len(names)} {kind}{'s' if len(names) > 1 else ''}" if any(names) else f"the {kind}"
    listed = _listed(names)
    if kind in lacks:
        return f"{counted} ({listed})" if listed else counted
    return f"{_listed(list(dict.fromkeys(key.quantity for key in lost)))} of {counted}"


def _names(kind: str, lost: Iterable[Key]) -> list[str]:
    """Return the subjects of a kind by name; `home/FR_hip_joint` is part of the keyframe `home`."""
    own = (key.name for key in lost if key.kind == kind)
    return list(dict.fromkeys(n.partition("/")[0] if kind == "keyframe" else n for n in own))


def _listed(names: list[str]) -> str:
    shown = [f"`{name}`" for name in names if name]
    return ", ".join(shown[:SHOWN]) + (", ..." if len(shown) > SHOWN else "")
