"""XRDF: what a planner wants beside the URDF, for NVIDIA's cuMotion and cuRobo.

Written after XRDF 1.0 (https://nvidia-isaac-ros.github.io/concepts/manipulation/xrdf.html): joints
that are planned with their limits of acceleration and jerk, a default pose, tool frames, spheres
for each link, and the pairs of links that may overlap. Links and joints are those of the URDF.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Mapping
from itertools import combinations, product
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Target
from assetbuild.quantities import Model, Pattern, Positive
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Contact, Control, Joint, Tree
from assetbuild.robot.shapes import Shapes, Sphere

NOT_SPHERES = Rule(
    "xrdf.shape",
    "error",
    "a planner knows links as spheres, and a link's collision has other shapes",
    "a variant with `collision: {default: {method: spheres}}`, whose report says how well they fit",
)
NO_LIMIT = Rule(
    "xrdf.limit",
    "error",
    "XRDF wants limits of acceleration and jerk for each joint that is planned, and no source "
    "states them",
    "`xrdf: {acceleration: {.*: 10}, jerk: {.*: 500}}` with your robot's numbers",
)
NO_FRAME = Rule(
    "xrdf.frame",
    "error",
    "a tool frame that `xrdf.tool_frames` names is no link of the URDF",
    "a name of a link, or of a fixed frame",
)
GEOMETRY = "spheres"
"""The name of the only set of geometry in the file."""
Spheres = dict[str, list[dict[str, object]]]
"""Centres in the link's frame and radii, m, by link."""


class XrdfOptions(Model):
    """What only XRDF has, for planners."""

    joints: Pattern = Field(
        ".*", description="joints that are planned; all others keep their default position"
    )
    acceleration: Mapping[Pattern, Positive] = Field(
        default_factory=dict, description="rad/s2 or m/s2; limit by pattern of joints"
    )
    jerk: Mapping[Pattern, Positive] = Field(
        default_factory=dict, description="rad/s3 or m/s3; limit by pattern of joints"
    )
    tool_frames: tuple[str, ...] = Field((), description="links of the URDF that are controlled")


class Xrdf(Target):
    """`xrdf/<robot>.xrdf`, to be loaded with `urdf/<robot>.urdf`."""

    outputs = ("xrdf/",)
    reads = ("links.json", "tree.json", "shapes.json", "control.json")

    sections: ClassVar[Mapping[str, str]] = {"xrdf": "options"}

    options: XrdfOptions = XrdfOptions()
    """The recipe's `xrdf`."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes what is known, with an error for what the format wants and nobody stated."""
        import yaml

        robot = RobotFiles(files.inputs)
        links, control = robot.links, robot.control
        joints = [joint for joint in robot.tree.moving_joints if joint.mimic is None]
        planned = [joint for joint in joints if _matches(self.options.joints, joint.name)]
        limits = {
            "acceleration_limits": self.options.acceleration,
            "jerk_limits": self.options.jerk,
        }
        space: dict[str, object] = {"joint_names": [joint.name for joint in planned]}
        for key, table in limits.items():
            values = [_limit(table, joint) for joint in planned]
            if lacking := [j.name for j, v in zip(planned, values, strict=True) if v is None]:
                yield _no_limit(key, lacking)
            else:
                space[key] = values
        spheres = yield from _spheres(robot.shapes)
        content: dict[str, object] = {
            "format": "xrdf",
            "format_version": 1.0,
            "default_joint_positions": _defaults(joints, control),
            "cspace": space,
        }
        frames = yield from self._tool_frames(links)
        if frames:
            content["tool_frames"] = frames
        content["collision"] = {"geometry": GEOMETRY}
        content["self_collision"] = {
            "geometry": GEOMETRY,
            "ignore": _ignored(sorted(spheres), robot.tree, robot.shapes, control),
        }
        content["geometry"] = {GEOMETRY: {"spheres": spheres}}
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100)
        path = files.outputs / f"xrdf/{self.robot}.xrdf"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def _tool_frames(self, links: Tree) -> Generator[Finding, None, list[str]]:
        known = {body.name for body in links.bodies} | {frame.name for frame in links.frames}
        for name in self.options.tool_frames:
            if name not in known:
                yield NO_FRAME(f"link {name}", "is a tool frame, and the URDF has no such link")
        return [name for name in self.options.tool_frames if name in known]


def _matches(pattern: str, name: str) -> bool:
    return re.fullmatch(pattern, name) is not None


def _limit(table: Mapping[str, float], joint: Joint) -> float | None:
    """Of the first pattern that matches."""
    return next((v for pattern, v in table.items() if _matches(pattern, joint.name)), None)


def _no_limit(key: str, joints: list[str]) -> Finding:
    word = key.removesuffix("_limits")
    names = ", ".join(f"`{name}`" for name in joints)
    return NO_LIMIT("robot", f"`xrdf.{word}` says nothing of {names}; `{key}` is left out")


def _spheres(shapes: Shapes) -> Generator[Finding, None, Spheres]:
    found: Spheres = {}
    others: dict[str, set[str]] = {}
    for shape in shapes.of("collision"):
        if isinstance(shape.geometry, Sphere):
            row = {"center": list(shape.X_link_shape.xyz), "radius": shape.geometry.radius}
            found.setdefault(shape.link, []).append(row)
        else:
            others.setdefault(shape.link, set()).add(type(shape.geometry).__name__.lower())
    for link, kinds in sorted(others.items()):
        message = f"its collision has {', '.join(sorted(kinds))}, which are left out here"
        yield NOT_SPHERES(f"link {link}", message)
    return found


def _defaults(joints: list[Joint], control: Control) -> dict[str, float]:
    """The first keyframe's, else 0 or what the limits allow next to it."""
    stated = dict(control.keyframes[0].joints) if control.keyframes else {}
    return {joint.name: stated.get(joint.name, _nearest_to_zero(joint)) for joint in joints}


def _nearest_to_zero(joint: Joint) -> float:
    lower, upper = joint.limits.lower, joint.limits.upper
    at = 0.0 if lower is None else max(0.0, lower)
    return at if upper is None else min(at, upper)


def _ignored(
    links: list[str], tree: Tree, shapes: Shapes, control: Control
) -> dict[str, list[str]]:
    """Links that may overlap: of one body, of bodies that never collide; each pair once."""
    rule = ContactFilter.of(tree, shapes, control)
    excluded = {frozenset(pair) for pair in control.excludes}
    own = dict(control.contacts)
    contacts: dict[str, list[Contact]] = {}
    for shape in shapes.of("collision"):
        contact = own.get(shape.name, control.contact)
        contacts.setdefault(tree.placement(shape.link)[0], []).append(contact)

    def meet(a: str, b: str) -> bool:
        pairs = product(contacts[a], contacts[b])
        return any(one.mask & two.partners or two.mask & one.partners for one, two in pairs)

    found: dict[str, list[str]] = {}
    for one, other in combinations(links, 2):
        a, b = tree.placement(one)[0], tree.placement(other)[0]
        apart = frozenset((a, b)) in excluded or rule.passes(a, b)
        if a == b or apart or not meet(a, b):
            found.setdefault(one, []).append(other)
    return found
