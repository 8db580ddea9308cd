"""The robot as the build will read it: the same steps, run on the spot."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from assetbuild.body.lint_bodies import LintBodies
from assetbuild.body.lint_links import LintLinks
from assetbuild.engine.scratch import scratch
from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.findings import Finding
from assetbuild.init.packages import is_file
from assetbuild.init.source import UrdfSource
from assetbuild.init.words import some
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Base, Tree
from assetbuild.robot.shapes import SourceShapes
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.source.urdf.read_urdf import ReadUrdf


@dataclass(frozen=True)
class InspectedRobot:
    """links: before merging fixed joints; tree: after; link_findings, body_findings: the lints'."""

    links: Tree
    tree: Tree
    shapes: SourceShapes
    link_findings: tuple[Finding, ...] = ()
    body_findings: tuple[Finding, ...] = ()

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
        packages = dict(source.packages)
        ports.run(ReadUrdf(file=source.shown, base="floating", packages=packages))
        _refuse_absent(source, json.loads(ports.read("meshes.json")))
        read = RobotFiles(ports.folder)
        tree, _ = merge_fixed_joints(read.links, True, ())
        return InspectedRobot(read.links, tree, read.source_shapes)


def _refuse_absent(source: UrdfSource, meshes: list[dict[str, str]]) -> None:
    """A build would stop there too, at the first; here all are named."""
    absent = [mesh for mesh in meshes if not is_file(source.root / mesh["path"])]
    if not absent:
        return
    first, others = absent[0], [f"`{mesh['path']}`" for mesh in absent[1:]]
    near = (source.root / first["path"]).parent
    names = [str(PurePosixPath(first["path"]).parent / f.name) for f in _listing(near)]
    more = f" (and {len(others)} more: {some(others)})" if others else ""
    raise SourceError(
        f"{first['subject']}: no file `{first['path']}`{more}",
        where=Where(source.shown, int(first["line"])),
        hint=did_you_mean(first["path"], names) or f"no folder `{near.name}` lies there",
    )


def _listing(folder: Path) -> Iterable[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return ()


def judge(links: Tree, shapes: SourceShapes, base: Base) -> InspectedRobot:
    """The robot on this base, with what the lints say of it there."""
    links = replace(links, base=base)
    tree, _ = merge_fixed_joints(links, True, ())
    with scratch() as ports:
        for name, value in (("links", links), ("tree", tree), ("shapes", shapes)):
            ports.put(f"{name}.json", encode(value))
        of_links, of_bodies = ports.run(LintLinks()), ports.run(LintBodies())
    return InspectedRobot(links, tree, shapes, of_links, of_bodies)
