"""XRDF: what NVIDIA's planners (cuMotion, cuRobo) ask for beside the URDF.

The joints that move, their acceleration and jerk, the tool frames, spheres for each link, and the
pairs of links that never collide. See docs/reference/xrdf.md.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.errors import StepError, did_you_mean, meant_pattern, quoted
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Target
from assetbuild.robot.contact import Contact
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import MOVING, Tree
from assetbuild.robot.ranges import by_joint
from assetbuild.targets.xrdf.covers import Covered, LimitTable, XrdfOptions, covers_of, overlaps

NO_URDF = Rule(
    "xrdf.no_urdf",
    "error",
    "the XRDF names links and joints of a URDF that the bundle does not hold",
    "add `urdf` to the targets",
)
LIMITS = Rule(
    "xrdf.limits",
    "error",
    "planners refuse an XRDF without acceleration and jerk limits, which no URDF states; no number "
    "is invented, so the XRDF lacks the list",
    "state `xrdf: {acceleration: ..., jerk: ...}`, one number or one for each pattern of joints",
)
TOOL_FRAMES = Rule(
    "xrdf.tool_frames",
    "error",
    "planners ask which links they move to a goal, and the recipe names none",
    "state `xrdf: {tool_frames: [...]}`, names of links of the URDF",
)
LOOP = Rule(
    "xrdf.loop",
    "error",
    "the robot has closed loops: URDF and XRDF hold a tree, so that a planner would move the robot "
    "as it cannot move",
    "leave `xrdf` out of the targets, or accept the open tree by a waiver under `rules`",
)
GROUP = "collision_spheres"
"""The group of geometry that both sections of collisions name."""
HEAD = """\
# What a planner (NVIDIA cuMotion, cuRobo) knows of {robot} beyond ../urdf/{robot}.urdf,
# by assetbuild. Metres, radians, seconds; spheres lie in the frames of their links.
"""


class Xrdf(Target):
    """`xrdf/<robot>.xrdf`, version 1.0, for the URDF beside it.

    Links and frames are those of the URDF, unmerged; joints stand in the order of the robot.
    """

    outputs = ("xrdf/",)
    reads = ("links.json", "tree.json", "shapes.json", "control.json", "meshes/")
    isolated = True

    sections: ClassVar[Mapping[str, str]] = {"xrdf": "options"}
    derived: ClassVar = {"has_urdf": lambda recipe: "urdf" in recipe.value("targets")}

    options: XrdfOptions = XrdfOptions()
    """The recipe's `xrdf`."""
    has_urdf: bool = True
    """Whether the bundle holds the URDF whose names these are."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError for joints without one coordinate and for collision without a hull."""
        import yaml

        robot = RobotFiles(files.inputs)
        _refuse_joints(robot.tree)
        joints = [joint for joint in robot.tree.moving_joints if joint.mimic is None]
        drives = [robot.control.drive_of(joint) for joint in joints]
        planned = self._planned([drive.joint for drive in drives if drive.model != "passive"])
        covers = {link.name: link for link in covers_of(robot, self.options)}
        ignored = _ignored(list(covers), robot)
        pose = dict(initial_pose(robot.tree, robot.control).joints)
        stated: dict[str, Any] = {  # Any: YAML
            "format": "xrdf",
            "format_version": 1.0,
            # rad or m; joints that mimic others follow them by the URDF.
            "default_joint_positions": {joint.name: pose[joint.name] for joint in joints},
            "cspace": {"joint_names": planned, **self._limits(planned)},
        }
        if self.options.tool_frames:
            stated["tool_frames"] = self._tool_frames(robot.links)
        stated |= _collision_sections(covers, ignored)
        folder = files.outputs / "xrdf"
        folder.mkdir()
        text = yaml.safe_dump(stated, sort_keys=False, default_flow_style=None, width=100)
        head = HEAD.format(robot=self.robot)
        (folder / f"{self.robot}.xrdf").write_text(head + text, encoding="utf-8")
        yield from self._lacking(robot, planned)
        yield from (link.finding(self.options) for link in covers.values())
        yield from overlaps(covers, ignored, robot)

    def _planned(self, driven: list[str]) -> list[str]:
        joints = [joint for joint in driven if re.fullmatch(self.options.joints, joint)]
        if driven and not joints:
            raise StepError(
                f"xrdf.joints: pattern `{self.options.joints}` matches no driven joint",
                hint=meant_pattern(self.options.joints, driven),
            )
        return joints

    def _limits(self, joints: list[str]) -> dict[str, list[float]]:
        """The lists in which no number is missing."""
        limits = {}
        for key, name in (("acceleration", "acceleration_limits"), ("jerk", "jerk_limits")):
            numbers = [self._limit(key, joint) for joint in joints]
            if None not in numbers:
                limits[name] = [number for number in numbers if number is not None]
        return limits

    def _limit(self, key: str, joint: str) -> float | None:
        stated: float | LimitTable | None = getattr(self.options, key)
        return by_joint(stated, joint)

    def _tool_frames(self, links: Tree) -> list[str]:
        for frame in self.options.tool_frames:
            if frame not in links.by_body:
                raise StepError(
                    f"xrdf.tool_frames: the URDF has no link `{frame}`",
                    hint=did_you_mean(frame, links.by_body),
                )
        return list(self.options.tool_frames)

    def _lacking(self, robot: RobotFiles, planned: list[str]) -> Iterator[Finding]:
        """What the recipe leaves open, and what the format cannot say."""
        if not self.has_urdf:
            yield NO_URDF(
                "recipe targets",
                "the XRDF names links and joints of `urdf/`, which the bundle does not hold",
            )
        for key in ("acceleration", "jerk"):
            bare = [joint for joint in planned if self._limit(key, joint) is None]
            if bare:
                yield LIMITS(
                    "recipe xrdf",
                    f"nobody states the {key} of {len(bare)} joints: {quoted(bare, 6)}",
                    hint=f"state `xrdf: {{{key}: ...}}`, one number or one for each pattern",
                    data={"joints": tuple(bare)},
                )
        if not self.options.tool_frames:
            above = {joint.parent for joint in robot.links.joints}
            ends = [body.name for body in robot.links.bodies if body.name not in above]
            yield TOOL_FRAMES(
                "recipe xrdf",
                "the recipe names no link that a planner moves to a goal",
                hint=f"state `xrdf: {{tool_frames: [...]}}`; nothing hangs on {quoted(ends, 6)}",
                data={"ends": tuple(ends)},
            )
        if robot.control.loops:
            named = [loop.name for loop in robot.control.loops]
            yield LOOP(
                "robot",
                f"a planner would move {len(named)} closed loops as open ones: {quoted(named, 6)}",
                hint="leave `xrdf` out of the targets",
                data={"loops": tuple(named)},
            )


