"""Joints of a URDF, and the tree that they make of the links."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import cast, get_args

from assetbuild.errors import did_you_mean, quoted
from assetbuild.findings import Rule
from assetbuild.robot.mimic import leading
from assetbuild.robot.model import (
    MOVING,
    URDF_UNLIMITED,
    Base,
    Body,
    Joint,
    JointKind,
    Limits,
    Mimic,
    Tree,
)
from assetbuild.robot.pose import Vec3, vec3
from assetbuild.robot.tree import depth_first
from assetbuild.source.urdf.links import read_origin
from assetbuild.source.urdf.xml import Node

KINDS = tuple(kind for kind in get_args(JointKind) if kind != "ball")
WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
AXIS_TOLERANCE = 1e-4
"""An axis whose length is off by more is no unit vector of four digits: said as a finding."""

AXIS_NORMALISED = Rule(
    "urdf.axis.normalised", "info", "an axis did not have length 1", "write a unit vector"
)
LIMIT_OMITTED = Rule(
    "urdf.limit.omitted",
    "warning",
    "`<limit>` lacks attributes; a missing lower or upper counts as 0",
    "state it in the URDF, or give effort and velocity in the recipe's actuator table",
)
LIMIT_UNLIMITED = Rule(
    "urdf.limit.unlimited",
    "info",
    "a limit of 1e9 or more counts as unlimited; built URDFs state it where there is none",
    "nothing, or state the limit",
)
LIMIT_IGNORED = Rule(
    "urdf.limit.ignored",
    "info",
    "a continuous joint states a range",
    "make it `revolute` if the range is meant",
)
MIMIC_FIXED = Rule(
    "joint.mimic_fixed",
    "warning",
    "the joint mimics a fixed one, or with a multiplier of 0, so it is locked where that puts it",
    "make it `fixed` too, or give the joint that it mimics a type that moves",
)


TWO_PARENTS = (
    "a robot is a tree: remove one of the two joints, the one that nothing drives, and close the "
    "loop by the recipe's `loops` (a `weld` for a fixed joint, a `hinge` for one that turns)"
)


def read_joint(name: str, node: Node, joint_names: set[str], links: Mapping[str, Node]) -> Joint:
    """One joint; its parent and child must be in `links`, a mimicked joint in `joint_names`."""
    if node.get("type") is None:
        raise node.error("<joint> without `type`", f"choose one: {quoted(KINDS, len(KINDS))}")
    kind = node.text("type")
    if kind not in KINDS:
        hint = did_you_mean(kind, KINDS)
        if kind == "spherical":
            hint = (
                "PyBullet's ball joint: URDF has three `revolute` ones with links between instead"
            )
        raise node.error(f"unknown joint type `{kind}`", hint)
    parent, child = (_link(node.need(tag), links) for tag in ("parent", "child"))
    if parent == child:
        raise node.error(f"parent and child are the same link `{child}`")
    brakes, words = node.only("dynamics"), ("damping", "friction")
    damping, friction = (brakes.not_negative(word) if brakes else None for word in words)
    return Joint(
        name=name,
        kind=cast(JointKind, kind),  # checked against KINDS above
        parent=parent,
        child=child,
        X_parent_joint=read_origin(node),
        axis=_read_axis(node, kind),
        limits=_read_limits(node, kind),
        damping=damping,
        friction=friction,
        mimic=_read_mimic(node, name, joint_names),
    )


def build_tree(
    name: str,
    base: Base,
    bodies: list[Body],
    joints: list[Joint],
    nodes: Mapping[str, Node],
) -> Tree:
    """Depth-first tree with one root. nodes: by subject, `link trunk`, for the lines of errors."""
    above: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in above:
            message = f"link `{joint.child}` already hangs on joint `{above[joint.child].name}`"
            raise nodes[f"joint {joint.name}"].error(message, TWO_PARENTS)
        above[joint.child] = joint
    joints = _hold_followers(joints, nodes)
    by_name = {body.name: body for body in bodies}
    root = _root(list(by_name), above, nodes)
    links, ordered = depth_first(root, joints)
    return Tree(name, base, tuple(by_name[link] for link in links), ordered)


def _root(links: list[str], above: Mapping[str, Joint], nodes: Mapping[str, Node]) -> str:
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        message = f"{len(roots)} links have no parent: {quoted(roots, 8)}"
        hint = "connect all but one by a joint, of type `fixed` if they do not move"
        raise nodes[f"link {roots[1]}"].about("").error(message, hint)
    if circle := _circle({link: above[link].parent for link in links if link in above}):
        ring = circle[circle.index(circle[-1]) :][::-1]
        way = " -> ".join(f"`{name}`" for name in ring[:12])
        node = nodes[f"joint {above[ring[0]].name}"]
        raise node.error(f"the joints close a loop: {way}", "a robot is a tree with one root")
    return roots[0]


def _circle(above: Mapping[str, str]) -> list[str]:
    """Return the first way up on which a name comes again; nothing where all ways end."""
    ends = set[str]()
    for start in above:
        way = dict[str, None]()
        name: str | None = start
        while name is not None and name not in ends:
            if name in way:
                return [*way, name]
            way[name] = None
            name = above.get(name)
        ends.update(way)
    return []


def _link(node: Node, links: Mapping[str, Node]) -> str:
    name = node.text("link")
    if name not in links:
        hint = did_you_mean(name, links)
        if name == "world":
            hint = 'add `<link name="world"/>`: Drake alone takes it for granted'
        raise node.error(f"{node.tag} link `{name}` does not exist", hint)
    return name


def _read_axis(node: Node, kind: str) -> Vec3:
    """Unit axis in the joint frame; X where omitted (so says the format)."""
    element = node.only("axis")
    if element is None or kind not in WITH_AXIS:  # exporters like to write one without meaning
        return (1.0, 0.0, 0.0)
    if element.get("xyz") is None:
        hint = (
            'write `xyz="1 0 0"`, which counts where <axis> is absent, or the axis that is meant: '
        )
        hint += "urdfdom reads 0 0 0, yourdfpy 1 0 0, MuJoCo refuses it"
        raise element.error("<axis> without `xyz`", hint)
    axis = vec3(element.numbers("xyz", 3))
    norm = math.sqrt(math.fsum(value * value for value in axis))
    if norm < 1e-9:
        hint = "give the direction that the joint moves about or along"
        raise element.error(f"axis is `{element.get('xyz')}`: it has no direction", hint)
    unit = axis if norm == 1.0 else vec3([value / norm for value in axis])
    if abs(norm - 1.0) > AXIS_TOLERANCE:
        message = f"axis `{element.get('xyz')}` has length {norm:.6g} and was normalised"
        node.report(AXIS_NORMALISED, message, data={"axis": axis, "norm": norm})
    return unit


def _read_limits(node: Node, kind: str) -> Limits:
    element = node.only("limit")
    if kind in ("fixed", "floating", "planar"):
        return Limits()  # no reader looks at it
    if element is None:
        if kind in ("revolute", "prismatic"):
            raise node.error(
                f"a {kind} joint without <limit>",
                "add <limit lower upper effort velocity>"
                + (", or make it `continuous`" if kind == "revolute" else ""),
            )
        return Limits()
    lower, upper = element.optional("lower"), element.optional("upper")
    effort, velocity = element.not_negative("effort"), element.not_negative("velocity")
    stated = {"lower": lower, "upper": upper, "effort": effort, "velocity": velocity}
    if kind == "continuous":
        if lower or upper:
            message = f"a continuous joint has no range; lower {lower}, upper {upper} are not used"
            node.report(LIMIT_IGNORED, message, data={"lower": lower, "upper": upper})
        stated |= {"lower": None, "upper": None}
    else:
        if missing := tuple(name for name, value in stated.items() if value is None):
            zero = [f"`{name}`" for name in missing if name in ("lower", "upper")]
            note = f"; {' and '.join(zero)} count as 0, as the format says" if zero else ""
            message = f"<limit> leaves out {quoted(missing, 4)}{note}"
            node.report(LIMIT_OMITTED, message, data={"missing": missing})
        stated |= {"lower": lower or 0.0, "upper": upper or 0.0}
    free = [name for name, value in stated.items() if abs(value or 0.0) >= URDF_UNLIMITED]
    if free:
        words = quoted(free, 4)
        message = f"<limit> states {URDF_UNLIMITED:g} or more for {words}: it counts as unlimited"
        node.report(LIMIT_UNLIMITED, message, data={"unlimited": tuple(free)})
    return Limits(**(stated | dict.fromkeys(free)))


def _read_mimic(node: Node, name: str, joint_names: set[str]) -> Mimic | None:
    element = node.only("mimic")
    if element is None:
        return None
    leader = element.text("joint")
    if leader not in joint_names:
        near = did_you_mean(leader, joint_names - {name})
        hint = f"{near}; " if near else ""
        hint += "to let the joint move by itself, take the element out in the recipe: `source: "
        hint += "{patches: [{file: URDF, find: '<mimic ...>', replace: '', because: ...}]}`"
        raise element.error(f"mimic joint `{leader}` does not exist", hint)
    if leader == name:
        raise element.error("a joint cannot mimic itself")
    return Mimic(leader, element.number("multiplier", 1.0), element.number("offset", 0.0))


def _hold_followers(joints: list[Joint], nodes: Mapping[str, Node]) -> list[Joint]:
    """Joints that mimic a fixed one, directly or through others, are locked where it puts them.

    So are those that follow by a multiplier of 0, which PhysX does not couple. Circles are refused.
    """
    leader_of = {joint.name: joint.mimic.joint for joint in joints if joint.mimic}
    if circle := _circle(leader_of):
        way = " -> ".join(f"`{name}`" for name in circle)
        raise nodes[f"joint {circle[0]}"].error(f"mimic joints follow one another: {way}")
    ends = (replace(j, mimic=None) if j.kind == "fixed" else j for j in joints)
    chains = Tree("", "fixed", (), tuple(ends))

    def held(joint: Joint) -> Joint:
        leader, multiplier, at = leading(chains, chains.by_joint[joint.name])
        if leader.name == joint.name or (multiplier != 0.0 and leader.kind in MOVING):
            return joint
        node = nodes[f"joint {joint.name}"]
        if multiplier != 0.0 and leader.kind != "fixed":
            message = f"mimic joint `{leader.name}` is {leader.kind}: it has no single position"
            raise node.error(message)
        at += 0.0
        message = f"mimics a joint that is fixed, or with a multiplier of 0: locked at {at:g}"
        node.report(MIMIC_FIXED, message, data={"position": at})
        kind: JointKind = "revolute" if joint.kind == "continuous" else joint.kind
        limits = replace(joint.limits, lower=at, upper=at)
        return replace(joint, kind=kind, mimic=None, limits=limits)

    return [held(joint) for joint in joints]
