"""The robot as the build will read it: the same steps, run on the spot; and what it can become."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np

from assetbuild.body.lint_bodies import LintBodies
from assetbuild.body.lint_links import LintLinks
from assetbuild.engine.scratch import scratch
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.init.source import UrdfSource
from assetbuild.init.words import plain, some
from assetbuild.mesh.companions import companions_of
from assetbuild.mesh.hull import refuse_flat
from assetbuild.mesh.material import SourceMesh
from assetbuild.mesh.read import Format, read_mesh
from assetbuild.robot.chains import is_massless, weighs
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Base, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import MeshFile, SourceShapes
from assetbuild.robot.split_joints import split
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.source.urdf.joints import LIMIT_OMITTED
from assetbuild.source.urdf.tidy import WORLD_JOINT


@dataclass(frozen=True)
class InspectedRobot:
    """links: before merging fixed joints; tree: after; link_findings, body_findings: the lints'.

    source_findings: what the reader of the source said. planar: joints of the source that are split
    into joints of one coordinate, which all formats hold. root: folder of the source's files.
    """

    links: Tree
    tree: Tree
    shapes: SourceShapes
    link_findings: tuple[Finding, ...] = ()
    body_findings: tuple[Finding, ...] = ()
    source_findings: tuple[Finding, ...] = ()
    planar: tuple[str, ...] = ()
    root: Path = Path()

    @property
    def unranged(self) -> tuple[str, ...]:
        """Hinges that turn by themselves and state neither end of a range."""
        found = []
        for finding in self.source_findings:
            missing, name = finding.data.get("missing", ()), finding.subject.partition(" ")[2]
            if finding.rule == LIMIT_OMITTED.id and isinstance(missing, tuple):
                joint = self.links.by_joint.get(name)
                if {"lower", "upper"} <= set(missing) and joint and joint.kind == "revolute":
                    found += [name] * (joint.mimic is None)
        return tuple(found)

    @property
    def floats(self) -> bool:
        """Whether the source itself holds its base by a floating joint."""
        return any(finding.rule == WORLD_JOINT.id for finding in self.source_findings)

    @property
    def solid_links(self) -> frozenset[str]:
        """Links with collision shapes; of a robot that has none, those with visual shapes."""
        solid = self.shapes.of("collision") or self.shapes.of("visual")
        return frozenset(shape.link for shape in solid)

    def links_of(self, body: str) -> list[str]:
        """The links that became one body."""
        return [name for name in self.links.by_body if self.tree.placement(name)[0] == body]


def look(source: UrdfSource) -> InspectedRobot:
    """Read. Raises SourceError with file and line, as a build would."""
    with scratch() as ports:
        ports.put("robot.urdf", source.data)
        told = ports.run(source.reader())
        read = RobotFiles(ports.folder)
        planar = tuple(joint.name for joint in read.links.joints if joint.kind == "planar")
        links = split(read.links, frozenset(planar))
        tree, _ = merge_fixed_joints(links, True, ())
        shapes = read.source_shapes
        return InspectedRobot(
            links, tree, shapes, source_findings=told, planar=planar, root=source.root
        )


def judge(
    links: Tree,
    shapes: SourceShapes,
    base: Base,
    source_findings: tuple[Finding, ...] = (),
    kept: Collection[str] | None = None,
    root: Path = Path(),
) -> InspectedRobot:
    """The robot on this base, with what the lints say of it there.

    kept: of an MJCF, links that stay bodies on their fixed joint, and the root stays the root.
    root: folder of the source's files.
    """
    links = replace(links, base=base)
    tree, _ = merge_fixed_joints(links, True, kept or (), keep_root=kept is not None)
    with scratch() as ports:
        for name, value in (("links", links), ("tree", tree), ("shapes", shapes)):
            ports.put(f"{name}.json", encode(value))
        of_links, of_bodies = ports.run(LintLinks()), ports.run(LintBodies())
    return InspectedRobot(links, tree, shapes, of_links, of_bodies, source_findings, root=root)


def zeroed(tree: Tree) -> list[str]:
    """Hinges of a robot that could move nothing, as all its limits are stated as 0."""
    moving = [joint for joint in tree.moving_joints if joint.mimic is None]
    stated = [value for joint in moving for value in astuple(joint.limits)]
    if any(value != 0.0 for value in stated):
        return []
    return [joint.name for joint in moving if joint.kind == "revolute"]


LARGEST = 16 << 20
"""A mesh of more bytes is left to the build, which reads it in a process of its own."""


def mesh_of(root: Path, mesh: MeshFile) -> SourceMesh | None:
    """What the file holds; None for one that the build would refuse, or that is too large.

    root: the folder that the mesh's path starts from.
    """
    path = root / mesh.path
    formats: dict[str, Format] = {f".{format}": format for format in get_args(Format)}
    format = formats.get(path.suffix.lower())
    try:
        if format is not None and path.stat().st_size <= LARGEST:
            data = path.read_bytes()
            names = companions_of(data, "gltf") if format == "gltf" else ()
            beside = {n: f.read_bytes() for n in names if (f := path.parent / n).is_file()}
            return read_mesh(data, format, companions=beside, subject=mesh.path)
    except (StepError, OSError):
        pass
    return None


def scaled_points(read: SourceMesh, mesh: MeshFile) -> Array:
    """(n, 3) m, of the points that a face uses."""
    used = [part.mesh.vertices[np.unique(part.mesh.faces)] for part in read.parts]
    points: Array = np.concatenate(used) * np.array(mesh.scale)
    return points


def is_flat(root: Path, mesh: MeshFile) -> bool:
    """Whether the mesh can be read and spans no volume."""
    read = mesh_of(root, mesh)
    if read is None:
        return False
    try:
        refuse_flat(scaled_points(read, mesh), mesh.path)
    except StepError:
        return True
    return False


MERGED = "`fixed_joints: {merge: true}`, and the edit `share_mass` for links without mass above it"


def targets(
    robot: InspectedRobot, springs: Collection[str] = (), motion: Collection[str] = ()
) -> str:
    """The line of the recipe.

    springs: joints with one that the USD cannot hold; motion: what else it cannot, in words.
    """
    free = next((joint.name for joint in robot.tree.joints if joint.kind == "floating"), None)
    if free is not None:
        reason = f"joint {plain(free)} is floating, which only a base can be in MJCF and USD; "
        reason += "the edit `split_joint` makes six joints of it"
        return f"targets: [urdf]   # {reason}"
    ball = next((joint.name for joint in robot.tree.joints if joint.kind == "ball"), None)
    if ball is not None:
        reason = f"joint {plain(ball)} is a ball, which MJCF alone has here"
        hint = "the edit `split_joint` makes three hinges of it, if it never turns to 90 degrees"
        return f"targets: [mjcf]   # {reason}; {hint}"
    reason = not_in_usd(robot)
    if springs and not reason:
        reason = f"it cannot hold the springs of {some(list(springs))}; see `usd.spring`"
    if motion and not reason:
        reason = f"it cannot hold {next(iter(motion))}; see `usd.motion`"
    if reason:
        return f"targets: [urdf, mjcf]   # no usd: {plain(reason, 160)}"
    return "targets: [urdf, mjcf, usd]"


def not_in_usd(robot: InspectedRobot) -> str:
    """Why no articulation of PhysX is this robot, exactly; "" when one is."""
    shown = {shape.link for shape in robot.shapes.shapes}
    for name in carried(robot):
        return f"{name} has no mass but for the bodies that fixed joints hold to it; {MERGED}"
    for body in robot.tree.bodies:
        above = robot.tree.joint_above.get(body.name)
        if above is None or above.kind != "fixed":
            continue
        if is_massless(body) and body.name in shown:
            return f"{body.name} has no mass, and is excluded from other pairs than {above.parent}"
    return ""


def carried(robot: InspectedRobot) -> list[str]:
    """Moving bodies without mass, to which fixed joints hold bodies that have some."""
    tree = robot.tree
    return [
        body.name
        for body in tree.bodies
        if (tree.base == "floating" or body.name != tree.root)
        and is_massless(body)
        and weighs(tree, body.name)
    ]
