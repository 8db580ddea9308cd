"""What two files say differently, and the findings that report it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from assetbuild.facts.compare import EQUAL, plain_data, slug, so_for, value_text
from assetbuild.facts.table import Value
from assetbuild.findings import Finding, Scalar
from assetbuild.grouping import grouped

LONGEST = 200
"""Characters of a text that a finding quotes."""


@dataclass(frozen=True)
class Row:
    """One value that differs. kind, name: the subject, as `joint`, `FR_hip_joint`.

    expected: as the writer writes it now; found: as it lies there. None: not stated. line: of the
    file that lies there, from 1; 0 where lines mean nothing.
    """

    kind: str
    name: str
    attribute: str
    expected: Value
    found: Value
    line: int = 0

    @property
    def subject(self) -> str:
        """`joint FR_hip_joint`."""
        return f"{self.kind} {self.name}".strip()


class NotParsedError(Exception):
    """The file that lies there is not of its kind any more. line: from 1, 0 where unknown."""

    def __init__(self, message: str, line: int = 0) -> None:
        super().__init__(message)
        self.message, self.line = message, line


def groups(rows: Iterable[Row]) -> list[list[Row]]:
    """Rows of the same kind, attribute and values together."""
    alike = grouped(rows, lambda r: (r.kind, r.attribute, repr(r.expected), repr(r.found)))
    return list(alike.values())


def row_findings(rows: Iterable[Row], form: str, file: str) -> Iterator[Finding]:
    """One finding `equal.<form>.<attribute>` for each group of rows. file: path in the bundle."""
    for same in groups(rows):
        first = same[0]
        data: dict[str, Scalar | tuple[Scalar, ...]] = {
            "attribute": first.attribute,
            "expected": plain_data(first.expected),
            "found": plain_data(first.found),
        }
        subjects = tuple(dict.fromkeys(row.subject for row in same))
        if len(subjects) > 1:
            data["subjects"] = subjects
        text = f"{_sentence(first, file)}{so_for(dict.fromkeys(row.name for row in same))}"
        where = f"{file}:{first.line}" if first.line else file
        rule = EQUAL.named(f"{form}.{_short(first.attribute)}")
        yield rule(first.subject, text, data=data, where=where)


def _sentence(row: Row, file: str) -> str:
    """A row in words."""
    *path, last = row.attribute.split()
    thing = " ".join(path) or "it"
    if last == "missing":
        return f"{file} lacks {thing}: {value_text(row.expected)}"
    if last == "extra":
        return f"{file} has {thing}, its writer does not write it: {value_text(row.found)}"
    found, expected = value_text(row.found), value_text(row.expected)
    return f"{row.attribute} is {found} in {file}, {expected} by the robot"


def _short(attribute: str) -> str:
    """The last name of an attribute's path, for the rule: `physics:mass` -> `mass`."""
    last = re.sub(r"\[[^]]*\]", "", attribute).split()[-1:] or ["value"]
    return slug(last[0].rpartition(":")[2])
