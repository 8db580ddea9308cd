"""The section `collision:`: what each link hits with, where one rule does not suit all."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from assetbuild.errors import StepError
from assetbuild.init.anatomy import Anatomy
from assetbuild.init.look import InspectedRobot
from assetbuild.init.mesh_points import is_flat, mesh_of, scaled_points
from assetbuild.init.patterns import patterns_of
from assetbuild.init.words import flow, inline, plain, quoted
from assetbuild.mesh.hull import refuse_flat
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import MeshFile, Role, SourceShape
from assetbuild.robot.tree import forward_kinematics

COMPOUND = 0.15
"""Joints closer than this share of the robot's size make one compound joint (a hip, a wrist)."""

BALL = 3.0
"""Longest extent over the shortest of a foot that a sphere stands for; more is a disc or a rod."""

OUTSIZED = 100.0
"""A collision mesh that is so many times as large as its link's visual mesh is a mistake."""

Rules = dict[str, tuple[dict[str, str], str]]
"""Link -> its rule and the reason."""


def collision(
    robot: InspectedRobot,
    anatomy: Anatomy,
    root: Path,
    overlaps: Mapping[tuple[str, str], float] = MappingProxyType({}),
    inside: Mapping[tuple[str, str], float] = MappingProxyType({}),
) -> Iterator[str]:
    """The whole section. root: of the source's files.

    overlaps: bodies whose hulls throw the robot over at home, and depths, m; inside: bodies that
    lie in each other in every pose.
    """
    origin, why = "visual", "the source has no collision shapes"
    if robot.shapes.of("collision"):
        seen = {shape.link for shape in robot.shapes.of("visual")}
        idle = len(seen - robot.solid_links)
        why = f"{idle} links are drawn but hit nothing, as in the source" if idle else "all have it"
        origin = "collision"
    yield "collision:"
    if anatomy.base == "fixed":
        yield "  preset: manipulation   # close to the mesh; `locomotion` is coarse and fast"
    else:
        yield "  preset: locomotion   # coarse and fast; `manipulation` stays close to the mesh"
    yield (
        "  # auto: a primitive stays as it is, a mesh becomes few convex pieces within tolerances"
    )
    yield f"  default: {{method: auto, from: {origin}}}   # {why}"
    rules = _rules(robot, anatomy, root)
    if rules:
        yield "  links:"
    for rule, reason in dict.fromkeys((inline(rule), reason) for rule, reason in rules.values()):
        links = [link for link, own in rules.items() if (inline(own[0]), own[1]) == (rule, reason)]
        yield f"    # {reason}"
        for pattern in patterns_of(links, list(robot.links.by_body)):
            yield f"    {quoted(pattern)}: {rule}"
    yield "  exclude:"
    yield "    adjacent: true   # bodies that a joint connects never collide"
    pairs = compound_pairs(robot.tree, anatomy.size_m)
    if pairs:
        yield "    # Joints close together make one (a hip, a wrist): hulls overlap there."
    yield from _named(
        overlaps,
        "Hulls of these bodies overlap at home and push the robot over or askew.",
        "They pass through each other now; another pose of `home` may free them:",
    )
    yield from _named(inside, "These bodies, or their hulls, lie in each other whatever the pose:")
    excluded = dict.fromkeys((*pairs, *overlaps, *inside))
    if excluded:
        yield from flow("    pairs: [", [inline(pair) for pair in excluded], "]")


def _named(depths: Mapping[tuple[str, str], float], *why: str) -> Iterator[str]:
    """A comment: why pairs of bodies never collide, and how deep they lie in each other, m."""
    yield from (f"    # {line}" for line in why if depths)
    for (a, b), depth in depths.items():
        yield f"    #   {plain(a)} in {plain(b)}: {1e3 * depth:.3g} mm"


def soles_of(robot: InspectedRobot, anatomy: Anatomy) -> list[str]:
    """Links that the robot stands on in the build: those of its soles that have a shape."""
    shaped = {shape.link for shape in robot.shapes.shapes}
    return [sole for leg in anatomy.legs for sole in leg.soles if sole in shaped]


def _rules(robot: InspectedRobot, anatomy: Anatomy, root: Path) -> Rules:
    """The last word on a link wins."""
    rules = _flat(robot, root) | _outsized(robot, root)
    for link in _ball_feet(robot, anatomy, root):
        if link not in rules:
            why = "A foot that meets the ground in a point rolls best as a sphere."
            rules[link] = ({"method": "primitive", "shape": "sphere"}, why)
    if robot.shapes.of("collision"):
        for link in soles_of(robot, anatomy):
            if link not in robot.solid_links:
                why = "The source's collision leaves out this foot, so that it would stand on air."
                rules[link] = ({"method": "auto", "from": "visual"}, why)
    return rules


