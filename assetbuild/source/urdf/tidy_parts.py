"""What single parts of a URDF state too little or too much: masses, limits, shapes, rotations."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from assetbuild.errors import SourceError
from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import URDF_UNLIMITED
from assetbuild.robot.pose import quat_of_rpy
from assetbuild.source.urdf.xml import Node, Problems

INCOMPLETE = Rule(
    "urdf.inertial.incomplete",
    "warning",
    "`<inertial>` lacks a mass or a part of its tensor; without a mass it counts as absent, "
    "without a moment the tensor counts as 0, a missing product counts as 0",
    "state the mass and all six numbers",
)
NO_LIMIT = Rule(
    "urdf.limit.none",
    "warning",
    "an effort or velocity limit is negative or infinite, or a revolute joint's range is infinite: "
    "it counts as not stated",
    "state the limit, or give effort and velocity in the recipe's actuator table",
)
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
VERSION = Rule(
    "urdf.version",
    "warning",
    "the stated version of URDF does not exist (1.0, 1.1 and 1.2 do), or an element needs a later "
    "one than is stated",
    "state the version that the file follows",
)
QUATERNION = Rule(
    "urdf.quaternion",
    "info",
    "rotations are stated as `quat_xyzw` (URDF 1.1), which urdfdom reads since version 5 and "
    "MuJoCo, PyBullet and yourdfpy do not",
    "nothing; every target states them in its own form",
)
QUATERNION_NORM = Rule(
    "urdf.quaternion.normalised", "info", "a quaternion did not have length 1", "write a unit one"
)
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
SAME = 1e-6
"""rad: rotations this close are one."""
NORM = 1e-6
"""A quaternion whose length is off by more is reported."""

Version = tuple[int, int]


def tidy_inertial(link: Node) -> Iterator[Finding]:
    """Without a mass there is no <inertial>; without a moment the tensor is 0."""
    inertial = link.only("inertial")
    if inertial is None:
        return
    mass, tensor = inertial.only("mass"), inertial.only("inertia")
    if mass is None or mass.get("value") is None:
        inertial.remove()
        yield _incomplete(inertial, "it states no mass and counts as absent", "mass", "inertia")
        return
    if tensor is None:
        tensor = inertial.added("inertia")
    missing = [name for name in MOMENTS if tensor.get(name) is None]
    if not missing:
        return
    if any(name in missing for name in ("ixx", "iyy", "izz")):
        for name in MOMENTS:
            tensor.element.set(name, "0")
        what = "it states no tensor (`ixx`, `iyy`, `izz`), which counts as 0"
        yield _incomplete(inertial, what, "inertia")
    else:
        for name in missing:
            tensor.element.set(name, "0")
        words = ", ".join(f"`{name}`" for name in missing)
        yield _incomplete(inertial, f"<inertia> lacks {words}: taken as 0", "inertia")


def _incomplete(inertial: Node, what: str, *missing: str) -> Finding:
    return INCOMPLETE(
        inertial.subject,
        f"<inertial> on line {inertial.line}: {what}",
        hint="state the mass and all six numbers, or use the edit `inertia_from_geometry`",
        data={"line": inertial.line, "missing": missing},
    )


def tidy_limit(joint: Node) -> Iterator[Finding]:
    """A limit below zero or without end is none."""
    limit = joint.only("limit")
    if limit is None or joint.get("type") not in ("revolute", "continuous", "prismatic"):
        return
    for name in ("effort", "velocity"):
        value = _float(limit.get(name))
        if value < 0.0 or value == math.inf:
            yield _not_stated(limit, name, "counts as not stated")
            del limit.element.attrib[name]
    ends = [_float(limit.get(name)) for name in ("lower", "upper")]
    endless = ends[0] <= -URDF_UNLIMITED and ends[1] >= URDF_UNLIMITED
    if endless and joint.get("type") == "revolute":
        yield _not_stated(limit, "lower", "has no end: the joint counts as continuous")
        joint.element.set("type", "continuous")
        for name in ("lower", "upper"):
            del limit.element.attrib[name]


def _not_stated(limit: Node, name: str, what: str) -> Finding:
    return NO_LIMIT(
        limit.subject,
        f"limit {name} `{limit.get(name)}` on line {limit.line} {what}",
        hint="readers take it differently: state it in the URDF, or in the recipe's actuator table",
        data={
            "limit": name,
            "stated": limit.get(name),
            "line": limit.line,
            "missing": (name,),
        },
    )


def _float(text: str | None) -> float:
    """The number, infinite ones included; not a number where there is none."""
    try:
        return math.nan if text is None or "_" in text else float(text)
    except ValueError:
        return math.nan


# --- shapes and looks -----------------------------------------------------------------------


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


# --- rotations ------------------------------------------------------------------------------


def tidy_orientation(root: Node, problems: Problems) -> list[Finding]:
    """Leave `quat_xyzw` where it is the rotation, and nowhere else."""
    version, findings = _version(root)
    findings += _needs_later(root, version)
    used: list[Node] = []
    for joint_or_link in (*root.all("joint"), *root.all("link")):
        subject = f"{joint_or_link.tag} {joint_or_link.get('name')}"
        for element in joint_or_link.element.iter("origin"):
            origin = Node(element, root.file, subject)
            if origin.get("quat_xyzw") is None:
                continue
            counts = False
            with problems.kept():
                counts = _is_rotation(origin, version)
            if counts:
                used.append(origin)
                findings += _of_other_length(origin)
            else:
                del element.attrib["quat_xyzw"]
    if used:
        times = f"{len(used)} origins are" if len(used) > 1 else "one origin is"
        message = f"{times} turned by `quat_xyzw` (first on line {used[0].line})"
        hint = "MuJoCo, PyBullet and yourdfpy do not read it: use the built URDF there"
        data = {"count": len(used), "line": used[0].line}
        findings.append(QUATERNION("robot", message, hint, data=data))
    return findings


def _version(root: Node) -> tuple[Version, list[Finding]]:
    stated = root.get("version")
    if stated is None:
        return (1, 0), []
    found = re.fullmatch(r"\s*(\d{1,4})\.(\d{1,4})\s*", stated, re.ASCII)
    version = (int(found[1]), int(found[2])) if found else (1, 0)
    if found and (1, 0) <= version <= (1, 2):
        return version, []
    version = min(max(version, (1, 0)), (1, 2))
    taken = f"{version[0]}.{version[1]}"
    message = f"version `{stated}` of URDF does not exist: read as {taken}"
    root.element.set("version", taken)
    hint = f'urdfdom refuses it: write `version="{taken}"`'
    return version, [VERSION("robot", message, hint, data={"version": stated, "line": root.line})]


def _needs_later(root: Node, version: Version) -> Iterator[Finding]:
    """A capsule is a capsule to all readers but urdfdom, which asks for the version."""
    capsule = next(root.element.iter("capsule"), None)
    if capsule is None or version >= (1, 1):
        return
    line = Node(capsule, root.file).line
    message = f"<capsule> on line {line} needs version 1.1, the file says {version[0]}.{version[1]}"
    hint = 'it is read; urdfdom leaves it out: write `version="1.1"` at <robot>'
    yield VERSION("robot", message, hint, data={"line": line})


def _is_rotation(origin: Node, version: Version) -> bool:
    """Whether the quaternion counts; False where it says the same as `rpy`."""
    x, y, z, w = origin.numbers("quat_xyzw", 4)
    norm = math.hypot(x, y, z, w)
    if norm < 1e-9:
        raise origin.error(
            f"quat_xyzw is `{origin.get('quat_xyzw')}`: it is no rotation",
            "write `0 0 0 1` for none, or the quaternion that is meant",
        )
    roll, pitch, yaw = origin.numbers("rpy", 3, (0.0, 0.0, 0.0))
    other = quat_of_rpy(roll, pitch, yaw)
    cosine = abs(math.fsum(p * q / norm for p, q in zip((w, x, y, z), other, strict=True)))
    if 2.0 * math.acos(min(1.0, cosine)) <= SAME and origin.get("rpy") is not None:
        return False
    if version >= (1, 1):
        if origin.get("rpy") is not None:
            raise origin.error(
                "both `rpy` and `quat_xyzw` are given, and they differ",
                "remove one of the two: urdfdom refuses the file, MuJoCo, PyBullet and yourdfpy "
                "read `rpy`",
            )
        return True
    if 2.0 * math.acos(min(1.0, cosine)) <= SAME:
        return False
    raise origin.error(
        "`quat_xyzw` needs URDF 1.1, and the file states no such version",
        'write `version="1.1"` at <robot> to turn it by the quaternion, or remove `quat_xyzw`: '
        "urdfdom, MuJoCo, PyBullet and yourdfpy ignore it as it stands",
    )


def _of_other_length(origin: Node) -> Iterator[Finding]:
    norm = math.hypot(*origin.numbers("quat_xyzw", 4))
    if abs(norm - 1.0) > NORM:
        message = f"quat_xyzw `{origin.get('quat_xyzw')}` has length {norm:.6g} and was normalised"
        data = {"norm": norm, "line": origin.line}
        yield QUATERNION_NORM(origin.subject, message, "write a unit quaternion", data=data)
