"""What two files say differently, and the findings that report it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from assetbuild.facts.compare import EQUAL, NAMED, plain_data, shown, slug
from assetbuild.facts.table import Value
from assetbuild.findings import Finding, Scalar

RELATIVE, ABSOLUTE = 1e-9, 1e-14
"""Two numbers closer than this are one; absolute: beside zero."""
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


def same_number(one: float, other: float) -> bool:
    """Whether two numbers differ by no more than their last digits."""
    return one == other or abs(one - other) <= RELATIVE * abs(one) + ABSOLUTE


def same_numbers(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two vectors have the same length and numbers."""
    return len(one) == len(other) and all(map(same_number, one, other))


def numbers_of(text: str) -> tuple[float, ...] | None:
    """The numbers that a text consists of; None where it has other words."""
    try:
        return tuple(float(word) for word in text.split()) or None
    except ValueError:
        return None


def same_text(one: str, other: str) -> bool:
    """Whether two texts say the same, as numbers where both are."""
    a, b = numbers_of(one), numbers_of(other)
    if a is None or b is None:
        return one.split() == other.split()
    return same_numbers(a, b)


def value_of(text: str | None) -> Value:
    """A text as a finding quotes it: numbers as numbers."""
    if text is None:
        return None
    numbers = numbers_of(text)
    if numbers is None:
        return " ".join(text.split())[:LONGEST]
    return numbers[0] if len(numbers) == 1 else numbers


def groups(rows: Iterable[Row]) -> list[tuple[Row, ...]]:
    """Rows of the same kind, attribute and values together."""
    found: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        same = (row.kind, row.attribute, repr(row.expected), repr(row.found))
        found.setdefault(same, []).append(row)
    return [tuple(some) for some in found.values()]


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
        text = f"{_sentence(first, file)}{_others(same)}"
        where = f"{file}:{first.line}" if first.line else file
        rule = EQUAL.named(f"{form}.{_short(first.attribute)}")
        yield rule(first.subject, text, data=data, where=where)


def _sentence(row: Row, file: str) -> str:
    """A row in words."""
    *path, last = row.attribute.split()
    thing = " ".join(path) or "it"
    if last == "missing":
        return f"{file} lacks {thing}: {shown(row.expected)}"
    if last == "extra":
        return f"{file} has {thing}, its writer does not write it: {shown(row.found)}"
    return f"{row.attribute} is {shown(row.found)} in {file}, {shown(row.expected)} by the robot"


def _short(attribute: str) -> str:
    """The last name of an attribute's path, for the rule: `physics:mass` -> `mass`."""
    last = re.sub(r"\[[^]]*\]", "", attribute).split()[-1:] or ["value"]
    return slug(last[0].rpartition(":")[2])


def _others(same: Sequence[Row]) -> str:
    names = list(dict.fromkeys(row.name for row in same))[1:]
    if not names:
        return ""
    more = len(names) - (NAMED - 1)
    listed = ", ".join(f"`{name}`" for name in names[: NAMED - 1])
    return f"; so for {listed}" + (f" and {more} more" if more > 0 else "")