def _collision_sections(
    covers: Mapping[str, Covered], ignored: dict[str, list[str]]
) -> dict[str, Any]:  # Any: YAML
    """Nothing of a robot without collision. cuRobo asks for the buffers even where none is."""
    if not covers:
        return {}
    spheres = {
        link: [
            {"center": list(pose.xyz), "radius": sphere.radius} for pose, sphere in cover.spheres
        ]
        for link, cover in covers.items()
    }
    none: dict[str, float] = {}
    return {
        "collision": {"geometry": GROUP, "buffer_distance": none},
        "self_collision": {"geometry": GROUP, "buffer_distance": dict(none), "ignore": ignored},
        "geometry": {GROUP: {"spheres": spheres}},
    }


def _ignored(links: list[str], robot: RobotFiles) -> dict[str, list[str]]:
    """Links that never collide with a later one: of one body, or filtered as in MuJoCo."""
    tree, control = robot.tree, robot.control
    rule = ContactFilter.of(tree, robot.shapes, control)
    surfaces: dict[str, list[Contact]] = {}
    for shape in robot.shapes.of("collision"):
        surfaces.setdefault(shape.link, []).append(control.surface_of(shape))
    ignored: dict[str, list[str]] = {}
    for one, other in itertools.combinations(links, 2):
        bodies = tree.placement(one)[0], tree.placement(other)[0]
        excluded = tuple(sorted(bodies)) in control.excludes
        meets = any(a.meets(b) for a, b in itertools.product(surfaces[one], surfaces[other]))
        if bodies[0] == bodies[1] or excluded or rule.passes(*bodies) or not meets:
            ignored.setdefault(one, []).append(other)
    return ignored


def _refuse_joints(tree: Tree) -> None:
    for joint in tree.joints:
        if joint.kind not in MOVING | {"fixed"}:
            raise StepError(
                f"joint `{joint.name}` is {joint.kind}: the joints of an XRDF have one coordinate",
                hint="leave `xrdf` out of `targets`, or make hinges and slides of it by `edits: "
                f"[split_joint: {{joint: {joint.name}}}]`",
            )
