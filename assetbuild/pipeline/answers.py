"""Findings on the source that an edit of the recipe has answered: information, with its name.

The lints of the source run again on what the edits leave, and what they no longer find is answered.
What only the source can lack (`<limit>` without `lower`, an effort of 0) is answered where an edit
or a row of the actuator table states what is missing. No list says which edit answers which rule.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from assetbuild.engine.make import NodeResult
from assetbuild.findings import Finding
from assetbuild.recipe.models import Recipe
from assetbuild.robot.actuator_table import extended

_EDIT = re.compile(r"edit \d+ (\w+)")


@dataclass(frozen=True)
class Answers:
    """What one recipe says of its source. edits: their names by the subject that they changed.

    stated: what is given of a subject, `lower`, and by what. renamed: subject in the source -> now.
    """

    edits: dict[str, tuple[str, ...]] = field(default_factory=dict)
    stated: dict[str, dict[str, str]] = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)
    rows: tuple[tuple[str, frozenset[str]], ...] = ()

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
            every = dict.fromkeys(name for names in self.edits.values() for name in names)
            return self.edits.get(finding.subject) or tuple(every)
        missing, given = finding.data.get("missing", ()), self._given(finding.subject)
        if not isinstance(missing, tuple) or {*missing} - given.keys():
            return ()
        return tuple(dict.fromkeys(given[str(name)] for name in missing))

    def _given(self, subject: str) -> dict[str, str]:
        """What the recipe states of a link or joint of the source -> what states it."""
        kind, _, name = subject.partition(" ")
        rows = [names for joints, names in self.rows if re.fullmatch(joints, name)]
        table = {name: "actuators" for names in rows for name in names} if kind == "joint" else {}
        return table | self.stated.get(subject, {})


def answers(recipe: Recipe, results: Mapping[str, NodeResult], prefix: str) -> Answers:
    """What a recipe's table and the edits in the results say. prefix: of its labels, `arm `."""
    recipe_answers = Answers(rows=tuple(_rows(recipe)))
    for label, result in results.items():
        edit = _EDIT.fullmatch(label.removeprefix(prefix)) if label.startswith(prefix) else None
        for finding in result.findings if edit else ():
            assert edit is not None  # noqa: S101 # the line above says so
            kind, _, _ = finding.subject.partition(" ")
            if "before" in finding.data and edit[1] == "rename":
                recipe_answers.renamed[f"{kind} {finding.data['before']}"] = finding.subject
            edits = (*recipe_answers.edits.get(finding.subject, ()), edit[1])
            recipe_answers.edits[finding.subject] = tuple(dict.fromkeys(edits))
            given = finding.data.get("stated")
            names = given if isinstance(given, tuple) else ()
            recipe_answers.stated.setdefault(finding.subject, {}).update(
                {str(n): edit[1] for n in names}
            )
    return recipe_answers


def _rows(recipe: Recipe) -> Iterator[tuple[str, frozenset[str]]]:
    """(pattern of joints, which limits the row or its motor states; a passive one needs none)."""
    for row in recipe.actuators or ():
        motor = extended(row.motor, recipe.motors) if row.motor else None
        both = [
            name
            for name in ("effort", "velocity")
            if row.model == "passive"
            or getattr(row, name) is not None
            or (motor and getattr(motor, name) is not None)
        ]
        yield row.joints, frozenset(both)


def _answered(finding: Finding, by: tuple[str, ...]) -> Finding:
    which = ", ".join(f"`{name}`" for name in by)
    verb = "answers" if len(by) == 1 else "answer"
    message = f"{finding.message}; {which} in the recipe {verb} this"
    data = {**finding.data, "answered_by": by}
    return replace(finding, severity="info", message=message, data=data, hint="", blocks=False)
