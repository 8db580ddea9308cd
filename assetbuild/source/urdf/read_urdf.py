"""Read a URDF strictly: what is wrong, or has no place in the model, is reported with its line."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Base, Joint
from assetbuild.robot.shapes import SourceShapes
from assetbuild.source.urdf.joints import build_tree, read_joint
from assetbuild.source.urdf.links import named, read_body, read_shapes
from assetbuild.source.urdf.paths import Paths
from assetbuild.source.urdf.tidy import read_tidy
from assetbuild.source.urdf.xml import Node, canonical, unread

DROPPED = Rule(
    "urdf.dropped",
    ("info", "warning"),
    "elements or attributes that the robot model has no place for (transmission, gazebo, ...) "
    "were left out (a warning for limits of acceleration, deceleration and jerk, URDF 1.2)",
    "nothing; the source keeps them",
)
HARMLESS = ("origin", "material", "color", "texture")
"""Elements that weigh, touch and move nothing where they stray."""
STRAY = Rule(
    "urdf.stray",
    ("warning", "info"),
    "an element of the format is misplaced and ignored (an `<inertial>` outside of its "
    "link), and no reader counts it (info: it weighs, touches and moves nothing)",
    "move the element into the link or joint that it is part of",
)
WORLD_JOINT = Rule(
    "urdf.world.floating",
    "info",
    "a floating joint holds the robot to an empty root link: the link below is the floating base",
    "nothing; where it starts stands in the recipe's keyframes",
)
NAMELESS = Rule("urdf.name.missing", "info", "`<robot>` has no name", "give it one")

_WHOSE = ("name", "reference")
SHOWN = 6
"""Elements that one finding lists, and words of each."""
LIMITS_OF_1_2 = frozenset(f"{name} of limit" for name in ("acceleration", "deceleration", "jerk"))
"""A simulated joint may move faster than they allow."""


class ReadUrdf(Step):
    """`robot.urdf` -> links, shapes, the meshes it names, and the lines of them all.

    `source.urdf` is the description itself, without comments and indentation and as `tidy` left
    it: what checks read who must not believe this reader.

    Comments and formatting change nothing but `source_map.json` and the lines in `meshes.json`.
    Raises SourceError with `file:line`; of several mistakes the first is reported.
    """

    shares = True
    outputs = ("links.json", "shapes.json", "meshes.json", "source_map.json", "source.urdf")
    isolated = True
    limits = Limits(wall_s=120.0, memory_mb=2048)

    file: str
    """Path of the URDF below the source root: errors name it, relative paths start beside it."""
    base: Base = "fixed"
    packages: dict[str, str] = Field(default_factory=dict)
    """package:// name -> folder below the source root; `.` is the root itself."""
    relative_to: str | None = None
    absolute: dict[str, str] = Field(default_factory=dict)
    missing: tuple[str, ...] = ()
    """See `Paths`."""

    def run(self, files: Files) -> Sequence[Finding]:
        """Reads `robot.urdf`; writes Tree, Shapes, mesh uses, lines."""
        data = (files.inputs / "robot.urdf").read_bytes()
        root = read_tidy(data, self.file)
        if self.base == "floating":
            _leave_out_world(root)
        links = list(named(root.all("link")))
        bodies = [read_body(name, link) for name, link in links]
        paths = Paths(self.file, self.packages, self.relative_to, self.absolute, self.missing)
        geometries = read_shapes(root, links, paths)
        nodes, by_name = {node.subject: node for _, node in links}, dict(links)
        names = {str(node.get("name")) for node in root.all("joint")}
        joints = list[Joint]()
        for name, node in named(root.all("joint")):
            joints.append(read_joint(name, node, names, by_name))
            nodes[node.subject] = node
        name = (root.get("name") or "").strip()
        if not name:
            hint = 'write <robot name="...">'
            root.report(NAMELESS, "<robot> has no name; it is called `robot`", hint)
        if not links:
            hint = "is this the right file? A xacro of macros alone is included by another one"
            raise root.error("a robot without links", hint)
        tree = build_tree(name or "robot", self.base, bodies, joints, nodes)
        out, used = files.outputs, [use for _, use in sorted(geometries.uses.items())]
        shapes = SourceShapes(tuple(geometries.shapes), tuple(geometries.materials.values()))
        (out / "links.json").write_bytes(encode(tree))
        (out / "shapes.json").write_bytes(encode(shapes))
        files.write_json("meshes.json", used)
        homeless, strays = unread(root)
        lines = {"robot": root.line}
        lines |= {subject: node.line for subject, node in nodes.items()}
        lines |= geometries.lines
        lines |= {f"mesh {path}": int(use["line"]) for path, use in geometries.uses.items()}
        lines |= {f"element {kind}": found[0].line for kind, found in homeless.items()}
        lines |= {f"element {stray.tag}": stray.line for stray in reversed(strays)}
        files.write_json("source_map.json", {"file": self.file, "lines": lines})
        (out / "source.urdf").write_bytes(canonical(root))
        paths.report(root)
        _report_strays(strays)
        _report_homeless(root, homeless)
        return root.findings


