"""Write a clean URDF: the source's own links and joints, our shapes, relative mesh paths."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from assetbuild.engine.step import Files
from assetbuild.errors import StepError, quoted
from assetbuild.findings import Finding, Rule
from assetbuild.grouping import grouped
from assetbuild.plugin_types import Target
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.loops import by_constraint
from assetbuild.robot.model import (
    MOVING,
    URDF_UNLIMITED,
    Actuator,
    Body,
    Control,
    Inertial,
    Joint,
    Tree,
)
from assetbuild.robot.pose import Pose, rpy_of
from assetbuild.robot.shapes import (
    Box,
    Capsule,
    Cylinder,
    Geometry,
    Material,
    Mesh,
    Shape,
    Shapes,
    Sphere,
)
from assetbuild.robot.tree import held_by_world

FIXED_AWAY = Rule(
    "urdf.world",
    "info",
    "a fixed root is away from the origin: in the written URDF a fixed joint attaches it to a "
    "link `world`",
    "nothing; move the origin of that joint to place the robot",
)
LOOP = Rule(
    "urdf.loop",
    "warning",
    "URDF has no closed loops: in the written one the tree is open, and what only a loop moves "
    "hangs free",
    "use the MJCF or the USD where the robot moves, or close the loops in the program that reads "
    "the URDF",
)
LOOP_MIMIC = Rule(
    "urdf.loop_mimic",
    "warning",
    "the written URDF approximates a closed loop by mimic joints, as its `urdf: mimic` asks: "
    "straight lines through the positions that the loop gives, with their largest error",
    "use the MJCF or the USD where the robot moves",
)
LIMIT_UNSTATED = Rule(
    "urdf.limit.unstated",
    "info",
    "neither the source nor the recipe states a limit that urdfdom wants in `<limit>`: the written "
    "URDF says 1e9, which means unlimited",
    "for planners give effort and velocity in the actuator table, a range by `edits: set_limits`",
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

    shares = True
    outputs = ("urdf/",)
    reads = ("links.json", "shapes.json", "ratings.json", "meshes/")

    def run(self, files: Files) -> Iterator[Finding]:
        """Numbers by `repr`, UTF-8, two spaces; same robot, same bytes."""
        robot = RobotFiles(files.inputs)
        tree = held_by_world(robot.links)
        yield from _held(robot.links, tree)
        yield from _open_loops(robot.ratings)
        mimics = {each.joint: each.mimic for each in robot.ratings.loop_mimics}
        root = ET.Element("robot", name=tree.name)
        for material in robot.shapes.materials:
            _add_material(root, material)
        meshes = _Meshes(robot.shapes)
        for body in tree.bodies:
            _add_link(root, body, [s for s in robot.shapes.shapes if s.link == body.name], meshes)
        limits: dict[str, Mapping[str, float | None]] = {}
        for joint in tree.joints:
            actuator = robot.ratings.by_joint.get(joint.name)
            followed = replace(joint, mimic=mimics.get(joint.name, joint.mimic))
            limits[joint.name] = _limits(joint, actuator)
            _add_joint(root, followed, limits[joint.name], actuator or joint)
        yield from _unstated(limits)
        ET.indent(root, "  ")
        folder = files.outputs / "urdf"
        folder.mkdir()
        text: str = ET.tostring(root, encoding="unicode")
        text = f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'
        (folder / f"{self.robot}.urdf").write_text(text, encoding="utf-8")
        meshes.write(robot.mesh_dir, folder / "meshes")


def _open_loops(ratings: Control) -> Iterator[Finding]:
    followed = grouped(ratings.loop_mimics, lambda mimic: mimic.loop)
    for name, mimics in followed.items():
        equations = ", ".join(
            f"`{m.joint}` = {m.mimic.offset:.4g} {m.mimic.multiplier:+.4g} x `{m.mimic.joint}`, "
            f"off by up to {m.off:.3g}"
            for m in mimics
        )
        (low, high), leader = mimics[0].range, mimics[0].mimic.joint
        yield LOOP_MIMIC(
            f"loop {name}",
            f"the URDF follows it by mimic joints: {equations} rad or m, where `{leader}` is "
            f"{low:.3g} to {high:.3g}",
            data={m.joint: m.off for m in mimics},
        )
    by_name = by_constraint(ratings.loops).items()
    loops = [loop for name, some in by_name for loop in some if name not in followed]
    if loops:
        ends = {loop.name: f"{loop.a.body} to {loop.b.body}" for loop in loops}
        listed = quoted(ends, 6, notes=ends)
        yield LOOP(
            "robot",
            f"the written URDF holds {len(loops)} loops open: {listed}",
            data={"loops": tuple(loop.name for loop in loops)},
        )


def _held(stated: Tree, written: Tree) -> Iterator[Finding]:
    if written is not stated:
        where = ", ".join(f"{value:.6g}" for value in stated.X_world_root.xyz)
        turn = ", ".join(f"{value:.6g}" for value in stated.X_world_root.quat)
        yield FIXED_AWAY(
            f"link {stated.root}",
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
        self._textured = {m.name: m for m in shapes.materials if m.texture}
        self._files = {asset.name: asset.file for asset in shapes.meshes}
        seen: dict[str, dict[Material | None, None]] = {name: {} for name in self._files}
        for shape in shapes.of("visual"):
            if isinstance(shape.geometry, Mesh):
                seen[shape.geometry.mesh][self._look(shape)] = None
        self._stems = {
            (name, look): self._files[name].removesuffix(".obj") + (f"_{n}" if n > 1 else "")
            for name, looks in seen.items()
            for n, look in enumerate(looks or [None], start=1)
        }

    def _look(self, shape: Shape) -> Material | None:
        return self._textured.get(shape.material or "")

    def path(self, shape: Shape, mesh: Mesh) -> str:
        """The mesh file of a shape, from the URDF."""
        if shape.role == "visual":
            return f"meshes/{self._stems[mesh.mesh, self._look(shape)]}.obj"
        return f"meshes/{self._files[mesh.mesh]}"

    def write(self, source: Path, dest: Path) -> None:
        """All files, and the pictures beside them."""
        if self._files or self._textured:
            dest.mkdir()
        for (name, look), stem in self._stems.items():
            data = (source / self._files[name]).read_bytes()
            if look is not None:
                data = f"mtllib {stem}.mtl\nusemtl textured\n".encode() + data
                (dest / f"{stem}.mtl").write_text(_mtl(look), encoding="utf-8")
            (dest / f"{stem}.obj").write_bytes(data)
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
        case Mesh():
            ET.SubElement(parent, "mesh", filename=file)


def _add_joint(
    robot: ET.Element,
    joint: Joint,
    limits: Mapping[str, float | None],
    dynamics: Actuator | Joint,
) -> None:
    if joint.kind == "ball":
        raise StepError(
            f"joint `{joint.name}` is a ball joint, which URDF does not have",
            hint="leave `urdf` out of `targets`, or make three hinges of it by `edits: "
            f"[split_joint: {{joint: {joint.name}}}]`",
        )
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    _add_origin(element, joint.X_parent_joint)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    if joint.kind in ("revolute", "continuous", "prismatic", "planar"):
        ET.SubElement(element, "axis", xyz=_words(joint.axis))
    unlimited = {name: -URDF_UNLIMITED if name == "lower" else URDF_UNLIMITED for name in limits}
    stated = {name: value for name, value in limits.items() if value is not None}
    _add_numbers(element, "limit", unlimited | stated)
    _add_numbers(element, "dynamics", {"damping": dynamics.damping, "friction": dynamics.friction})
    if joint.mimic is not None:
        element = ET.SubElement(element, "mimic", joint=joint.mimic.joint)
        element.set("multiplier", repr(joint.mimic.multiplier))
        element.set("offset", repr(joint.mimic.offset))


def _add_numbers(parent: ET.Element, tag: str, values: Mapping[str, float | None]) -> None:
    """A child with the numbers that somebody stated; none without any."""
    stated = {name: repr(value) for name, value in values.items() if value is not None}
    if stated:
        ET.SubElement(parent, tag, stated)


def _limits(joint: Joint, actuator: Actuator | None) -> dict[str, float | None]:
    """The attributes of <limit>; None = nobody stated it. Empty where a joint needs no <limit>.

    A limit of 0 in the source says nothing, as for the actuator: the joint could never move.
    """
    if joint.kind not in MOVING:
        return {}
    limits: dict[str, float | None] = {}
    if joint.kind != "continuous":
        limits = {"lower": joint.limits.lower, "upper": joint.limits.upper}
    for name in ("effort", "velocity"):
        driven: float | None = getattr(actuator, name) if actuator else None
        limits[name] = (getattr(joint.limits, name) or None) if driven is None else driven
    needed = joint.kind != "continuous" or any(value is not None for value in limits.values())
    return limits if needed else {}


def _unstated(by_joint: Mapping[str, Mapping[str, float | None]]) -> Iterator[Finding]:
    """What is written as unlimited: urdfdom refuses a <limit> without effort and velocity."""
    lacking: dict[str, list[str]] = {}
    for joint, limits in by_joint.items():
        missing = [name for name, value in limits.items() if value is None]
        if missing:
            lacking.setdefault(" and ".join(f"`{name}`" for name in missing), []).append(joint)
    if lacking:
        counted = [
            f"{words} of {len(names)} joints ({quoted(names, 6)})"
            for words, names in lacking.items()
        ]
        yield LIMIT_UNSTATED(
            "robot",
            f"neither source nor recipe states {'; '.join(counted)}: <limit> says "
            f"{URDF_UNLIMITED:g}, unlimited",
            hint="for planners the actuator table gives effort and velocity, `edits: set_limits` a "
            "range",
            data={words.replace("`", ""): tuple(names) for words, names in lacking.items()},
        )


def _words(values: tuple[float, ...]) -> str:
    return " ".join(map(repr, values))
