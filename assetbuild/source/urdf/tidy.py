"""Untidy text that readers of URDF take alike becomes the text they mean, each with a finding.

One table says what: where, what is wrong and how it is taken, the rule, what readers do with it.
What urdfdom, yourdfpy, PyBullet and MuJoCo take differently stays as it is, and the strict readers
of links and joints refuse it. See docs/reference/readers.md, which says what each of them does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from assetbuild.errors import SourceError
from assetbuild.findings import Rule
from assetbuild.robot.model import URDF_UNLIMITED
from assetbuild.source.urdf.quaternions import (
    QUATERNION,
    QUATERNION_NORM,
    VERSION,
    Taken,
    of_other_length,
    tidy_quaternion,
    tidy_version,
)
from assetbuild.source.urdf.xml import HOME, Node, parse
from assetbuild.xml_text import FAULTS, Fault, number_words

FAULT = Rule(
    "urdf.xml",
    "warning",
    "the text is not quite XML (a late `<?xml ...?>`, bytes after the end, a prefix that is "
    "declared nowhere, ...); readers of URDF overlook it",
    "mend the line",
)
REPEATED = Rule(
    "urdf.repeated",
    "warning",
    "an element occurs twice where one is expected: the first is used, as in urdfdom, yourdfpy and "
    "PyBullet",
    "MuJoCo refuses it: remove one of the two",
)
SEPARATORS = Rule(
    "urdf.separators",
    "warning",
    "commas or semicolons separate numbers or follow them; they count as blanks",
    "urdfdom and MuJoCo refuse them: write blanks alone",
)
BLANK = Rule(
    "urdf.empty_attribute",
    "warning",
    "an attribute has no text and counts as absent",
    "remove it, or give its value",
)
INCOMPLETE = Rule(
    "urdf.inertial.incomplete",
    "warning",
    "`<inertial>` lacks a mass or a part of its tensor; without a mass it counts as absent, "
    "without a moment the tensor counts as 0, a missing product counts as 0",
    "state the mass and all six numbers, or use the edit `inertia_from_geometry`",
)
NO_LIMIT = Rule(
    "urdf.limit.none",
    "warning",
    "an effort or velocity limit is negative or infinite, or a revolute joint's range is infinite: "
    "it counts as not stated",
    "readers take it differently: state it in the URDF, or in the recipe's actuator table",
)
VISUAL_NOTHING = Rule(
    "urdf.visual.nothing",
    "warning",
    "a `<visual>` names no shape, or one without width or thickness: it was left out",
    "remove it, or give its size",
)
COLLISION_NOTHING = Rule(
    "urdf.collision.nothing",
    "warning",
    "a `<collision>` names no shape, or one without width or thickness: it was left out",
    "remove it, or give its size",
)
CAPSULE_BALL = Rule(
    "urdf.capsule.ball",
    "info",
    "a capsule of length 0 is the sphere of its radius and was read as one",
    "write `<sphere>`",
)
SCALE = Rule(
    "urdf.mesh.scale",
    "warning",
    "a mesh's scale is one number, or more than three equal ones: it counts for all three axes",
    "urdfdom and MuJoCo refuse it: write three numbers",
)
COLOUR = Rule(
    "urdf.material.colour",
    "warning",
    "`rgba` is not four numbers: three are opaque, of more the first four count, anything else "
    "leaves the shape without a colour",
    "write red, green, blue and opacity, each from 0 to 1",
)
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_OPTIONAL = frozenset({"origin", "mass", "inertia", "limit", "dynamics", "mimic"})
"""Elements whose numbers count as absent when they have no text."""
_LISTS = {"xyz": 3, "rpy": 3, "quat_xyzw": 4, "size": 3, "scale": 3, "rgba": 4}
"""How many numbers these attributes hold; all others that are no text hold one."""
_TEXT = frozenset({"name", "version", "filename", "type", "link", "joint"})
_MANY = frozenset({"visual", "collision"})


@dataclass(frozen=True)
class Sloppy:
    """A row. where: paths of elements below <robot>; mend: mends one and yields what was wrong.

    summed: words of one finding for them all.
    """

    where: tuple[str, ...]
    mend: Callable[[Node], Iterator[Taken]]
    rule: Rule
    summed: str = ""


def read_tidy(data: bytes, file: str) -> Node:
    """The <robot> element of a URDF in tidy text; what was taken for what is reported."""
    root, faults = parse(data, file)
    _report_overlooked(root, faults)
    _remove_same_materials(root)
    for row in TABLE:
        _mend(root, row)
    return root


def _mend(root: Node, row: Sloppy) -> None:
    """Mend all that a row is about."""
    fixes: list[tuple[int, str]] = []
    for element in [one for path in row.where for one in root.element.findall(path)]:
        node = root.of(element)
        around = [root.of(one) for one in (element, *element.iterancestors())][:-1]
        if around:
            node = node.about(f"{around[-1].tag} {around[-1].get('name')}")
        for text, more in row.mend(node):
            if row.summed:
                fixes.append((node.line, text))
            else:
                node.report(row.rule, text, data={"line": node.line, **more})
    if fixes:
        (line, first), times = fixes[0], f"{len(fixes)} times" if len(fixes) > 1 else "once"
        message = f"{row.summed}, {times} (line {line}: `{first}`)"
        root.report(row.rule, message, data={"count": len(fixes), "line": line})


# --- text and numbers -----------------------------------------------------------------------


def _report_overlooked(root: Node, faults: tuple[Fault, ...]) -> None:
    """The first fault of each kind."""
    for kind, fault in reversed({fault.kind: fault for fault in faults[::-1]}.items()):
        what, remedy = FAULTS[kind]
        message = f"line {fault.line}: {what}: `{fault.text}`"
        root.report(FAULT, message, remedy, data={"fault": kind, "line": fault.line})


def _only_first(node: Node) -> Iterator[Taken]:
    """Remove what stands a second time."""
    children = HOME[node.tag].children - _MANY if node.tag in HOME else ()
    for tag in ("*",) if node.tag == "geometry" else sorted(children):
        for extra in node.all(tag)[1:]:
            extra.remove()
            yield _repeated(node, extra)


def _repeated(parent: Node, extra: Node) -> Taken:
    what = f"another <{extra.tag}>" if parent.tag == "geometry" else f"a second <{extra.tag}>"
    text = f"{what} in one <{parent.tag}> on line {extra.line}: it is not read, the first counts"
    return text, {"element": extra.tag, "line": extra.line}


def _remove_same_materials(root: Node) -> None:
    """A material that is defined again with the same look is one material."""
    seen: dict[str, object] = {}
    for material in root.all("material"):
        name = material.get("name") or ""
        stated = [(c.tag, sorted(c.element.items())) for c in material.all("*")]
        look = [(tag, [(key, _values(str(text))) for key, text in items]) for tag, items in stated]
        if name in seen and seen[name] == look:
            material.remove()
            text, data = _repeated(root, material)
            root.about(f"material {name}").report(REPEATED, text, data=data)
        seen.setdefault(name, look)


def _values(text: str) -> list[float] | list[str]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return text.split()


def _counts(node: Node) -> Iterator[tuple[str, int, str]]:
    """(attribute, how many numbers it should have, its text) of those that are stated."""
    for name in sorted(HOME[node.tag].attributes - _TEXT) if node.tag in HOME else ():
        if (stated := node.get(name)) is not None:
            yield name, _LISTS.get(name, 1), stated


def _blank(node: Node) -> Iterator[Taken]:
    for name, _, stated in _counts(node):
        if not stated.strip() and node.tag in _OPTIONAL:
            del node.element.attrib[name]
            yield f'{name}="{stated}"', {}


def _separated(node: Node) -> Iterator[Taken]:
    for name, count, stated in _counts(node):
        words = number_words(stated, count)
        if words != stated.split():
            node.element.set(name, " ".join(words))
            yield f'{name}="{stated}"', {}


# --- masses, limits, shapes and looks ---------------------------------------------------------


def _incomplete(inertial: Node) -> Iterator[Taken]:
    """Drop an <inertial> without a mass; without a moment the tensor is 0."""
    mass, tensor, at = inertial.only("mass"), inertial.only("inertia"), f"line {inertial.line}"
    if mass is None or mass.get("value") is None:
        inertial.remove()
        text = f"<inertial> on {at}: it states no mass and counts as absent"
        yield text, {"missing": ("mass", "inertia")}
        return
    tensor = tensor if tensor is not None else inertial.added("inertia")
    missing = [name for name in MOMENTS if tensor.get(name) is None]
    none = any(name in missing for name in MOMENTS[:3])
    for name in MOMENTS if none else missing:
        tensor.element.set(name, "0")
    if missing:
        words = ", ".join(f"`{name}`" for name in missing)
        what = "it states no tensor (`ixx`, `iyy`, `izz`), which counts as 0"
        what = what if none else f"<inertia> lacks {words}: taken as 0"
        yield f"<inertial> on {at}: {what}", {"missing": ("inertia",)}


def _no_limit(limit: Node) -> Iterator[Taken]:
    """A limit below zero or without end is none."""
    parent = limit.element.getparent()
    kind = parent.get("type") if parent is not None else None
    if kind not in ("revolute", "continuous", "prismatic"):
        return
    values = {name: _float(text) for name in HOME["limit"].attributes if (text := limit.get(name))}
    gone = [n for n in ("effort", "velocity") if (v := values.get(n, 0.0)) < 0.0 or v == math.inf]
    lower, upper = values.get("lower", 0.0), values.get("upper", 0.0)
    endless = lower <= -URDF_UNLIMITED and upper >= URDF_UNLIMITED and kind == "revolute"
    for name in (*gone, *(("lower", "upper") if endless else ())):
        stated = limit.get(name)
        del limit.element.attrib[name]
        how = "has no end: the joint counts as continuous" if endless else "counts as not stated"
        if name != "upper":
            text = f"limit {name} `{stated}` on line {limit.line} {how}"
            yield text, {"limit": name, "stated": stated, "missing": (name,)}
    if endless and parent is not None:
        parent.set("type", "continuous")


def _float(text: str) -> float:
    """The number, infinite ones included; not a number where there is none."""
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan


def _no_shape(shape: Node) -> Iterator[Taken]:
    """Take its size away: the shape keeps its place, so that its neighbours keep their names."""
    geometry = shape.only("geometry")
    size = geometry.only("*") if geometry is not None else None
    what = "names no shape" if size is None else _without_volume(size)
    if size is not None and what:
        size.remove()
    if what:
        yield f"a <{shape.tag}> on line {shape.line} {what}: it was left out", {}


def _without_volume(size: Node) -> str:
    """That it has no width or thickness; "" for all else, and for what its reader refuses."""
    try:
        if size.tag == "box":
            edges = size.numbers("size", 3)
            zeros = edges.count(0.0) if min(edges) >= 0.0 else 0
            wide, thick = zeros < 2, zeros == 0
        else:
            lengths = {"sphere": ("radius",), "cylinder": ("radius", "length")}
            lengths["capsule"] = lengths["cylinder"]
            wide, *more = (size.number(name) != 0.0 for name in lengths.get(size.tag, ()))
            thick = all(more)
    except (SourceError, ValueError):
        return ""
    return "" if wide and thick else f"is a <{size.tag}> without {'thickness' if wide else 'width'}"


def _ball(capsule: Node) -> Iterator[Taken]:
    try:
        flat = capsule.number("length") == 0.0 and capsule.number("radius") != 0.0
    except SourceError:
        return
    if flat:
        capsule.element.tag = "sphere"
        del capsule.element.attrib["length"]
        yield f"a <capsule> of length 0 on line {capsule.line} is read as a <sphere>", {}


def _scale(mesh: Node) -> Iterator[Taken]:
    """One number counts for all axes, and so do equal numbers that are too many."""
    scale = (mesh.get("scale") or "").split()
    if len(scale) not in (0, 2, 3) and len(set(scale)) == 1:
        mesh.element.set("scale", " ".join(scale[:1] * 3))
        count = "is one number" if len(scale) == 1 else f"is {len(scale)} equal numbers"
        stated = f"mesh scale `{' '.join(scale)}` on line {mesh.line}"
        yield f"{stated} {count}: taken for all three axes", {}


def _colour(color: Node) -> Iterator[Taken]:
    stated = color.get("rgba")
    words = (stated or "").split()
    try:
        color.numbers("rgba", max(len(words), 3))
    except SourceError:
        color.remove()
        what = f"<color> on line {color.line} states no rgba of four numbers: no colour is read"
        yield what, {"rgba": stated}
        return
    if len(words) != 4:
        color.element.set("rgba", " ".join([*words, "1"][:4]))
        what = f"rgba `{stated}` on line {color.line} has {len(words)} numbers: read as "
        yield f"{what}`{color.get('rgba')}`", {"rgba": stated}


# --- the table ------------------------------------------------------------------------------

_TOPS = ("material", "link", "joint")
_ALL = (*_TOPS, *(f"{tag}//*" for tag in _TOPS))
_ORIGINS = ("joint//origin", "link//origin")
TABLE = (
    Sloppy(_ALL, _only_first, REPEATED),
    Sloppy(_ALL, _blank, BLANK, "attributes without text read as absent"),
    Sloppy(_ALL, _separated, SEPARATORS, "commas or semicolons beside numbers read as blanks"),
    Sloppy((".",), tidy_version, VERSION),
    Sloppy(_ORIGINS, tidy_quaternion, QUATERNION, "origins turned by `quat_xyzw`"),
    Sloppy(_ORIGINS, of_other_length, QUATERNION_NORM),
    Sloppy(("link/inertial",), _incomplete, INCOMPLETE),
    Sloppy(("joint/limit",), _no_limit, NO_LIMIT),
    Sloppy(("material//color", "link//color"), _colour, COLOUR),
    Sloppy(("link/*/geometry/capsule",), _ball, CAPSULE_BALL),
    Sloppy(("link/visual",), _no_shape, VISUAL_NOTHING),
    Sloppy(("link/collision",), _no_shape, COLLISION_NOTHING),
    Sloppy(("link/*/geometry/mesh",), _scale, SCALE),
)
