"""What changed between two robots, worst first: a text for the terminal or a pull request."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from assetbuild.errors import UsageError
from assetbuild.facts.again.files import rows_of
from assetbuild.facts.again.tree import NotParsedError, groups
from assetbuild.facts.compare import Difference, differences, value_text
from assetbuild.facts.table import Key, Table, Value
from assetbuild.facts.vocabulary import RANKS, VOCABULARY, Rank, Required
from assetbuild.grouping import grouped
from assetbuild.report.sides import DERIVED, ROBOT, Form, Side, stages_of
from assetbuild.report.tables import markdown_table, table
from assetbuild.simulators.readings import FALL, HEIGHT

DEGREES = 180.0 / math.pi
MOTION = {FALL: 0.02, HEIGHT: 0.01}
"""m; what two simulators may differ by: 5 % of the fall, a centimetre of height."""
SHOWN_NAMES = SHOWN_LINES = 3
BETWEEN_FORMATS = 1e-5
"""Relative: MuJoCo's own writer, for one, rounds to six digits."""
PAGES = ("report/report.json", "report/index.html", "report/report.md", "model_card.md")
"""What a build writes of the facts, the findings and the figures."""
NOISE = 0.01
"""Relative: what a figure of a check may change by."""


@dataclass(frozen=True)
class Change:
    """One quantity of one or more subjects. forms: the formats that say so."""

    rank: Rank
    subjects: tuple[str, ...]
    quantity: str
    before: str
    after: str
    note: str = ""
    forms: tuple[str, ...] = ()


@dataclass(frozen=True)
class Changes:
    """rows: worst first. rewritten: files that say the same in other bytes."""

    rows: tuple[Change, ...]
    rewritten: tuple[str, ...] = ()


def changes(before: Side, after: Side) -> Changes:
    """All that differs; subjects with the same change share a row."""
    facts, telling = _facts(before, after)
    all_changes = [*_verdict(before, after), *_findings(before, after), *facts]
    all_changes += _figures(before, after)
    explained = frozenset(PAGES) if all_changes else frozenset()
    files, rewritten = _files(before, after, telling, explained)
    all_changes += files
    alike = grouped(all_changes, lambda c: (c.rank, c.quantity, c.before, c.after, c.note))
    rows = sorted(map(_merged, alike.values()), key=lambda change: RANKS.index(change.rank))
    return Changes(tuple(rows), rewritten)


def _merged(changes: Sequence[Change]) -> Change:
    subjects = dict.fromkeys(name for change in changes for name in change.subjects)
    forms = dict.fromkeys(form for change in changes for form in change.forms)
    return replace(changes[0], subjects=tuple(subjects), forms=tuple(forms))


def diff_text(before: Side, after: Side, diff: Changes) -> str:
    """Write the changes for a terminal."""
    lines = [f"{before.name} -> {after.name}: {counts(diff)}"]
    for change in diff.rows:
        arrow = f"{change.before} -> {change.after}"
        subject = _named(change.subjects)
        lines.append(f"  {change.rank:8}  {subject}: {change.quantity}: {arrow}{_remarks(change)}")
    return "\n".join(lines) + "\n"


def diff_markdown(before: Side, after: Side, diff: Changes) -> str:
    """Write the changes for a pull request."""
    rows = [
        (c.rank, _named(c.subjects), c.quantity, c.before, c.after, _remarks(c).strip(" ()"))
        for c in diff.rows
    ]
    listed = table("", ("", "of", "what", "before", "after", ""), rows, empty="No fact differs.")
    title = f"### `{before.name}` -> `{after.name}`: {counts(diff)}"
    return f"{title}\n\n{markdown_table(listed)}\n"


def _remarks(change: Change) -> str:
    parts = [part for part in (change.note, ", ".join(change.forms)) if part]
    return f" ({'; '.join(parts)})" if parts else ""


def counts(diff: Changes) -> str:
    """`2 HIGH, 1 LOW`."""
    ranks = [change.rank for change in diff.rows]
    text = ", ".join(f"{ranks.count(r)} {r}" for r in RANKS if r in ranks)
    if text or not diff.rewritten:
        return text or "no difference"
    files = len(diff.rewritten)
    return f"no fact differs; {files} file{'s are' if files > 1 else ' is'} written differently"


def _named(subjects: Sequence[str]) -> str:
    if len(subjects) <= SHOWN_NAMES:
        return ", ".join(subjects)
    return f"{', '.join(subjects[:SHOWN_NAMES])} and {len(subjects) - SHOWN_NAMES} more"


# --- facts ----------------------------------------------------------------------------------


