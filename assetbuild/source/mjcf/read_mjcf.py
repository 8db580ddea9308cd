"""A flattened MJCF and its meshes -> the Robot: links, shapes, and what drives and watches it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import encode
from assetbuild.robot.files import SourceControl
from assetbuild.robot.model import Base, Contact, Control, Tree
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import SourceShapes
from assetbuild.robot.tree import depth_first
from assetbuild.source.mjcf.compiled import Compiled, compile_source
from assetbuild.source.mjcf.details import read_details
from assetbuild.source.mjcf.drives import Drives, read_drives
from assetbuild.source.mjcf.links import Links, read_links
from assetbuild.source.mjcf.sections import ORDER, Sections, read_sections
from assetbuild.source.mjcf.shapes import Geoms, read_geoms
from assetbuild.source.mjcf.text import AT

if TYPE_CHECKING:
    from lxml.etree import _Element

SOURCE_WARNING = Rule(
    "mjcf.source_warning", "warning", "MuJoCo warns about the source", "read the warning"
)


class ReadMjcf(Step):
    """Reads `source.xml`, `lines.json` and the mesh files below `files/`.

    MuJoCo compiles the source; the Robot gets the compiled numbers in full precision. What the
    Robot has no words for travels as `MjcfOnly`; what cannot travel is reported (`mjcf.dropped`).
    Raises SourceError with file and line for what is no robot of rigid bodies on joints.
    """

    usual_s = 0.4
    outputs = ("links.json", "shapes.json", "source_control.json")
    isolated = True
    preload = ("mujoco",)
    limits = Limits(wall_s=120.0, memory_mb=4096)

    base: Base | None = None
    """What the root is; None = as the source says."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes Tree, SourceShapes and SourceControl."""
        root = _source(files.inputs)
        compiled = compile_source(root, _meshes(root, files.inputs / "files"))
        links = read_links(compiled, self.base)
        geoms = read_geoms(links)
        drives = read_drives(links)
        sections = read_sections(links, drives)
        links.joints = sections.joints
        details = read_details(links)
        control = Control(
            actuators=tuple(drives.actuators),
            keyframes=tuple(sections.keyframes),
            excludes=tuple(sorted(set(sections.excludes))),
            contact=_common(geoms),
            contacts=tuple(geoms.contacts.items()),
            simulation=sections.simulation,
            sensors=tuple(sections.sensors),
            cameras=tuple(details.cameras),
            loops=tuple(sections.loops),
            mjcf_only=(
                *details.mjcf_only, *geoms.mjcf_only, *sections.mjcf_only, *drives.mjcf_only
            ),
        )  # fmt: skip
        shapes = SourceShapes(tuple(geoms.shapes), tuple(geoms.materials.values()))
        source = SourceControl(control, tuple(links.kept), _commands(sections, drives, links))
        name = root.get("model") or "robot"
        (files.outputs / "links.json").write_bytes(encode(_tree(name, links, drives)))
        (files.outputs / "shapes.json").write_bytes(encode(shapes))
        (files.outputs / "source_control.json").write_bytes(encode(source))
        yield from _warnings(compiled)
        yield from [*links.findings, *geoms.findings, *drives.findings, *sections.findings]
        yield from _order(sections, drives)


def _source(folder: Path) -> _Element:
    """`source.xml`, each element with the place where it stood."""
    from lxml import etree

    root = etree.fromstring((folder / "source.xml").read_bytes())
    lines = json.loads((folder / "lines.json").read_bytes())
    for element, where in zip(root.iter("*"), lines, strict=True):
        element.set(AT, where)
    return root


def _meshes(root: _Element, folder: Path) -> dict[str, bytes]:
    paths = {str(mesh.get("file")) for mesh in root.iterfind("asset/mesh")}
    return {path: (folder / path).read_bytes() for path in sorted(paths)}


def _tree(name: str, links: Links, drives: Drives) -> Tree:
    """Depth first, each joint with the effort limit of its drive."""
    order, joints = depth_first(links.root, links.joints)
    by_name = {body.name: body for body in links.bodies}
    limits = drives.limits
    limited = tuple(replace(j, limits=limits.get(j.name, j.limits)) for j in joints)
    return Tree(
        name,
        links.base,
        tuple(by_name[body] for body in order),
        limited,
        X_world_root=links.mount if links.base == "fixed" else IDENTITY,
    )


def _commands(
    sections: Sections, drives: Drives, links: Links
) -> tuple[tuple[str, tuple[tuple[str, float], ...]], ...]:
    """Return each keyframe's commands by actuator; position drives count from the joint's `ref`."""
    by_joint = {actuator.joint: actuator for actuator in drives.actuators}
    rest = {
        name: links.rest.get(joint, 0.0) * by_joint[joint].gear
        for name, joint in drives.names
        if joint and by_joint[joint].model == "pd"
    }
    return tuple(
        (key, tuple((name, value - rest.get(name, 0.0)) for name, value in values))
        for key, values in sections.ctrl
    )


def _common(geoms: Geoms) -> Contact:
    """The surface that most collision shapes have; the first of equals."""
    surfaces = list(geoms.contacts.values())
    return max(surfaces, key=surfaces.count, default=Contact())


def _warnings(compiled: Compiled) -> Iterator[Finding]:
    for text in compiled.warnings:
        yield SOURCE_WARNING(
            "robot", f"MuJoCo warns about the source: {text}", "repair it in the source"
        )


def _order(sections: Sections, drives: Drives) -> Iterator[Finding]:
    """The MJCF that we write has its drives in the order of the joints, the others after them."""
    order = {joint.name: number for number, joint in enumerate(sections.joints)}
    places = [order.get(joint, len(order)) for _, joint in drives.names]
    if places != sorted(places):
        names = ", ".join(name for name, _ in drives.names[:6])
        yield ORDER(
            "robot",
            f"the actuators of the source ({names}, ...) do not follow its joints: ours do",
            "ask for actuators by name",
            data={"actuators": len(drives.names)},
        )
