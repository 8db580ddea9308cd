"""Shapes and looks of a URDF that say less, or more, than a shape or a colour needs."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.errors import SourceError
from assetbuild.findings import Finding, Rule
from assetbuild.source.urdf.xml import Node

VISUAL_NOTHING = Rule(
    "urdf.visual.nothing",
    "warning",
    "a `<visual>` names no shape, or one without width or thickness (a sphere of radius 0, a box "
    "with an edge of 0): it was left out",
    "remove it, or give its size",
)
COLLISION_NOTHING = Rule(
    "urdf.collision.nothing",
    "warning",
    "a `<collision>` names no shape, or one without width or thickness (a sphere of radius 0, a "
    "box with an edge of 0, a cylinder of length 0): it was left out",
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
    "write three numbers",
)
COLOUR = Rule(
    "urdf.material.colour",
    "warning",
    "`rgba` is not four numbers: three are opaque, of more the first four count, anything else "
    "leaves the shape without a colour",
    "write red, green, blue and opacity",
)


def tidy_shapes(parent: Node) -> Iterator[Finding]:
    """All shapes and looks inside of a link, or of a material of the robot."""
    for element in list(parent.element.iter("color")):
        yield from _tidy_colour(Node(element, parent.file, parent.subject))
    for role in ("visual", "collision"):
        for shape in parent.all(role):
            yield from _tidy_shape(parent, shape)


def _tidy_shape(link: Node, shape: Node) -> Iterator[Finding]:
    geometry = shape.only("geometry")
    sizes = geometry.all("*") if geometry is not None else []
    if not sizes:
        yield _left_out(link, shape, "names no shape")
        return
    size = sizes[0]
    try:
        flat = _zero_edges(size)
    except SourceError:
        return  # the reader of shapes says it better
    if flat == "all":
        yield _left_out(link, shape, f"is a <{size.tag}> without width")
    elif flat == "one" and size.tag == "capsule":
        size.element.tag = "sphere"
        del size.element.attrib["length"]
        message = f"a <capsule> of length 0 on line {size.line} is read as a <sphere>"
        yield CAPSULE_BALL(link.subject, message, "write <sphere>", data={"line": size.line})
    elif flat == "one":
        yield _left_out(link, shape, f"is a <{size.tag}> without thickness")
    yield from _tidy_scale(link, size)


def _tidy_scale(link: Node, size: Node) -> Iterator[Finding]:
    """One number counts for all axes, and so do equal numbers that are too many."""
    scale = (size.get("scale") or "").split()
    if size.tag != "mesh" or len(scale) in (0, 2, 3) or len(set(scale)) != 1:
        return
    count = "is one number" if len(scale) == 1 else f"is {len(scale)} equal numbers"
    size.element.set("scale", " ".join(scale[:1] * 3))
    yield SCALE(
        link.subject,
        f"mesh scale `{' '.join(scale)}` on line {size.line} {count}: taken for all three axes",
        "urdfdom and MuJoCo refuse it: write three numbers",
        data={"line": size.line},
    )


def _zero_edges(size: Node) -> str:
    """`all`: it has no width; `one`: no thickness; "" for all else."""
    if size.tag == "box":
        edges = size.numbers("size", 3)
        zeros = edges.count(0.0) if min(edges) >= 0.0 else 0
        return "all" if zeros >= 2 else "one" if zeros else ""
    if size.tag == "sphere":
        return "all" if size.number("radius") == 0.0 else ""
    if size.tag in ("cylinder", "capsule"):
        radius, length = size.number("radius"), size.number("length")
        return "all" if radius == 0.0 else "one" if length == 0.0 else ""
    return ""


def _left_out(link: Node, shape: Node, what: str) -> Finding:
    """Take its size away: the shape keeps its place, so that its neighbours keep their names."""
    geometry = shape.only("geometry")
    for size in geometry.all("*") if geometry is not None else ():
        size.remove()
    rule = VISUAL_NOTHING if shape.tag == "visual" else COLLISION_NOTHING
    return rule(
        link.subject,
        f"a <{shape.tag}> on line {shape.line} {what}: it was left out",
        hint="remove it, or write its size",
        data={"line": shape.line},
    )


def _tidy_colour(color: Node) -> Iterator[Finding]:
    stated = color.get("rgba")
    words = (stated or "").split()
    if stated is not None and len(words) >= 3 and _all_numbers(color, len(words)):
        if len(words) == 4:
            return
        color.element.set("rgba", " ".join([*words, "1"][:4]))
        message = f"rgba `{stated}` on line {color.line} has {len(words)} numbers: read as "
        message += f"`{color.get('rgba')}`"
    else:
        color.remove()
        message = f"<color> on line {color.line} states no rgba of four numbers: no colour is read"
    hint = "write red, green, blue and opacity, each from 0 to 1"
    yield COLOUR(color.subject, message, hint, data={"line": color.line, "rgba": stated})


def _all_numbers(color: Node, count: int) -> bool:
    try:
        color.numbers("rgba", count)
    except SourceError:
        return False
    return True
