"""Links of a URDF: mass properties, shapes, materials."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, count
from typing import Literal, get_args

from assetbuild.errors import did_you_mean
from assetbuild.findings import Rule
from assetbuild.mesh.read import Format
from assetbuild.robot.inertia import rotate_tensor
from assetbuild.robot.model import Body, Inertial
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, normalised_quat, quat_of_rpy, vec3
from assetbuild.robot.shapes import (
    Box,
    Capsule,
    Cylinder,
    Material,
    MeshFile,
    SourceGeometry,
    SourceShape,
    Sphere,
)
from assetbuild.source.urdf.paths import Paths
from assetbuild.source.urdf.xml import SIZE, Node

FORMATS: tuple[str, ...] = get_args(Format)

ROLES: tuple[Literal["visual", "collision"], ...] = ("visual", "collision")

Rgba = tuple[float, float, float, float]

UNDEFINED_MATERIAL = Rule(
    "urdf.material.undefined",
    "warning",
    "a material is referred to but defined nowhere",
    "define it",
)
MATERIAL_CONFLICT = Rule(
    "urdf.material.conflict",
    "info",
    "one name stands for two materials; one was renamed",
    "give each look its own name",
)
COLOUR_RANGE = Rule(
    "urdf.material.range",
    "warning",
    "a colour was clipped to 0..1",
    "write colours as fractions of 1, not of 255",
)
TRANSPARENT = Rule(
    "urdf.material.transparent",
    "warning",
    "a colour has an alpha of 0: nothing is seen of the shapes that wear it",
    "the fourth number of `rgba` is 1 for what is solid",
)


MeshUse = dict[str, str | int]
"""Row of `meshes.json`, the first use of a file: path below the source root, uri, subject, line."""


def named(nodes: list[Node]) -> Iterator[tuple[str, Node]]:
    """(name, node about it) of links, joints or materials; a name used twice is an error."""
    first: dict[str, int] = {}
    for node in nodes:
        name = node.text("name")
        if name in first:
            where = f"first on line {first[name]}"
            raise node.error(f"{node.tag} `{name}` is defined twice, {where}", "rename one")
        first[name] = node.line
        yield name, node.about(f"{node.tag} {name}")


def read_origin(node: Node) -> Pose:
    """The pose of <origin>: xyz in m, rpy in rad, zeros where omitted (so says the format).

    A `quat_xyzw` that `tidy` has left is the rotation: the file says URDF 1.1 or later.
    """
    origin = node.only("origin")
    if origin is None:
        return IDENTITY
    xyz = vec3(origin.numbers("xyz", 3, (0.0, 0.0, 0.0)))
    if origin.get("quat_xyzw") is not None:
        x, y, z, w = origin.numbers("quat_xyzw", 4)
        return Pose(xyz, normalised_quat((w, x, y, z)))
    roll, pitch, yaw = origin.numbers("rpy", 3, (0.0, 0.0, 0.0))
    return Pose(xyz, quat_of_rpy(roll, pitch, yaw))


def read_body(name: str, link: Node) -> Body:
    """The link's mass properties in its own frame and axes."""
    inertial = link.only("inertial")
    if inertial is None:
        return Body(name)
    mass = inertial.need("mass").number("value")
    if mass < 0.0:
        raise inertial.need("mass").error(f"mass is {mass!r} kg", "a mass cannot be negative")
    tensor = inertial.need("inertia")
    xx, yy, zz, xy, xz, yz = (
        tensor.number(f"i{axes}") + 0.0 for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    X_link_com = read_origin(inertial)
    turned = rotate_tensor((xx, yy, zz, xy, xz, yz), X_link_com.quat)
    return Body(name, Inertial(mass + 0.0, X_link_com.xyz, turned))


def read_shapes(root: Node, links: list[tuple[str, Node]], paths: Paths) -> Geometries:
    """All shapes in file order, the visuals of a link before its collisions."""
    made = Geometries(paths)
    for name, node in named([n.about("robot") for n in root.all("material")]):
        made.see(node, name)
    drafts: list[tuple[SourceShape, str, Node]] = []
    stated = [(link, role, pair) for link, node in links for role in ROLES
              for pair in enumerate(node.all(role))]  # fmt: skip
    for link, role, (index, element) in stated:
        material = element.only("material") if role == "visual" else None
        worn = made.see(material, f"{link}_material") if material is not None else ""
        geometry = element.only("geometry")
        size = geometry.only("*") if geometry is not None else None
        if geometry is None or size is None:
            continue  # `tidy` has reported it
        if paths.left_out(geometry, role):
            continue
        name = f"{link}_{role}" + (f"_{index}" if index else "")
        kind, X = _read_geometry(size, paths, made.uses), read_origin(element)
        drafts.append((SourceShape(name, link, role, kind, X), worn, element))
        made.lines[f"shape {name}"] = element.line
    made.shapes = [made.paint(*draft) for draft in drafts]
    return made


def _read_geometry(shape: Node, paths: Paths, uses: dict[str, MeshUse]) -> SourceGeometry:
    if shape.tag == "mesh":
        path = paths.resolve(shape)
        uri = shape.text("filename").strip()
        if posixpath.splitext(path)[1].lower().lstrip(".") not in FORMATS:
            endings = ", ".join(f"`.{name}`" for name in FORMATS)
            raise shape.error(f"mesh filename `{uri}` is of no known format", f"known: {endings}")
        use: MeshUse = {"path": path, "uri": uri, "subject": shape.subject, "line": shape.line}
        uses.setdefault(path, use)
        return MeshFile(path, _scale(shape))
    if shape.tag == "box":
        size = vec3(shape.numbers("size", 3))
        if min(size) <= 0.0:
            stated = f"box size is `{shape.get('size')}`"
            raise shape.error(f"{stated}, every edge must be positive", SIZE)
        return Box(size)
    if shape.tag == "sphere":
        return Sphere(shape.positive("radius"))
    if shape.tag in ("cylinder", "capsule"):
        kind = Cylinder if shape.tag == "cylinder" else Capsule
        return kind(shape.positive("radius"), shape.positive("length"))
    tags = ("box", "sphere", "cylinder", "capsule", "mesh")
    raise shape.error(f"unknown geometry <{shape.tag}>", did_you_mean(shape.tag, tags))


def _scale(node: Node) -> Vec3:
    scale = vec3(node.numbers("scale", 3, (1.0, 1.0, 1.0)))
    if 0.0 in scale:
        raise node.error(f"mesh scale is `{node.get('scale')}`", "a scale of 0 leaves no mesh")
    return scale


class Geometries:
    """What the shapes of all links amount to.

    materials: those of the robot first, then those defined inside visuals. uses: of meshes, by
    path. lines: of `shape ...`, `material ...`.
    """

    def __init__(self, paths: Paths) -> None:
        self.paths = paths
        self.shapes: list[SourceShape] = []
        self.materials: dict[str, Material] = {}
        self.uses: dict[str, MeshUse] = {}
        self.lines: dict[str, int] = {}
        self._undefined: set[str] = set()

    def see(self, node: Node, otherwise: str) -> str:
        """Return the name that a material goes by; it may define a look.

        A second look of one name gets the next free name. otherwise: the name of a nameless one.
        """
        name = node.get("name") or ""
        look = self._look(name or otherwise, node)
        if look is None:
            return name
        others = (replace(look, name=f"{look.name}_{n}") for n in count(1))
        worn = next(o for o in chain((look,), others) if self.materials.get(o.name) in (None, o))
        if worn.name not in self.materials:
            self.materials[worn.name] = worn
            self.lines[f"material {worn.name}"] = node.line
            if name and worn is not look:
                message = f"defined with two looks; the second is called `{worn.name}`"
                data = {"renamed": worn.name}
                node.about(f"material {name}").report(MATERIAL_CONFLICT, message, data=data)
        return worn.name

    def paint(self, shape: SourceShape, name: str, node: Node) -> SourceShape:
        """Return the shape with its material; call when every visual has been seen."""
        if name in self.materials:
            return replace(shape, material=name)
        if name and name not in self._undefined:
            self._undefined.add(name)
            message = f"material `{name}` is defined nowhere; its shapes get the default look"
            near = did_you_mean(name, self.materials)
            node.report(UNDEFINED_MATERIAL, message, near, data={"material": name})
        return shape

    def _look(self, name: str, node: Node) -> Material | None:
        color, texture = node.only("color"), node.only("texture")
        if texture is not None and not (texture.get("filename") or "").strip():
            texture = None  # `<texture filename=""/>`, which exporters write, says nothing
        if color is None and texture is None:
            return None
        rgba: Rgba = (1.0, 1.0, 1.0, 1.0)  # a texture alone is shown as it is
        if color is not None:
            rgba = _rgba(name, color)
        return Material(name, rgba, self.paths.resolve(texture) if texture is not None else None)


def _rgba(name: str, color: Node) -> Rgba:
    stated = color.numbers("rgba", 4)
    r, g, b, a = (min(1.0, max(0.0, value)) + 0.0 for value in stated)
    if stated != (r, g, b, a):
        message = f"rgba `{color.get('rgba')}` was cut to 0..1"
        color.about(f"material {name}").report(COLOUR_RANGE, message, data={"rgba": stated})
    if a == 0.0:
        message = f"rgba `{color.get('rgba')}`: nothing is seen of its shapes"
        color.about(f"material {name}").report(TRANSPARENT, message, data={"rgba": stated})
    return (r, g, b, a)
