"""Write a clean URDF: the source's own links and joints, our shapes, relative mesh paths."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Target
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import (
    Actuator,
    Body,
    Box,
    Capsule,
    Cylinder,
    Geometry,
    Inertial,
    Joint,
    Material,
    Mesh,
    Shape,
    Shapes,
    Sphere,
    Tree,
)
from assetbuild.robot.pose import Pose, rpy_of
from assetbuild.robot.tree import held_by_world

FIXED_AWAY = Rule(
    "urdf.world",
    "info",
    "a fixed root is away from the origin: in the written URDF a fixed joint attaches it to a "
    "link `world`",
    "nothing; move the origin of that joint to place the robot",
)
LIMIT_UNSTATED = Rule(
    "urdf.limit.unstated",
    "warning",
    "neither the source nor the recipe states effort or velocity, so the written URDF has none",
    "give them in the actuator table",
)


class Urdf(Target):
    """`urdf/<robot>.urdf` and `urdf/meshes/`.

    The tree is the source's, unmerged: every link, fixed joint and frame is there. Effort,
    velocity, damping and friction are those of the joint's actuator where it has one, so that all
    targets move alike; position limits, axes and masses are the source's. Mass properties are
    written in link axes. A capsule, which URDF lacks, becomes its exact union: a cylinder and two
    spheres in the same link. Whether the base is fixed cannot be said in URDF; a root that is held
    away from the origin hangs on a link `world`, by a fixed joint.
    """

    version = "3"
    outputs = ("urdf/",)
    reads = ("links.json", "shapes.json", "ratings.json", "meshes/")

    def run(self, files: Files) -> Iterator[Finding]:
        """Numbers by `repr`, UTF-8, two spaces; same robot, same bytes."""
        robot = RobotFiles(files.inputs)
        tree = held_by_world(robot.links)
        yield from _held(robot.links, tree)
        root = ET.Element("robot", name=tree.name)
        for material in robot.shapes.materials:
            _add_material(root, material)
        meshes = _Meshes(robot.shapes)
        for body in tree.bodies:
            _add_link(root, body, [s for s in robot.shapes.shapes if s.link == body.name], meshes)
        for joint in tree.joints:
            actuator = robot.ratings.by_joint.get(joint.name)
            _add_joint(root, joint, actuator)
            yield from _unstated(joint, actuator)
        ET.indent(root, "  ")
        folder = files.outputs / "urdf"
        folder.mkdir()
        text: str = ET.tostring(root, encoding="unicode")
        text = f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'
        (folder / f"{self.robot}.urdf").write_text(text, encoding="utf-8")
        meshes.write(robot.mesh_dir, folder / "meshes")


def _held(said: Tree, written: Tree) -> Iterator[Finding]:
    if written is not said:
        where = ", ".join(f"{value:.6g}" for value in said.X_world_root.xyz)
        turn = ", ".join(f"{value:.6g}" for value in said.X_world_root.quat)
        yield FIXED_AWAY(
            f"link {said.root}",
            f"stands at ({where}) m in the world, turned by ({turn}) wxyz: a fixed joint "
            f"`{written.joints[0].name}` holds it to a link `{written.root}`",
            hint="place the robot by that joint's <origin>, or by your world's",
        )


class _Meshes:
    """The mesh files of the URDF: an OBJ for each asset, and one with an MTL for each texture.

    A URDF viewer takes a texture from the mesh file, so an asset that is seen with two textures
    becomes two files. Collision takes any of them: its readers know no materials.
    """

    def __init__(self, shapes: Shapes) -> None:
        self._assets = {asset.name: asset for asset in shapes.meshes}
        self._textured = {m.name: m for m in shapes.materials if m.texture}
        self._looks: dict[str, list[Material | None]] = {name: [] for name in self._assets}
        for shape in shapes.of("visual"):
            if isinstance(shape.geometry, Mesh):
                looks = self._looks[shape.geometry.mesh]
                if self._look(shape) not in looks:
                    looks.append(self._look(shape))

    def _look(self, shape: Shape) -> Material | None:
        return self._textured.get(shape.material or "")

    def path(self, shape: Shape, mesh: Mesh) -> str:
        """The mesh file of a shape, from the URDF."""
        looks = self._looks[mesh.mesh]
        number = looks.index(self._look(shape)) if shape.role == "visual" else 0
        return f"meshes/{self._stem(mesh.mesh, number)}.obj"

    def _stem(self, asset: str, number: int) -> str:
        stem = self._assets[asset].file.removesuffix(".obj")
        return f"{stem}_{number + 1}" if number else stem

    def write(self, source: Path, dest: Path) -> None:
        """All files, and the pictures beside them."""
        if self._assets or self._textured:
            dest.mkdir()
        for name, asset in self._assets.items():
            for number, look in enumerate(self._looks[name] or [None]):
                target = dest / f"{self._stem(name, number)}.obj"
                if look is None:
                    shutil.copyfile(source / asset.file, target)
                    continue
                data = (source / asset.file).read_bytes()
                head = f"mtllib {target.stem}.mtl\nusemtl textured\n".encode()
                target.write_bytes(head + data)
                target.with_suffix(".mtl").write_text(_mtl(look), encoding="utf-8")
        for picture in sorted({str(material.texture) for material in self._textured.values()}):
            shutil.copyfile(source / picture, dest / picture)


def _mtl(material: Material) -> str:
    r, g, b, a = map(repr, material.rgba)
    return f"newmtl textured\nKd {r} {g} {b}\nd {a}\nmap_Kd {material.texture}\n"


def _add_material(robot: ET.Element, material: Material) -> None:
    element = ET.SubElement(robot, "material", name=material.name)
    ET.SubElement(element, "color", rgba=_words(material.rgba))
    if material.texture:
        ET.SubElement(element, "texture", filename=f"meshes/{material.texture}")


def _add_link(robot: ET.Element, body: Body, shapes: list[Shape], meshes: _Meshes) -> None:
    link = ET.SubElement(robot, "link", name=body.name)
    if body.inertial is not None:
        _add_inertial(link, body.inertial)
    for shape in shapes:
        for name, pose, geometry in _pieces(shape):
            element = ET.SubElement(link, shape.role, name=name)
            _add_origin(element, pose)
            file = meshes.path(shape, geometry) if isinstance(geometry, Mesh) else ""
            _add_geometry(ET.SubElement(element, "geometry"), geometry, file)
            if shape.material is not None:
                ET.SubElement(element, "material", name=shape.material)


def _add_inertial(link: ET.Element, inertial: Inertial) -> None:
    element = ET.SubElement(link, "inertial")
    _add_origin(element, Pose(inertial.com_m))
    ET.SubElement(element, "mass", value=repr(inertial.mass_kg))
    xx, yy, zz, xy, xz, yz = map(repr, inertial.inertia_com_kg_m2)
    ET.SubElement(element, "inertia", ixx=xx, ixy=xy, ixz=xz, iyy=yy, iyz=yz, izz=zz)


def _add_origin(element: ET.Element, pose: Pose) -> None:
    """Nothing for the identity, which is what an omitted <origin> means."""
    rpy = rpy_of(pose.quat)
    if any(pose.xyz) or any(rpy):
        ET.SubElement(element, "origin", xyz=_words(pose.xyz), rpy=_words(rpy))


def _pieces(shape: Shape) -> Iterator[tuple[str, Pose, Geometry]]:
    """(name, X_link_piece, geometry); a capsule gives three, all else one."""
    geometry = shape.geometry
    if not isinstance(geometry, Capsule):
        yield shape.name, shape.X_link_shape, geometry
        return
    half = geometry.length / 2
    if half == 0.0:
        yield shape.name, shape.X_link_shape, Sphere(geometry.radius)
        return
    yield shape.name, shape.X_link_shape, Cylinder(geometry.radius, geometry.length)
    for end, z in (("top", half), ("bottom", -half)):
        pose = shape.X_link_shape @ Pose((0.0, 0.0, z))
        yield f"{shape.name}_{end}", pose, Sphere(geometry.radius)


def _add_geometry(parent: ET.Element, geometry: Geometry, file: str) -> None:
    match geometry:
        case Box(size):
            ET.SubElement(parent, "box", size=_words(size))
        case Sphere(radius):
            ET.SubElement(parent, "sphere", radius=repr(radius))
        case Cylinder(radius, length):
            ET.SubElement(parent, "cylinder", radius=repr(radius), length=repr(length))
        case Mesh(scale=scale):
            element = ET.SubElement(parent, "mesh", filename=file)
            if scale != (1.0, 1.0, 1.0):
                element.set("scale", _words(scale))
        case Capsule():
            raise TypeError("a capsule is written as its pieces")


def _add_joint(robot: ET.Element, joint: Joint, actuator: Actuator | None) -> None:
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    _add_origin(element, joint.X_parent_joint)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    if joint.kind in ("revolute", "continuous", "prismatic", "planar"):
        ET.SubElement(element, "axis", xyz=_words(joint.axis))
    limits = _limits(joint, actuator)
    if limits:
        ET.SubElement(element, "limit", {key: repr(limits[key]) for key in limits})
    dynamics = _dynamics(joint, actuator)
    if dynamics:
        ET.SubElement(element, "dynamics", {key: repr(dynamics[key]) for key in dynamics})
    if joint.mimic is not None:
        ET.SubElement(
            element,
            "mimic",
            joint=joint.mimic.joint,
            multiplier=repr(joint.mimic.multiplier),
            offset=repr(joint.mimic.offset),
        )


def _limits(joint: Joint, actuator: Actuator | None) -> dict[str, float]:
    """The attributes of <limit> that somebody stated.

    Where the source says 0 and the actuator takes it as unlimited, the 0 stays: URDF has no other
    word for it, and parsers refuse a <limit> without the attribute.
    """
    stated = {"lower": joint.limits.lower, "upper": joint.limits.upper}
    for name in ("effort", "velocity"):
        driven: float | None = getattr(actuator, name) if actuator else None
        stated[name] = getattr(joint.limits, name) if driven is None else driven
    return {name: value for name, value in stated.items() if value is not None}


def _dynamics(joint: Joint, actuator: Actuator | None) -> dict[str, float]:
    if actuator is not None:
        return {"damping": actuator.damping, "friction": actuator.friction}
    stated = {"damping": joint.damping, "friction": joint.friction}
    return {name: value for name, value in stated.items() if value is not None}


def _unstated(joint: Joint, actuator: Actuator | None) -> Iterator[Finding]:
    """URDF asks for effort and velocity; a number nobody stated is not invented."""
    if joint.kind not in ("revolute", "prismatic"):
        return
    missing = [name for name in ("effort", "velocity") if name not in _limits(joint, actuator)]
    if missing:
        words = " and ".join(f"`{name}`" for name in missing)
        yield LIMIT_UNSTATED(
            f"joint {joint.name}",
            f"neither source nor recipe states {words}; <limit> leaves it out",
            hint="some URDF parsers refuse that: the actuator table or `edits: set_limits` give it",
            data={"missing": tuple(missing)},
        )


def _words(values: tuple[float, ...]) -> str:
    return " ".join(map(repr, values))
