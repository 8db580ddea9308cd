"""Any file as a tree of what it states, what differs between two such trees, and the findings."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from assetbuild.facts.compare import EQUAL, plain_data, slug, so_for, value_text
from assetbuild.facts.table import Value
from assetbuild.findings import Finding, Scalar
from assetbuild.grouping import grouped
from assetbuild.robot.pose import Array

DOUBLE, SINGLE, ZERO = 1e-9, 2e-7, 1e-14
"""Relative tolerance of numbers and of those stored in fewer than 8 bytes; absolute beside zero."""
SHORT = 4
"""Numbers of a vector that is shown whole; of a longer one only the first that differs."""
MOST = 16
"""Numbers that a finding shows at most."""
EXACT_INTEGERS = 2**53
"""A larger integer is shown as text, because a float does not hold all of its digits."""


class Words(str):
    """Text of a file in which numbers may be spelled in several ways."""

    __slots__ = ()

    @property
    def numbers(self) -> tuple[float, ...] | None:
        """None where it has other words."""
        try:
            return tuple(float(word) for word in self.split()) or None
        except ValueError:
            return None


@dataclass(frozen=True)
class Node:
    """A part of a file. value: what it states itself; parts: what it consists of, by key.

    subject: (kind, name) where the part is a thing with a name. line: from 1; 0 where unknown.
    ordered: whether the order of its parts means something.
    """

    value: object = None
    parts: Mapping[str, Node] = field(default_factory=dict)
    line: int = 0
    subject: tuple[str, str] | None = None
    ordered: bool = False


@dataclass(frozen=True)
class _Place:
    """The nearest thing with a name, and the keys from there."""

    kind: str = "file"
    name: str = ""
    path: str = ""

    def at(self, key: str, node: Node) -> _Place:
        if node.subject:
            return _Place(*node.subject)
        space = "" if key.startswith("[") or not self.path else " "
        return _Place(self.kind, self.name, f"{self.path}{space}{key}")

    def row(self, expected: object, actual: object, line: int, what: str = "") -> Row:
        attribute = f"{self.path} {what}".strip() or "value"
        return Row(self.kind, self.name, attribute, quoted(expected), quoted(actual), line)


def tree_rows(again: Node, there: Node) -> list[Row]:
    """What two files state differently."""
    return list(_rows(again, there, _Place().at("", again)))


def _rows(again: Node, there: Node, place: _Place) -> Iterator[Row]:
    if not same(again.value, there.value):
        yield _value_row(again.value, there.value, place, there.line)
    for key in dict.fromkeys((*again.parts, *there.parts)):
        one, other = again.parts.get(key), there.parts.get(key)
        part = place.at(key, one or other or there)
        if one is not None and other is not None:
            yield from _rows(one, other, part)
        elif one is not None:
            yield part.row(_summary(one), None, there.line, _absence(one, "missing"))
        elif other is not None:
            yield part.row(None, _summary(other), other.line, _absence(other, "extra"))
    if again.ordered and again.parts.keys() == there.parts.keys():
        before, after = (", ".join(node.parts) for node in (again, there))
        if before != after:
            yield place.row(before, after, there.line, "order")


def _absence(node: Node, what: str) -> str:
    """A plain value that only one side states has no value on the other."""
    return what if node.parts or node.subject else ""


def _summary(node: Node) -> object:
    """The value of a part, else what it consists of."""
    if node.value is not None or not node.parts:
        return "" if node.value is None else node.value
    parts = (f"{key}={quoted(_summary(part))}" for key, part in node.parts.items())
    return " ".join(parts)[:LONGEST]


def _value_row(one: object, other: object, place: _Place, line: int) -> Row:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.ndim and other.ndim:
        if len(one) != len(other):
            return place.row(len(one), len(other), line, "length")
        if one.ndim > 1 or len(one) > SHORT:
            index = next(i for i in range(len(one)) if not same(one[i], other[i]))
            inside = place.at(f"[{index}]", Node())
            return _value_row(one[index], other[index], inside, line)
    if _is_float_for_int(one, other) and one == other:
        return place.row(str(one), str(other), line)  # both would be shown as one number
    return place.row(one, other, line)


def same(one: object, other: object) -> bool:
    """Whether two values are the same, numbers but for their last digits.

    A count stays an integer: `range(4.0)` is an error.
    """
    if isinstance(one, str) and isinstance(other, str):
        if one == other or not isinstance(one, Words):
            return one == other
        ours, theirs = one.numbers, Words(other).numbers
        is_text = ours is None or theirs is None
        return one.split() == other.split() if is_text else same(ours, theirs)
    if _is_float_for_int(one, other) or not (_is_numeric(one) and _is_numeric(other)):
        return type(one) is type(other) and bool(one == other)
    a, b = np.asarray(one), np.asarray(other)
    if a.shape != b.shape or "f" not in a.dtype.kind + b.dtype.kind:
        return bool(np.array_equal(a, b))
    tolerance = SINGLE if a.dtype.itemsize < 8 else DOUBLE
    return bool(np.allclose(b, a, rtol=tolerance, atol=ZERO, equal_nan=True))


def _is_float_for_int(one: object, other: object) -> bool:
    return type(one) is int and type(other) is float


def _is_numeric(value: object) -> bool:
    types = (np.ndarray, np.generic, int, float, tuple)
    return isinstance(value, types) and not isinstance(value, bool)


def of_one_sign(quats: Array) -> Array:
    """(..., 4) quaternions, each with its first part that is not 0 positive; -q turns like q."""
    if not quats.size:
        return quats
    first = np.argmax(quats != 0.0, axis=-1)[..., None]
    signs = np.where(np.take_along_axis(quats, first, -1) < 0.0, -1.0, 1.0)
    return np.asarray(quats * signs.astype(quats.dtype))


def quoted(value: object) -> Value:
    """A value as a finding shows it."""
    if isinstance(value, Words):
        value = value.numbers or str(value)
    if value is None or isinstance(value, bool):
        return value
    too_large = isinstance(value, int) and abs(value) > EXACT_INTEGERS
    if not _is_numeric(value) or too_large or np.asarray(value).dtype.kind not in "iuf":
        return " ".join(str(value).split())[:LONGEST]
    flat = np.ravel(np.asarray(value, dtype=float)).tolist()
    return float(flat[0]) if len(flat) == 1 else tuple(flat[:MOST])


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
    return f"{row.attribute} is {found} in {file}, {expected} in the robot"


def _short(attribute: str) -> str:
    """The last name of an attribute's path, for the rule: `physics:mass` -> `mass`."""
    last = re.sub(r"\[[^]]*\]", "", attribute).split()[-1:] or ["value"]
    return slug(last[0].rpartition(":")[2])