def _facts(before: Side, after: Side) -> tuple[list[Change], frozenset[str]]:
    """(changes, forms in which a fact differs)."""
    fact_changes: list[Change] = []
    telling: set[str] = set()
    both = [form for form in before.forms if form in after.forms]
    # Where no form is common, a model's own is compared with a bundle's robot.
    nearest = next(iter(before.forms)), next(iter(after.forms))
    for one, other in [(form, form) for form in both] or [nearest]:
        if _unchanged(before, after, one) and one == other:
            continue
        try:
            differ = _compared(before.forms[one], after.forms[other], same=one == other)
        except UsageError as error:
            if before.folder is None or after.folder is None:
                raise
            telling.add(one)
            text = error.message
            fact_changes.append(
                Change("CRITICAL", (f"format {one}",), "can be read", "?", "no", text)
            )
            continue
        telling |= {one} if differ else set()
        named = one if one == other else f"{one}, {other}"
        fact_changes += [_change(item, named) for item in differ]
    for form in sorted({*before.forms} ^ {*after.forms}) if both else ():
        gone = form in before.forms
        fact_changes.append(Change("HIGH", (f"format {form}",), "exists", *_exists(gone)))
    said = {(c.subjects, c.quantity, c.before, c.after) for c in fact_changes}

    def said_of_the_body(c: Change) -> bool:
        merged = c.subjects[0].removeprefix("link's ").replace("link ", "body ", 1)
        return merged != c.subjects[0] and ((merged,), c.quantity, c.before, c.after) in said

    return [c for c in fact_changes if not said_of_the_body(c)], frozenset(telling)


def _exists(gone: bool) -> tuple[str, str]:
    return ("yes", "no") if gone else ("no", "yes")


def _unchanged(before: Side, after: Side, form: str) -> bool:
    """Whether all files behind a form have the same bytes."""
    both = ((side, side.forms.get(form)) for side in (before, after))
    old, new = ({p: side.digests[p] for p in of.covers} if of else {} for side, of in both)
    return bool(old) and old == new


def _compared(before: Form, after: Form, *, same: bool) -> list[Difference]:
    """same: both are of one format, which says all that it can."""
    old, new = before.read(), after.read()
    precision = before.precision.coarser(after.precision)
    if same:
        return differences(old, new, precision)

    def both_hold(key: Key) -> bool:
        return not key.is_foreign and before.holds(key) and after.holds(key)

    stated = [{(k.kind, k.quantity) for k in table.facts} for table in (old, new)]
    kinds = (stated[0] & stated[1]) | {pair for pair in stated[0] ^ stated[1] if _counts(*pair)}
    old, new = (
        t.only(lambda key: both_hold(key) and (key.kind, key.quantity) in kinds) for t in (old, new)
    )
    return [
        item
        for item in differences(old, new, precision.at_least(BETWEEN_FORMATS))
        if (item.what == "value" or item.key.kind in ("body", "joint"))
        and not _is_near(item)
        and (item.what != "value" or (_tells(item.key, old) and _tells(item.key, new)))
    ]


def _tells(key: Key, table: Table) -> bool:
    """Whether a table states a fact, or means something by not stating it."""
    row = VOCABULARY.get((key.kind, key.quantity))
    return key in table.facts or not (row is None or isinstance(row.unstated, Required | None))


def _counts(kind: str, quantity: str) -> bool:
    """Whether a quantity counts that a whole file never states: no joint of it mimics."""
    row = VOCABULARY.get((kind, quantity)) if kind in ("body", "joint") else None
    has_meaning = _tells(Key(kind, "", quantity), Table({}))
    return row is not None and row.rank == "CRITICAL" and has_meaning


def _is_near(item: Difference) -> bool:
    """Whether two simulators may move so differently."""
    apart, old, new = MOTION.get(item.key.quantity, 0.0), item.before, item.after
    return isinstance(old, float) and isinstance(new, float) and abs(old - new) <= apart


def _change(item: Difference, form: str) -> Change:
    subject, forms = item.key.subject, () if form == ROBOT else (form,)
    if item.what != "value":
        return Change(item.rank, (subject,), "exists", *_exists(item.what == "missing"), "", forms)
    unit = item.quantity.unit if item.quantity else ""
    rank, note = judge(item)
    old, new = _texts(item.before, item.after, unit)
    return Change(rank, (subject,), item.key.quantity, old, new, note, forms)


def _texts(old: Value, new: Value, unit: str = "") -> list[str]:
    """Both values for people, with as many digits as tell them apart."""
    few, all_digits = ([value_text(v, unit, digits) for v in (old, new)] for digits in (6, 17))
    return few if few[0] != few[1] else all_digits