def _leave_out_world(root: Node) -> None:
    """Take out an empty root link with the floating joint below it, which a floating base is."""
    joints = root.all("joint")
    children = {child.get("link") for joint in joints if (child := joint.only("child"))}
    roots = [link for link in root.all("link") if link.get("name") not in children]
    if len(roots) != 1 or roots[0].only("*") is not None:
        return
    world = roots[0].get("name")
    held = [j for j in joints if (p := j.only("parent")) is not None and p.get("link") == world]
    if len(held) != 1 or held[0].get("type") != "floating":
        return
    message = f"joint {held[0].get('name')} on line {held[0].line} floats from the empty link "
    message += f"`{world}`: both are left out, and the link below is the floating base"
    hint = "where it starts stands in the recipe's keyframes"
    root.report(WORLD_JOINT, message, hint, data={"line": held[0].line})
    held[0].remove()
    roots[0].remove()


def without_meshes(file: Path, urdf: bytes, base: Base = "fixed") -> ReadUrdf:
    """The step for a look without meshes, wherever they lie: packages are not looked for."""
    named = re.findall(rb"package:/*([A-Za-z0-9_.-]+)", urdf)
    packages = {name.decode(): "." for name in named}
    return ReadUrdf(file=str(file.absolute()), base=base, packages=packages)


def _report_homeless(root: Node, homeless: Mapping[str, list[Node]]) -> None:
    """One finding for each kind of thing that the robot model has no place for."""
    for kind, nodes in homeless.items():
        attribute, _, tag = kind.rpartition(" of ")
        what = f"attribute `{attribute}` of <{tag}>" if attribute else f"<{kind}>"
        times = f", {len(nodes)} times" if len(nodes) > 1 else ""
        moves = kind in LIMITS_OF_1_2 or any(map(_moves, nodes))
        root.report(
            DROPPED,
            f"{what} was left out{times}" + ("" if attribute else f": {_listed(nodes)}"),
            hint="no target has a place for it; the source keeps it"
            + ("; the robot moves otherwise without it" if moves else ""),
            severity="warning" if moves else "info",
            data={"element": kind, "count": len(nodes)},
        )


def _listed(nodes: list[Node]) -> str:
    """Whose they are and what they say: `d` (mu1, gravity)."""
    entries = []
    for node in nodes[:SHOWN]:
        named = (one.get("name") for one in (node.element, *node.element.iterancestors()))
        owner = node.get("reference") or next((name for name in named if name), "robot")
        words = [child.tag for child in node.all("*")]
        words = words or [str(key) for key in node.element.attrib if key not in _WHOSE]
        entries.append(f"`{owner}` ({', '.join(words[:SHOWN])})" if words else f"`{owner}`")
    return ", ".join(entries) + (", ..." if len(nodes) > SHOWN else "")


def _moves(node: Node) -> bool:
    """Whether Gazebo's words make the robot move otherwise: a spring, or no gravity."""
    values = {child.tag: (child.element.text or "").strip().lower() for child in node.all("*")}
    if node.tag != "gazebo":
        return False
    pulls = values.get("gravity", "true") not in ("false", "0")
    pulls = pulls and values.get("turnGravityOff", "false") in ("false", "0")
    return not pulls or "springStiffness" in values


def _report_strays(strays: Sequence[Node]) -> None:
    """Parts of links and joints that stand elsewhere, with the mass that vanishes with them."""
    for stray in strays:
        tag = stray.tag
        mass = stray if tag == "mass" else stray.only("mass")
        value = mass.get("value") if mass is not None else None
        weighs = f" of {value} kg" if value else ""
        stray.about(f"element {tag}").report(
            STRAY,
            f"<{tag}>{weighs} on line {stray.line} is misplaced and ignored, as by every "
            "other reader",
            hint="move it into the <link> or <joint> that it is part of",
            severity="info" if tag in HARMLESS else "warning",
            data={"element": tag, "line": stray.line, "mass_kg": value},
        )
