"""`urdf/<robot>.urdf`: the links of the source, before fixed joints are merged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from assetbuild.facts.losses import Lost
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, geometry_facts, mimic_facts, robot_table
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.urdf_file import UrdfFile
from assetbuild.robot.model import MOVING, Control, Joint
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Capsule, Cylinder, Shape, Sphere
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
        """Links, joints and their meshes; UsageError where it is no URDF."""
        return UrdfFile(path).read()

    def found(self, path: Path, reference: Reference) -> Table:
        """A copy of one of the robot's own meshes is not read again."""
        return UrdfFile(path, reference.assets.known).read().only(self.holds)

    def expected(self, reference: Reference) -> Table:
        """The links with their ratings; a capsule, which URDF lacks, in three pieces."""
        links = held_by_world(reference.links)
        reference = replace(reference, links=links)
        stated, book = robot_table(reference, merged=False).only(self.holds), Writer()
        follows = {each.joint: each.mimic for each in reference.control.loop_mimics}
        for joint in links.joints:
            book.put("joint", joint.name, dict(_ratings(joint, reference.control)))
            if joint.name in follows:
                book.put("joint", joint.name, mimic_facts(follows[joint.name]))
        capsules = set()
        for shape in reference.shapes.shapes:
            if isinstance(shape.geometry, Capsule):
                capsules.add(shape.name)
                for name, facts in _pieces(shape, shape.geometry):
                    book.put("shape", name, stated.of("shape", shape.name) | facts)
        whole = stated.only(lambda key: key.kind != "shape" or key.name not in capsules)
        return whole | book.table()


def _ratings(joint: Joint, control: Control) -> Iterator[tuple[str, Value]]:
    """Effort and velocity are the drive's where it limits them, else the source's, where not 0."""
    yield "urdf:type", joint.kind
    row = control.by_joint.get(joint.name)
    for name in ("effort", "velocity") if joint.kind in MOVING else ():
        driven = getattr(row, name) if row else None
        yield name, (getattr(joint.limits, name) or None) if driven is None else driven


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
