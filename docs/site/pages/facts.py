"""The page of facts: every quantity of the vocabulary, and what each format does with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from assetbuild.facts.held import HELD_BY_NEWTON, HELD_BY_PHYSX
from assetbuild.facts.reader import Reader
from assetbuild.facts.vocabulary import VOCABULARY, Quantity
from assetbuild.plugins import load_plugin, plugin_names

INTRODUCTION = """\
# Facts

A robot is a table of facts. Every format is read back into the same table, and the difference of
two tables is what `build` reports as `equal.<format>.<quantity>`, and what `validate` and `diff`
report. The tables below list every quantity, and for each format `=` where it is compared, or the
number of the reason why the format cannot hold it. What a format says beyond these quantities is
compared as a word of its own (`mjcf:solmix`, `usd:approximation`). `physx` and `newton` are what
these simulators hold once they have loaded the files.

Tolerances are relative: 1e-9, and 2e-7 where a format keeps float32.
"""


def fact_page() -> str:
    """One table for each kind of subject, and the reasons."""
    formats = {name: load_plugin(Reader, name).lacks for name in plugin_names(Reader)}
    formats |= {"physx": _others(HELD_BY_PHYSX), "newton": _others(HELD_BY_NEWTON)}
    reasons: dict[str, int] = {}
    kinds = dict.fromkeys(kind for kind, _ in VOCABULARY)
    parts = [INTRODUCTION]
    for kind in kinds:
        rows = [q for q in VOCABULARY.values() if q.kind == kind]
        parts.append(f"## {kind}\n\n" + "".join(_table(rows, formats, reasons)))
    listed = "".join(f"{number}. {reason}\n" for reason, number in reasons.items())
    return "\n".join(parts) + f"\n## Why a format cannot hold a quantity\n\n{listed}"


def _others(held: Mapping[str, frozenset[str]]) -> Mapping[str, str]:
    """What a simulator's interface does not say."""
    others = [row for row in VOCABULARY.values() if row.name not in held.get(row.kind, ())]
    return {f"{row.kind} {row.name}": "not read back from the simulator" for row in others}


def _table(
    rows: list[Quantity], formats: dict[str, Mapping[str, str]], reasons: dict[str, int]
) -> Iterator[str]:
    yield f"| quantity | unit | rank | {' | '.join(formats)} | meaning |\n"
    yield f"|{' --- |' * (len(formats) + 4)}\n"
    for row in rows:
        cells = [_cell(row, lacks, reasons) for lacks in formats.values()]
        known = f"| {row.name} | {row.unit} | {row.rank.lower()} |"
        yield f"{known} {' | '.join(cells)} | {row.about} |\n"


def _cell(row: Quantity, lacks: Mapping[str, str], reasons: dict[str, int]) -> str:
    reason = lacks.get(f"{row.kind} {row.name}") or lacks.get(row.kind)
    return "=" if reason is None else str(reasons.setdefault(reason, len(reasons) + 1))
