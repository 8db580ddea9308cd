"""XML as Menagerie writes it: two spaces, name and class first, shortest exact numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from assetbuild.robot.pose import Pose


@dataclass(frozen=True)
class Element:
    """One element; `gap` leaves an empty line before it."""

    tag: str
    attributes: tuple[tuple[str, str], ...] = ()
    children: tuple[Element, ...] = ()
    gap: bool = False


def element(
    tag: str,
    attributes: Mapping[str, str | None] | None = None,
    children: Iterable[Element] = (),
    *,
    gap: bool = False,
) -> Element:
    """An element; attributes whose value is None are left out."""
    kept = tuple((key, v) for key, v in (attributes or {}).items() if v is not None)
    return Element(tag, kept, tuple(children), gap)


def number(value: float) -> str:
    """Shortest text that reads back to the same double: `1`, `0.0375`, `1e-06`."""
    text = repr(float(value) + 0.0)  # + 0.0: negative zero is zero
    return text.removesuffix(".0")


def numbers(values: Iterable[float]) -> str:
    """Numbers with one space between."""
    return " ".join(number(value) for value in values)


def pose_attributes(pose: Pose) -> dict[str, str | None]:
    """`pos` and `quat`, each only where it is not MuJoCo's default."""
    return {
        "pos": numbers(pose.xyz) if pose.xyz != (0.0, 0.0, 0.0) else None,
        "quat": numbers(pose.quat) if pose.quat != (1.0, 0.0, 0.0, 0.0) else None,
    }


def document(root: Element, comment: str) -> str:
    """The text of an XML file; `comment` (without two hyphens) stands at the top.

    Not recursive: a robot may be a chain of any length.
    """
    lines = [f"<!-- {comment} -->"]
    waiting: list[tuple[int, Element | str]] = [(0, root)]
    while waiting:
        depth, item = waiting.pop()
        indent = "  " * depth
        if isinstance(item, str):
            lines.append(f"{indent}{item}")
            continue
        if item.gap:
            lines.append("")
        attributes = "".join(f" {key}={_quoted(value)}" for key, value in item.attributes)
        if not item.children:
            lines.append(f"{indent}<{item.tag}{attributes}/>")
            continue
        lines.append(f"{indent}<{item.tag}{attributes}>")
        waiting.append((depth, f"</{item.tag}>"))
        waiting += [(depth + 1, child) for child in reversed(item.children)]
    return "\n".join(lines) + "\n"


def _quoted(value: str) -> str:
    return quoteattr(value, {"\n": "&#10;", "\t": "&#9;", "\r": "&#13;"})
