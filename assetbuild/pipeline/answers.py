"""Findings on the source that an edit of the recipe has answered: information, with its name.

The lints of the source run again on what the edits leave, and what they no longer find is answered.
What only the source can lack (`<limit>` without `lower`, an effort of 0) is answered where an edit
or a row of the actuator table states what is missing. No list says which edit answers which rule.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from assetbuild.engine.make import NodeResult
from assetbuild.findings import Finding
from assetbuild.grouping import grouped
from assetbuild.recipe.models import Recipe
from assetbuild.robot.actuator_table import extended

_EDIT = re.compile(r"edit \d+ (\w+)")


@dataclass(frozen=True)
class Answers:
    """What one recipe says of its source. edits: (name, finding), by the subject that they changed.

    renamed: subject in the source -> now. rows: see `_rows`.
    """

    edits: Mapping[str, Sequence[tuple[str, Finding]]]
    renamed: Mapping[str, str]
    rows: tuple[tuple[str, frozenset[str]], ...]

    def left_open(
        self, findings: Iterable[Finding], again: Iterable[Finding] | None
    ) -> Iterator[Finding]:
        """What a step says of the source, the answered part as information.

        again: what the same lint says of the edited robot, and which is reported besides.
        """
        left = None if again is None else {(finding.rule, finding.subject) for finding in again}
        for finding in findings:
            subject = finding.subject
            if left is not None and (finding.rule, self.renamed.get(subject, subject)) in left:
                continue
            by = self._by(finding, gone=left is not None)
            yield _answered(finding, by) if by and finding.severity != "info" else finding

    def _by(self, finding: Finding, *, gone: bool) -> tuple[str, ...]:
        """What of the recipe answers a finding; gone: the edited robot gives no cause for it."""
        if gone:
            kind = finding.subject.partition(" ")[0]  # a joint that mimics is answered by another
            alike = [pairs for on, pairs in self.edits.items() if on.partition(" ")[0] == kind]
            others = chain.from_iterable(alike or self.edits.values())
            edits = self.edits.get(finding.subject) or others
            return tuple(dict.fromkeys(name for name, _ in edits))
        missing, given = _listed(finding, "missing"), self._given(finding.subject)
        if {*missing} - given.keys():
            return ()
        return tuple(dict.fromkeys(given[str(name)] for name in missing))

    def _given(self, subject: str) -> dict[str, str]:
        """What the recipe states of a link or joint of the source -> what states it."""
        kind, _, name = subject.partition(" ")
        rows = [names for joints, names in self.rows if re.fullmatch(joints, name)]
        table = {name: "actuators" for names in rows for name in names} if kind == "joint" else {}
        edits = self.edits.get(subject, ())
        return table | {str(key): edit for edit, one in edits for key in _listed(one, "stated")}


def answers(recipe: Recipe, results: Mapping[str, NodeResult], prefix: str) -> Answers:
    """What a recipe's table and the edits in the results say. prefix: of its labels, `arm `."""
    said = [
        (edit[1], finding)
        for label, result in results.items()
        if label.startswith(prefix) and (edit := _EDIT.fullmatch(label.removeprefix(prefix)))
        for finding in result.findings
    ]
    names = dict(renamed(finding for _, finding in said))
    return Answers(grouped(said, lambda pair: pair[1].subject), names, tuple(_rows(recipe)))


def renamed(findings: Iterable[Finding]) -> Iterator[tuple[str, str]]:
    """(subject before, subject after) of each renaming among the findings of edits, in order."""
    for finding in findings:
        if finding.rule == "edit.rename":
            yield f"{finding.subject.partition(' ')[0]} {finding.data['before']}", finding.subject


def _listed(finding: Finding, key: str) -> tuple[object, ...]:
    value = finding.data.get(key)
    return value if isinstance(value, tuple) else ()


def _rows(recipe: Recipe) -> Iterator[tuple[str, frozenset[str]]]:
    """(pattern of joints, which limits the row or its motor states; a passive one needs none)."""
    for row in recipe.actuators or ():
        motor = extended(row.motor, recipe.motors) if row.motor else None
        stated = (
            name
            for name in ("effort", "velocity")
            if row.model == "passive"
            or any(getattr(each, name, None) is not None for each in (row, motor))
        )
        yield row.joints, frozenset(stated)


def _answered(finding: Finding, by: tuple[str, ...]) -> Finding:
    which = ", ".join(f"`{name}`" for name in by)
    verb = "answers" if len(by) == 1 else "answer"
    message = f"{finding.message}; {which} in the recipe {verb} this"
    data = {**finding.data, "answered_by": by}
    return replace(finding, severity="info", message=message, data=data, hint="", blocks=False)
