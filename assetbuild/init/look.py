"""The robot as the build will read it: the same steps, run on the spot."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import astuple, dataclass, replace
from pathlib import Path

from assetbuild.body.lint import LintBodies, LintLinks
from assetbuild.engine.scratch import scratch
from assetbuild.findings import Finding
from assetbuild.init.source import UrdfSource
from assetbuild.robot.chains import split
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Base, Tree
from assetbuild.robot.shapes import SourceShapes
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
