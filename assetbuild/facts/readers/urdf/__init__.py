"""The reader of facts of a URDF: of the one in a bundle, and of any other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from assetbuild.errors import UsageError, Where
from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.losses import Lost
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers.urdf.assets import Assets, looks_of, pixels_of
from assetbuild.facts.readers.urdf.joints import read_joints
from assetbuild.facts.readers.urdf.links import Links
from assetbuild.facts.reference import Reference, geometry_facts, mimic_facts, robot_table
from assetbuild.facts.sketch import SKETCH
from assetbuild.facts.table import Key, Table, Value, Writer
from assetbuild.facts.xml import Walk
from assetbuild.robot.model import MOVING, Control, Joint
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Capsule, Cylinder, Mesh, Shape, Sphere
from assetbuild.robot.tree import held_by_world

_CONTACT = Lost("URDF has no contact parameters")
_DRIVE = Lost("URDF has no drives: a joint has limits, damping and friction alone")
_SPRING = "URDF has no springs; the finding `mjcf.spring` says so"
LACKS: Mapping[str, str] = {
    "robot base": "URDF does not say whether the root is free",
    "robot base pose": "a fixed joint to a link `world` holds a root away from the origin",
    "robot articulation root": "the root is the link without a joint above it",
    "robot self-collision": _CONTACT,
    "robot up axis": "z, always",
    "robot metres per unit": "1, always",
    "robot kilograms per unit": "1, always",
    "frame": "a merged link is a link of its own, as in the source",
    "joint anchor": "the child's frame is the joint's: the axis runs through its origin",
    "joint armature": _DRIVE,
    "joint stiffness": _SPRING,
    "joint spring reference": _SPRING,
    **{
        f"joint {name}": _DRIVE
        for name in (
            "model", "kp", "kd", "gear", "stall", "command range", "drive parameters",
            "drive name", "delay", "start", "drive target",
        )
    },
    **{
        f"shape {name}": _CONTACT
        for name in (
            "friction", "condim", "priority", "solref", "solimp", "margin", "gap", "mask",
            "partners", "collides", "restitution",
        )
    },
    "loop": "URDF has trees alone; the finding `urdf.loop` says so",
    "pair": Lost("URDF has no list of pairs; SRDF has"),
    "sensor": Lost("URDF has no sensors"),
    "camera": Lost("URDF has no cameras"),
    "keyframe": Lost("URDF has no poses of the whole robot; SRDF has"),
    "simulation": Lost("URDF describes a robot, not a simulation"),
    "floor": "URDF describes a robot, not a scene",
    "robot start pose": "URDF has no initial pose",
    "robot soft limits": "URDF has hard limits alone",
}  # fmt: skip


class UrdfFacts(Reader):
    """`urdf/<robot>.urdf` with its meshes and pictures says what the robot is.

    Its bodies are the source's links, before fixed joints are merged.
    """

    needs: ClassVar = ("urdf",)
    reads: ClassVar = ("links.json", "tree.json", "shapes.json", "ratings.json", "assets.json")
    form: ClassVar[str] = "urdf"
    called: ClassVar[str] = "the URDF"
    folder: ClassVar[str] = "urdf"
    behind: ClassVar[tuple[str, ...]] = ("urdf/*",)
    suffixes: ClassVar[tuple[str, ...]] = (".urdf",)
    lacks: ClassVar[Mapping[str, str]] = LACKS
    simulated: ClassVar[bool] = False

    def file(self, root: Path, robot: str) -> Path | None:
        """`<robot>.urdf`."""
        return root / f"{robot}.urdf"

    def read(self, path: Path) -> Table:
        """Every element and attribute; UsageError where it is no URDF."""
        return self._read(path, KnownFiles())

    def found(self, path: Path, reference: Reference) -> Table:
        """A copy of one of the robot's own meshes and pictures is not read again."""
        return self._read(path, reference.assets.known).only(self.holds)

    def _read(self, path: Path, known: KnownFiles) -> Table:
        walk, book = Walk(path), Writer()
        if walk.root.tag != "robot":
            message = f"the root element is <{walk.root.tag}>, not <robot>"
            raise UsageError(message, where=Where(path.name, walk.line(walk.root)))
        words = {f"urdf:{name}": walk.text(walk.root, name) for name in ("name", "version")}
        book.put("robot", "", {key: value for key, value in words.items() if value is not None})
        links = Links(walk, book, Assets(path.parent, book, known))
        links.read()
        read_joints(walk, book, links.unique)
        found = book.table()
        return replace(found, unread=(*walk.unread(), *found.unread))

    def expected(self, reference: Reference) -> Table:
        """The links with their ratings; a capsule, which URDF lacks, in three pieces."""
        links = held_by_world(reference.links)
        reference = replace(reference, links=links)
        stated = robot_table(reference, merged=False).only(self.holds)
        book = Writer()
        book.put("robot", "", {"urdf:name": links.name})
        for body in links.bodies:
            book.put("body", body.name, {"urdf:link": True})
        follows = {each.joint: each.mimic for each in reference.control.loop_mimics}
        for joint in links.joints:
            facts = dict(_ratings(joint, reference.control))
            if joint.name in follows:
                facts |= mimic_facts(follows[joint.name])
            book.put("joint", joint.name, facts)
        capsules = set()
        for shape in reference.shapes.shapes:
            if isinstance(shape.geometry, Capsule):
                capsules.add(shape.name)
                common = stated.of("shape", shape.name)
                for name, facts in _pieces(shape, shape.geometry):
                    book.put("shape", name, common | facts)
        _normals(reference, book)
        _materials(reference, book)
        whole = stated.only(lambda key: key.kind != "shape" or key.name not in capsules)
        table = whole | book.table()
        named: dict[Key, Value] = {
            Key("shape", name, "urdf:name"): name for name in table.names("shape")
        }
        return table | Table(named)


