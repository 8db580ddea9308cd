"""XML as Menagerie writes it: two spaces, 120 columns, name and class first, shortest numbers."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from xml.etree.ElementTree import Element

from assetbuild.robot.pose import Pose

COLUMNS = 120
BLANKS = str.maketrans({"\n": "&#10;", "\t": "&#9;", "\r": "&#13;"})
"""In an attribute a reader would make blanks of these."""
DIRT_ULPS = 4
"""A sum of decimals misses the decimal that it means by so many units in the last place."""
NOTHING = 1e-15
"""Components of poses and unit vectors below this are what sin(pi) leaves, m or 1."""


def element(
    tag: str, attributes: Mapping[str, str | None] | None = None, children: Iterable[Element] = ()
) -> Element:
    """An element; attributes whose value is None are left out."""
    made = Element(tag, {key: v for key, v in (attributes or {}).items() if v is not None})
    made.extend(children)
    return made


def number(value: float) -> str:
    """Shortest text of the double, or of the decimal that it means: `1`, `0.0375`, `1e-06`."""
    return exact(plain(value))


def exact(value: float) -> str:
    """Shortest text that reads back to the same double."""
    return repr(value).removesuffix(".0")


def plain(value: float) -> float:
    """The short decimal that it is but for the rounding of a sum (0.6799999999999999), else it."""
    value = float(value) + 0.0  # + 0.0: negative zero is zero
    decimal = float(f"{value:.12g}")
    return decimal if abs(decimal - value) <= DIRT_ULPS * math.ulp(value) else value


def numbers(values: Iterable[float]) -> str:
    """Numbers with one space between."""
    return " ".join(number(value) for value in values)


def direction(vector: Sequence[float]) -> str:
    """A unit vector or a position, without what rounding leaves where 0 is meant."""
    return numbers(0.0 if abs(v) < NOTHING else v for v in vector)


def pose_attributes(pose: Pose) -> dict[str, str | None]:
    """`pos` and `quat`, each only where it is not MuJoCo's default."""
    pos, quat = direction(pose.xyz), _quaternion(pose.quat)
    return {"pos": pos if pos != "0 0 0" else None, "quat": quat if quat != "1 0 0 0" else None}


def _quaternion(quat: Sequence[float]) -> str:
    """A quarter turn is `1 1 0 0`: MuJoCo normalises, and people can read it."""
    turning = [v for v in quat if abs(v) >= NOTHING]
    size = abs(turning[0]) if turning else 1.0
    if len(turning) == 2 and all(abs(abs(v) - size) < NOTHING for v in turning):
        return direction([v / size if abs(v) >= NOTHING else 0.0 for v in quat])
    return direction(quat)


def document(root: Element, comment: str) -> str:
    """The text of an XML file; `comment` (without two hyphens) stands at the top.

    An empty line stands before every section but the first. Not recursive: a robot may be a chain
    of any length.
    """
    lines = [f"<!-- {comment} -->"]
    waiting: list[tuple[int, Element | str]] = [(0, root)]
    while waiting:
        depth, item = waiting.pop()
        indent = "  " * depth
        if isinstance(item, str):
            lines.append(f"{indent}{item}")
            continue
        if depth == 1 and item is not root[0]:
            lines.append("")
        lines += _wrapped(indent, item)
        if len(item):
            waiting.append((depth, f"</{item.tag}>"))
            waiting += [(depth + 1, child) for child in reversed(item)]
    return "\n".join(lines) + "\n"


def _wrapped(indent: str, item: Element) -> list[str]:
    """The opening tag, attributes that do not fit on lines of their own, as Menagerie has it."""
    columns = max(COLUMNS, len(indent) + COLUMNS // 2)
    lines = [f"{indent}<{item.tag}"]
    for key, value in item.items():
        word = f"{key}={_quoted(value)}"
        if len(lines[-1]) + 1 + len(word) + 2 > columns:  # 2: the tag's end
            lines.append(f"{indent}  {word}")
        else:
            lines[-1] += f" {word}"
    lines[-1] += ">" if len(item) else "/>"
    return lines


def _quoted(value: str) -> str:
    # `xml.sax.saxutils.quoteattr` would import what downloads over HTTPS.
    return f'"{html.escape(value).translate(BLANKS)}"'
