"""What changed between two robots, worst first: a text for the terminal or a pull request."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from assetbuild.report.snapshot import Snapshot, Value
from assetbuild.report.tables import markdown_table, table, text_of
from assetbuild.simulators.readings import FALL, HEIGHT

Rank = Literal["CRITICAL", "HIGH", "MEDIUM", "LOW"]
RANKS: tuple[Rank, ...] = get_args(Rank)
DEGREES = 180.0 / math.pi
SHOWN_NAMES = 3

CRITICAL_IF_CHANGED = ("kind", "axis", "base", "gravity, m/s2", "model")
MOTION: dict[str, float] = {FALL: 0.02, HEIGHT: 0.01}
"""m; what two simulators may differ by: 5 % of the fall, a centimetre of height."""
DRIVE = ("kp", "kd", "damping", "friction", "armature", "effort", "velocity", "stall")


@dataclass(frozen=True)
class Change:
    """One quantity of one or more subjects."""

    rank: Rank
    subjects: tuple[str, ...]
    quantity: str
    before: str
    after: str
    note: str = ""


def changes(before: Snapshot, after: Snapshot) -> list[Change]:
    """All changes, worst first; subjects with the same change are told together."""
    found = [
        *_verdict(before, after),
        *_findings(before, after),
        *_subjects(before, after),
        *_facts(before, after),
        *_files(before, after),
    ]
    merged: dict[tuple[object, ...], Change] = {}
    for change in found:
        key = (change.rank, change.quantity, change.before, change.after, change.note)
        known = merged.get(key)
        subjects = (known.subjects if known else ()) + change.subjects
        merged[key] = Change(
            change.rank, subjects, change.quantity, change.before, change.after, change.note
        )
    return sorted(merged.values(), key=lambda c: RANKS.index(c.rank))


def diff_text(before: Snapshot, after: Snapshot, found: Sequence[Change]) -> str:
    """For a terminal."""
    lines = [f"{before.name} -> {after.name}: {counts(found)}"]
    for change in found:
        note = f" ({change.note})" if change.note else ""
        arrow = f"{change.before} -> {change.after}"
        subject = _named(change.subjects)
        lines.append(f"  {change.rank:8}  {subject}: {change.quantity}: {arrow}{note}")
    return "\n".join(lines) + "\n"


def diff_markdown(before: Snapshot, after: Snapshot, found: Sequence[Change]) -> str:
    """For a pull request."""
    rows = [(c.rank, _named(c.subjects), c.quantity, c.before, c.after, c.note) for c in found]
    shown = table("", ("", "of", "what", "before", "after", ""), rows, empty="No difference.")
    title = f"### `{before.name}` -> `{after.name}`: {counts(found)}"
    return f"{title}\n\n{markdown_table(shown)}\n"


def counts(found: Sequence[Change]) -> str:
    """`2 HIGH, 1 LOW`."""
    ranks = [change.rank for change in found]
    return ", ".join(f"{ranks.count(r)} {r}" for r in RANKS if r in ranks) or "no difference"


def _named(subjects: Sequence[str]) -> str:
    if len(subjects) <= SHOWN_NAMES:
        return ", ".join(subjects)
    return f"{', '.join(subjects[:SHOWN_NAMES])} and {len(subjects) - SHOWN_NAMES} more"


# --- what may change -------------------------------------------------------------------------


def _verdict(before: Snapshot, after: Snapshot) -> Iterator[Change]:
    if None not in (before.ready, after.ready) and before.ready != after.ready:
        rank: Rank = "CRITICAL" if before.ready else "MEDIUM"
        shown = text_of(before.ready), text_of(after.ready)
        yield Change(rank, ("robot",), "ready for training", *shown)


def _findings(before: Snapshot, after: Snapshot) -> Iterator[Change]:
    worse: dict[str, Rank] = {"error": "CRITICAL", "warning": "MEDIUM", "info": "LOW"}
    if before.ready is None or after.ready is None:
        return  # one of them was never checked
    for key in sorted({*before.findings, *after.findings}):
        old, new = before.findings.get(key), after.findings.get(key)
        if old == new or "info" in (old or "info") == (new or "info"):
            continue
        rank: Rank = worse[new] if new and new != "info" else "LOW"
        yield Change(rank, (key[1],), f"finding {key[0]}", old or "-", new or "-")


def _subjects(before: Snapshot, after: Snapshot) -> Iterator[Change]:
    for group in ("body", "joint"):
        old = {subject for kind, subject, _ in before.facts if kind == group}
        new = {subject for kind, subject, _ in after.facts if kind == group}
        if not old or not new:
            continue  # a configuration names no bodies, some none of its joints
        for name in sorted(old - new):
            yield Change("CRITICAL", (f"{group} {name}",), "exists", "yes", "no")
        for name in sorted(new - old):
            yield Change("CRITICAL", (f"{group} {name}",), "exists", "no", "yes")


def _facts(before: Snapshot, after: Snapshot) -> Iterator[Change]:
    """Quantities that both state; one that only one of them states at all says nothing."""
    told_before = {(group, quantity) for group, _, quantity in before.facts}
    told_after = {(group, quantity) for group, _, quantity in after.facts}
    both = told_before & told_after
    there = {(g, s) for g, s, _ in before.facts} & {(g, s) for g, s, _ in after.facts}
    for key in dict.fromkeys((*before.facts, *after.facts)):
        group, subject, quantity = key
        if (group, quantity) not in both or (group, subject) not in there:
            continue
        old, new = before.facts.get(key), after.facts.get(key)
        apart = MOTION.get(quantity, 0.0)
        if not _same(old, new, max(before.precision, after.precision), apart):
            name = subject if group == "robot" else f"{group} {subject}"
            rank, note = judge(quantity, old, new)
            yield Change(rank, (name,), quantity, text_of(old), text_of(new), note)


def _same(old: Value, new: Value, precision: float, apart: float) -> bool:
    if isinstance(old, float) and isinstance(new, float):
        return math.isclose(old, new, rel_tol=precision, abs_tol=max(1e-3 * precision, apart))
    if isinstance(old, tuple) and isinstance(new, tuple) and len(old) == len(new):
        size = max(map(abs, (*old, *new)), default=0.0)
        return math.dist(old, new) <= precision * max(size, 1e-3)
    return old == new


def judge(quantity: str, old: Value, new: Value) -> tuple[Rank, str]:
    """How bad a change is, and what to think of."""
    if quantity in CRITICAL_IF_CHANGED:
        if quantity == "axis" and isinstance(old, tuple) and isinstance(new, tuple):
            turned = sum(a * b for a, b in zip(old, new, strict=True))
            if turned > 1.0 - 1e-6:
                return "LOW", ""
            return "CRITICAL", "turns the other way" if turned < -0.999 else ""
        return ("HIGH" if quantity == "model" else "CRITICAL"), ""
    if isinstance(old, float) and isinstance(new, float):
        return _judge_number(quantity, old, new)
    if isinstance(old, tuple) and isinstance(new, tuple):
        size = max(map(abs, (*old, *new)), default=0.0)
        apart = math.dist(old, new)
        if quantity == "centre of mass, m":
            return ("HIGH" if apart > 1e-3 else "LOW"), f"{1e3 * apart:.3g} mm"
        if quantity.startswith("principal"):
            return ("HIGH" if apart > 0.05 * size else "LOW"), ""
    return ("HIGH" if quantity in ("lower", "upper", "effort") else "MEDIUM"), ""


def _judge_number(quantity: str, old: float, new: float) -> tuple[Rank, str]:
    ratio = new / old if old else math.inf
    note = f"x {ratio:.4g}" if 0.0 < ratio < math.inf else ""
    for factor, text in ((DEGREES, "degrees and radians?"), (1e3, "a factor of 1000: units?")):
        if any(math.isclose(ratio, f, rel_tol=1e-3) for f in (factor, 1.0 / factor)):
            return "CRITICAL", f"{note}: {text}"
    change = abs(math.log(ratio)) if 0.0 < ratio < math.inf else math.inf
    if "mass" in quantity:
        return ("CRITICAL" if change > 0.01 else "LOW"), note
    if quantity in ("lower", "upper"):
        return ("HIGH" if abs(new - old) > 1e-3 else "LOW"), ""
    if quantity in DRIVE:
        return ("HIGH" if change > math.log(1.5) else "MEDIUM"), note
    high = ("timestep, s", "decimation", *MOTION)
    return ("HIGH" if quantity in high else "MEDIUM"), note


def _files(before: Snapshot, after: Snapshot) -> Iterator[Change]:
    if not before.files or not after.files:
        return
    pictures = [p for p in {*before.files, *after.files} if p.startswith("report/images/")]
    other = sorted(p for p in pictures if before.files.get(p) != after.files.get(p))
    for path in other:
        name = path.removeprefix("report/images/")
        old, new = (s.files[path][0][:8] if path in s.files else "-" for s in (before, after))
        yield Change("LOW", (name,), "picture", old, new, "look at both")
    for folder in ("urdf", "mjcf", "usd"):
        sizes = [_size(snapshot, folder) for snapshot in (before, after)]
        if max(sizes) and abs(sizes[1] - sizes[0]) > 0.02 * max(sizes):
            shown = [f"{size / 1e6:.2f} MB" for size in sizes]
            yield Change("LOW", (f"{folder}/",), "size", shown[0], shown[1])


def _size(snapshot: Snapshot, folder: str) -> int:
    return sum(size for p, (_, size) in snapshot.files.items() if p.startswith(f"{folder}/"))
