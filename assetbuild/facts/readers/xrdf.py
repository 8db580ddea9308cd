"""The reader of facts of `xrdf/<robot>.xrdf`: what planners are told beside the URDF."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, filtered_pairs
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.facts.yaml_leaves import yaml_leaves
from assetbuild.robot.shapes import Sphere

PLANNING = "it is loaded beside the URDF, which says it"
SET = "spheres"
EMPTY = "{}"
"""A section that has nothing to say."""


class Xrdf(Reader):
    """Every leaf of the file is a word of the format, such as `xrdf:cspace jerk_limits`."""

    isolated: ClassVar[bool] = False
    needs: ClassVar[tuple[str, ...]] = ("xrdf",)
    form: ClassVar[str] = "xrdf"
    called: ClassVar[str] = "the XRDF"
    folder: ClassVar[str] = "xrdf"
    behind: ClassVar[tuple[str, ...]] = ("xrdf/{robot}.xrdf",)
    lacks: ClassVar[Mapping[str, str]] = {kind: PLANNING for kind, _ in VOCABULARY}
    asks: ClassVar[tuple[str, ...]] = ("xrdf",)

    def file(self, root: Path, robot: str) -> Path | None:
        """None where no XRDF was asked for."""
        path = root / f"{robot}.xrdf"
        return path if path.is_file() else None

    def read(self, path: Path) -> Table:
        """Numbers of a list in a row; UsageError where the file is no YAML."""
        book = Writer()
        for where, keys, value in yaml_leaves(path):
            subject, word, found = *_named(keys), _value(value)
            if found is None or not word:
                book.skip(where, f"`{'.'.join(keys)}`", value)
                continue
            book.put("planner", subject, {f"xrdf:{word}": found})
            book.place("planner", subject, where)
        return book.table()

    def expected(self, reference: Reference) -> Table:
        """From the links, the first keyframe, the collision spheres and the section `xrdf`."""
        book, said = Writer(), reference.options.get("xrdf") or {}
        for keys, value in _meant(reference, said):
            subject, word = _named(keys)
            book.put("planner", subject, {f"xrdf:{word}": value})
        return book.table()


def _named(keys: tuple[str, ...]) -> tuple[str, str]:
    """(subject, word) of the keys that lead to a leaf; "" where XRDF has no such place."""
    match keys:
        case ("format" | "format_version" | "tool_frames",):
            return "", keys[0]
        case ("default_joint_positions", joint):
            return f"joint {joint}", "default position"
        case ("cspace", ("joint_names" | "acceleration_limits" | "jerk_limits") as word):
            return "", f"cspace {word}"
        case (("collision" | "self_collision") as word, "geometry"):
            return "", f"{word} geometry"
        case ("self_collision", "ignore", link):
            return f"link {link}", "ignored"
        case ("geometry", name, "spheres", link, number, ("center" | "radius") as word):
            return f"link {link}", f"{name} {number} {word}"
        case ("default_joint_positions",) | ("self_collision", "ignore"):
            return "", keys[-1]
        case ("geometry", name, "spheres"):
            return "", f"{name} spheres"
    return "", ""


def _value(value: Any) -> Value:  # Any: of YAML
    if isinstance(value, bool):
        return None
    if isinstance(value, str):
        return value
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, list) and all(isinstance(part, str) for part in value):
        return tuple(value)
    if isinstance(value, list) and all(isinstance(_value(part), float) for part in value):
        return tuple(map(float, value))
    return EMPTY if value == {} else None


def _meant(
    reference: Reference,
    said: Mapping[str, Any],  # Any: plain JSON
) -> Iterator[tuple[tuple[str, ...], Value]]:
    yield ("format",), "xrdf"
    yield ("format_version",), 1.0
    free = [joint for joint in reference.tree.moving_joints if joint.mimic is None]
    frames = reference.control.keyframes
    start = dict(frames[0].joints) if frames else {}
    for joint in free:
        low, high = joint.limits.lower, joint.limits.upper
        rest = min(max(0.0, -1e308 if low is None else low), 1e308 if high is None else high)
        yield ("default_joint_positions", joint.name), start.get(joint.name, rest)
    if not free:
        yield ("default_joint_positions",), EMPTY
    names = [joint.name for joint in free if re.fullmatch(said.get("joints", ".*"), joint.name)]
    yield ("cspace", "joint_names"), tuple(names)
    for key in ("acceleration", "jerk"):
        rows = (said.get(key) or {}).items()
        found = [v for n in names for v in [v for p, v in rows if re.fullmatch(p, n)][:1]]
        if len(found) == len(names):
            yield ("cspace", f"{key}_limits"), tuple(map(float, found))
    if tools := tuple(said.get("tool_frames") or ()):
        yield ("tool_frames",), tools
    for section in ("collision", "self_collision"):
        yield (section, "geometry"), SET
    yield from _links(reference)


def _links(reference: Reference) -> Iterator[tuple[tuple[str, ...], Value]]:
    """Spheres of each link, and the links that it may overlap, each pair at the first by name."""
    tree, count = reference.tree, dict[str, int]()
    for shape in reference.shapes.of("collision"):
        if isinstance(shape.geometry, Sphere):
            number = count.setdefault(shape.link, 0)
            at = ("geometry", SET, "spheres", shape.link, str(number))
            yield (*at, "center"), tuple(shape.X_link_shape.xyz)
            yield (*at, "radius"), shape.geometry.radius
            count[shape.link] += 1
    if not count:
        yield ("geometry", SET, "spheres"), EMPTY
    apart = set(filtered_pairs(tree, reference.shapes, reference.control))
    body = {link: tree.placement(link)[0] for link in count}
    found = False
    for one in sorted(count):
        near = tuple(
            other
            for other in sorted(count)
            if one < other
            and (body[one] == body[other] or tuple(sorted((body[one], body[other]))) in apart)
        )
        found = found or bool(near)
        if near:
            yield ("self_collision", "ignore", one), near
    if not found:
        yield ("self_collision", "ignore"), EMPTY