def _flat(robot: InspectedRobot, root: Path) -> Rules:
    """Links with a collision mesh that spans no volume, which no method can use."""
    role: Role = "collision" if robot.shapes.of("collision") else "visual"
    found: Rules = {}
    for shape in robot.shapes.of(role):
        if isinstance(shape.geometry, MeshFile) and is_flat(root, shape.geometry):
            found[shape.link] = _instead(robot, root, shape.link, role)
    return found


def _instead(
    robot: InspectedRobot, root: Path, link: str, role: Role
) -> tuple[dict[str, str], str]:
    why = f"A {role} mesh of this link is flat and can be no collision shape: "
    own = [shape for shape in robot.shapes.shapes if shape.link == link]
    drawn = [shape for shape in own if shape.role == "visual"]
    if role == "collision" and drawn and not any(_is_flat(root, shape) for shape in drawn):
        return {"method": "auto", "from": "visual"}, why + "what is drawn of it is taken."
    if _span(root, [shape for shape in own if shape.role == role]):
        return {"method": "primitive", "shape": "box"}, why + "one box is put around all of them."
    return {"method": "none"}, why + "it hits nothing."


def _outsized(robot: InspectedRobot, root: Path) -> Rules:
    """Links whose collision meshes lie far beyond what is drawn: of another unit, by mistake."""
    found: Rules = {}
    for link in robot.solid_links:
        own = [shape for shape in robot.shapes.shapes if shape.link == link]
        drawn, solid = (
            max((_extent(root, shape) for shape in own if shape.role == role), default=0.0)
            for role in ("visual", "collision")
        )
        if drawn and solid > OUTSIZED * drawn:
            times = f"{solid / drawn:,.0f} times as large as what is drawn of it"
            why = f"The collision mesh of this link is {times}, which is taken instead."
            found[link] = ({"method": "auto", "from": "visual"}, why)
    return found


def _extent(root: Path, shape: SourceShape) -> float:
    """The longest extent of a mesh, m; 0 of what is no mesh, or is left unread."""
    if not isinstance(shape.geometry, MeshFile):
        return 0.0
    read = mesh_of(root, shape.geometry)
    return 0.0 if read is None else float(np.ptp(scaled_points(read, shape.geometry), axis=0).max())


def _is_flat(root: Path, shape: SourceShape) -> bool:
    return isinstance(shape.geometry, MeshFile) and is_flat(root, shape.geometry)


def _span(root: Path, shapes: list[SourceShape]) -> bool:
    """Whether all of them together span a volume."""
    clouds = []
    for shape in shapes:
        if not isinstance(shape.geometry, MeshFile):
            return True
        if (read := mesh_of(root, shape.geometry)) is not None:
            clouds.append(shape.X_link_shape.apply(scaled_points(read, shape.geometry)))
    try:
        refuse_flat(np.concatenate(clouds), "all")
    except (StepError, ValueError):
        return False
    return True


def _ball_feet(robot: InspectedRobot, anatomy: Anatomy, root: Path) -> list[str]:
    """Feet of walkers on four legs or more that are meshes, about as wide as they are high."""
    if len(anatomy.legs) < 4:
        return []
    solid = robot.shapes.of("collision") or robot.shapes.of("visual")
    balls = []
    for leg in anatomy.legs:
        own = [s for s in solid if s.link == leg.foot]
        separate = not leg.rolls and (leg.foot != leg.tip or len(leg.joints) >= 4)
        if own and separate and all(_is_ball(root, shape) for shape in own):
            balls.append(leg.foot)
    return balls


def _is_ball(root: Path, shape: SourceShape) -> bool:
    """Whether the mesh's extents, m, differ by less than BALL; a mesh that init leaves unread."""
    if not isinstance(shape.geometry, MeshFile):
        return False
    read = mesh_of(root, shape.geometry)
    if read is None:
        return True
    extents = np.ptp(scaled_points(read, shape.geometry), axis=0)
    return float(extents.max()) < BALL * float(extents.min())


def compound_pairs(tree: Tree, size: float) -> list[tuple[str, str]]:
    """A body and the one two joints further, where the two joints are close together."""
    poses = forward_kinematics(tree, {})
    pairs = []
    for joint in tree.joints:
        above = tree.joint_above.get(joint.parent)
        if above is not None:
            apart = math.dist(poses[joint.child].xyz, poses[above.child].xyz)
            if apart < COMPOUND * size:
                pairs.append((above.parent, joint.child))
    return pairs