def judge(item: Difference) -> tuple[Rank, str]:
    """How bad a change is, and what to think of."""
    old, new = item.before, item.after
    if item.key.quantity == "axis" and isinstance(old, tuple) and isinstance(new, tuple):
        turned = float(np.dot(np.asarray(old, float), np.asarray(new, float)))
        return item.rank, "turns the other way" if turned < -0.999 else ""
    if isinstance(old, float) and isinstance(new, float) and old and new:
        ratio = new / old
        note = f"x {ratio:.4g}" if ratio > 0.0 and f"{ratio:.4g}" != "1" else ""
        for factor, text in ((DEGREES, "degrees and radians?"), (1e3, "a factor of 1000: units?")):
            if any(math.isclose(ratio, f, rel_tol=1e-3) for f in (factor, 1.0 / factor)):
                return "CRITICAL", f"{note}: {text}"
        return item.rank, note
    return item.rank, ""


# --- verdict, findings, figures -------------------------------------------------------------


def _verdict(before: Side, after: Side) -> Iterator[Change]:
    if None not in (before.ready, after.ready) and before.ready != after.ready:
        rank: Rank = "CRITICAL" if before.ready else "MEDIUM"
        yield Change(rank, ("robot",), "ready for training", *_exists(before.ready is True))


def _findings(before: Side, after: Side) -> Iterator[Change]:
    worse: dict[str, Rank] = {"error": "CRITICAL", "warning": "MEDIUM", "info": "LOW"}
    if before.ready is None or after.ready is None:
        return  # one of them was never checked
    for key in sorted({*before.findings, *after.findings}):
        old, new = before.findings.get(key), after.findings.get(key)
        if old == new or "info" in (old or "info") == (new or "info"):
            continue
        rank: Rank = worse.get(new or "info", "LOW")
        yield Change(rank, (key[1],), f"finding {key[0]}", old or "-", new or "-")


def _figures(before: Side, after: Side) -> Iterator[Change]:
    """Tell the figure of each check that changed most, where that is more than noise."""
    changed: dict[str, list[tuple[float, str, str, str]]] = {}
    for path, old in before.figures.items():
        new = after.figures.get(path)
        if new is not None and not math.isclose(old, new, rel_tol=NOISE, abs_tol=1e-9):
            check, _, figure = path.partition(".")
            share = abs(new - old) / max(abs(old), abs(new))
            changed.setdefault(check, []).append((share, figure, f"{old:.4g}", f"{new:.4g}"))
    for check, rows in changed.items():
        note = f"most of {len(rows)} figures" if len(rows) > 1 else ""
        yield Change("LOW", (f"check {check}",), *max(rows)[1:], note)


# --- files ----------------------------------------------------------------------------------


def _files(
    before: Side, after: Side, telling: frozenset[str], explained: frozenset[str]
) -> tuple[list[Change], tuple[str, ...]]:
    """(files whose bytes differ and no fact says why, files that say the same in other bytes)."""
    file_changes: list[Change] = []
    rewritten: list[str] = []
    if before.folder is None or after.folder is None:
        return file_changes, ()
    for path in sorted({*before.digests, *after.digests}):
        old, new = before.digests.get(path), after.digests.get(path)
        if old == new or path in DERIVED or path in explained:
            continue
        both = (before.forms.items(), after.forms.items())
        behind = {name for forms in both for name, form in forms if path in form.covers}
        if behind & telling:
            continue
        if old is None or new is None:
            file_changes.append(Change("LOW", (f"file {path}",), "exists", *_exists(new is None)))
            continue
        rows = [*_content_changes(path, before.folder, after.folder, "MEDIUM" if behind else "LOW")]
        if not rows:
            rewritten.append(path)
        file_changes += rows[:SHOWN_LINES]
        if len(rows) > SHOWN_LINES:
            more = f"{len(rows) - SHOWN_LINES} more places"
            file_changes.append(Change("LOW", (f"file {path}",), "and", more, "differ"))
    alone = not file_changes and not rewritten and not telling
    derived = [p for p in DERIVED if before.digests.get(p) != after.digests.get(p)]
    if alone and "manifest.json" in derived:
        file_changes += _content_changes("manifest.json", before.folder, after.folder, "LOW")
    return file_changes, (*rewritten, *(derived if alone and not file_changes else ()))


def _content_changes(path: str, before: Path, after: Path, rank: Rank) -> Iterator[Change]:
    """What two files say otherwise; nothing where both mean the same."""
    try:
        rows = rows_of(before / path, after / path, stages_of(before, path))
    except (NotParsedError, ValueError) as error:
        yield Change("HIGH", (f"file {path}",), "can be read", "?", "no", str(error))
        return
    for same in groups(rows):
        first = same[0]
        old, new = _texts(first.expected, first.found)
        names = (row.subject if row.kind != "file" else "" for row in same)
        subjects = dict.fromkeys(subject or f"file {path}" for subject in names)
        yield Change(rank, tuple(subjects), first.attribute, old, new, path)