def _ratings(joint: Joint, control: Control) -> Iterator[tuple[str, Value]]:
    """Effort and velocity are the drive's where it limits them, else the source's, where not 0.

    What the source says of losses of a joint that does not move by one coordinate is a word.
    """
    yield "urdf:type", joint.kind
    if joint.kind not in MOVING:
        own = {"damping": joint.damping, "friction": joint.friction}
        yield from ((f"urdf:{name}", value) for name, value in own.items() if value is not None)
        return
    row, limits = control.by_joint.get(joint.name), joint.limits
    for name in ("effort", "velocity"):
        driven = getattr(row, name) if row else None
        yield name, (getattr(limits, name) or None) if driven is None else driven


def _pieces(shape: Shape, capsule: Capsule) -> Iterator[tuple[str, dict[str, Value]]]:
    """A cylinder and the two balls at its ends; one ball where it has no length."""
    radius, half = capsule.radius, capsule.length / 2
    pose = shape.X_link_shape
    if half == 0.0:
        yield shape.name, geometry_facts(replace(shape, geometry=Sphere(radius)), pose, {})
        return
    middle = replace(shape, geometry=Cylinder(radius, capsule.length))
    yield shape.name, geometry_facts(middle, pose, {})
    for end, z in (("top", half), ("bottom", -half)):
        ball = replace(shape, geometry=Sphere(radius))
        yield f"{shape.name}_{end}", geometry_facts(ball, pose @ Pose((0.0, 0.0, z)), {})


def _normals(reference: Reference, book: Writer) -> None:
    """A mesh file states how light falls on its corners."""
    surfaces = dict(reference.assets.surfaces)
    for shape in reference.shapes.shapes:
        if isinstance(shape.geometry, Mesh):
            surface = surfaces[shape.geometry.mesh].moved(shape.X_link_shape)
            book.put("shape", shape.name, {f"urdf:{SKETCH}": surface.sketch or None})
            if surface.normals:
                book.put("shape", shape.name, {"urdf:normals": surface.normals})


def _materials(reference: Reference, book: Writer) -> None:
    """A mesh file carries its texture a second time; a material that nothing wears is there too."""
    pixels = dict(reference.assets.pixels)
    materials = {material.name: material for material in reference.shapes.materials}
    visuals = reference.shapes.of("visual")
    for shape in visuals:
        material = materials.get(shape.material or "")
        if material is None or not material.texture:
            continue
        digest = pixels.get(material.texture)
        book.put("shape", shape.name, pixels_of(digest))
        if isinstance(shape.geometry, Mesh):
            book.put("shape", shape.name, looks_of(material.rgba, digest))
    worn = {shape.material for shape in visuals}
    for name, material in materials.items():
        if name not in worn:
            book.put("material", name, {"urdf:rgba": tuple(material.rgba)})
            if material.texture:
                said = pixels_of(pixels.get(material.texture))
                words = {f"urdf:{k.removeprefix('urdf:')}": v for k, v in said.items()}
                book.put("material", name, words)
