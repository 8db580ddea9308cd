"""Kinematic trees: order, motion, and merging what fixed joints hold together."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from assetbuild.errors import did_you_mean
from assetbuild.robot.actuator_table import Key, RowError
from assetbuild.robot.inertia import combine, move_inertial
from assetbuild.robot.model import Body, Frame, Joint, Tree
from assetbuild.robot.pose import IDENTITY, Pose, normalised_quat, vec3

PLACEHOLDER_KG = 1e-5
"""A root link lighter than this only names a place; no simulator can move it."""
TILT = 1e-3
"""Between two upward axes that are one, rad: angles of 3.1416 are rounded."""


@dataclass(frozen=True)
class Merged:
    """How one body came about.

    body: its name. links: the other links it is made of, depth first.
    placeholder: the root link that gave its name and frame away, or "".
    """

    body: str
    links: tuple[str, ...]
    placeholder: str = ""


def depth_first(root: str, joints: Iterable[Joint]) -> tuple[tuple[str, ...], tuple[Joint, ...]]:
    """Links from the root down, children in the order of `joints`, and the joints to match.

    Links that no joint connects to the root are absent.
    """
    below: dict[str, list[Joint]] = defaultdict(list)
    for joint in joints:
        below[joint.parent].append(joint)
    links: list[str] = [root]
    ordered: list[Joint] = []
    stack = below[root][::-1]
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        links.append(joint.child)
        stack += below[joint.child][::-1]
    return tuple(links), tuple(ordered)


def chain_to(tree: Tree, body: str) -> tuple[Joint, ...]:
    """Return the joints from the root down to a body."""
    chain: list[Joint] = []
    while body in tree.joint_above:
        joint = tree.joint_above[body]
        chain.append(joint)
        body = joint.parent
    return tuple(chain[::-1])


def held_by_world(tree: Tree) -> Tree:
    """The tree as a format says it that has no pose of its own for a root: URDF.

    A root that is held away from the origin hangs on a massless link `world`, by a fixed joint;
    every other tree comes back as it is.
    """
    if tree.X_world_root == IDENTITY:
        return tree
    names = link_names(tree)
    world, above = "world", "world_joint"
    while world in names:
        world += "_"
    while above in tree.by_joint:
        above += "_"
    mount = Joint(above, "fixed", world, tree.root, tree.X_world_root)
    bodies, joints = (Body(world), *tree.bodies), (mount, *tree.joints)
    return replace(tree, bodies=bodies, joints=joints, X_world_root=IDENTITY)


def link_names(tree: Tree) -> tuple[str, ...]:
    """Names of the source's links: of the bodies, then of those that are frames now."""
    return (*tree.by_body, *(frame.name for frame in tree.frames))


def link_placement(tree: Tree, link: str, place: str, key: Key) -> tuple[str, Pose]:
    """(body, X_body_link) of a link that the recipe names at `key`; RowError: there is none."""
    try:
        return tree.placement(link)
    except KeyError:
        hint = did_you_mean(link, link_names(tree))
        raise RowError(f"{place}: no link `{link}`", key=key, hint=hint) from None


def joint_motion(joint: Joint, value: float) -> Pose:
    """Pose of the child body in the joint frame at `value` (rad or m).

    Raises ValueError for a joint without exactly one coordinate that is asked to move.
    """
    if value == 0.0:
        return IDENTITY
    x, y, z = joint.axis
    if joint.kind == "prismatic":
        return Pose(vec3((x * value, y * value, z * value)))
    if joint.kind not in ("revolute", "continuous"):
        raise ValueError(f"joint {joint.name} is {joint.kind}: it has no single coordinate")
    s = math.sin(value / 2)
    return Pose((0.0, 0.0, 0.0), normalised_quat((math.cos(value / 2), x * s, y * s, z * s)))


def unit_of(joint: Joint) -> Literal["m", "rad"]:
    """The unit of the joint's coordinate: m for a slide, rad for any other."""
    return "m" if joint.kind == "prismatic" else "rad"


def forward_kinematics(tree: Tree, positions: Mapping[str, float]) -> dict[str, Pose]:
    """X_root_body of every body; positions by joint name, rad or m, 0 where absent.

    Mimic joints move by their own entry, as every other.
    """
    poses = {tree.root: IDENTITY}
    for joint in tree.joints:
        moved = joint.X_parent_joint @ joint_motion(joint, positions.get(joint.name, 0.0))
        poses[joint.child] = poses[joint.parent] @ moved
    return poses


REACH = 100.0
"""rad or m; at 1e6 rad a sine has lost six of its digits."""


def sample_positions(tree: Tree, count: int, seed: int) -> list[dict[str, float]]:
    """`count` random positions of the moving joints, uniform within their limits, rad or m.

    Where a limit is missing or empty: within +-pi rad, +-1 m. Of a range beyond `REACH`, which
    stands for no limit at all, the part within it. Same seed, same numbers.
    """
    random = np.random.default_rng(seed)
    samples = []
    for _ in range(count):
        positions = {}
        for joint in tree.moving_joints:
            lower, upper = joint.limits.lower, joint.limits.upper
            if lower is None or upper is None or not lower < upper:
                upper = 1.0 if joint.kind == "prismatic" else math.pi
                lower = -upper
            elif lower < REACH and upper > -REACH:
                lower, upper = max(lower, -REACH), min(upper, REACH)
            positions[joint.name] = float(random.uniform(lower, upper))
        samples.append(positions)
    return samples


def merge_fixed_joints(
    tree: Tree, merge: bool, keep_bodies: Collection[str], *, keep_root: bool = False
) -> tuple[Tree, tuple[Merged, ...]]:
    """Make one body of all links that fixed joints hold together; nothing is lost.

    A body is named after its topmost link and keeps that link's frame; a root link without mass
    (`PLACEHOLDER_KG`) hands both to the heaviest link merged into it, unless that would move a
    fixed base off the place where the source mounts it, or lay a floating one on its side. The
    other links become frames.
    keep_root: it keeps them, as in MJCF, whose keyframes say where the root's own frame stands.
    keep_bodies: links that stay bodies of their own on their fixed joint. Exact: only poses that
    are not the identity change a number.
    """
    groups = _groups(tree, merge, frozenset(keep_bodies))
    bodies: list[Body] = []
    frames: dict[str, Frame] = {}
    placed: dict[str, tuple[str, Pose]] = {}
    facts: list[Merged] = []
    for members in groups:
        name = members[0] if keep_root else _name_giver(tree, members)
        poses = _poses_from(name, tree, members)
        placed |= {link: (name, poses[link]) for link in members}
        inertials = [
            move_inertial(inertial, poses[link])
            for link in members
            if (inertial := tree.by_body[link].inertial) is not None
        ]
        bodies.append(Body(name, combine(inertials) if inertials else None))
        others = tuple(link for link in members if link != name)
        frames |= {link: Frame(link, name, poses[link]) for link in others}
        if others:
            facts.append(Merged(name, others, members[0] if name != members[0] else ""))
    merged = replace(
        tree,
        bodies=tuple(bodies),
        joints=tuple(_attached(tree, placed)),
        frames=tuple(frames[b.name] for b in tree.bodies if b.name in frames),
    )
    return merged, tuple(facts)


def _groups(tree: Tree, merge: bool, kept: frozenset[str]) -> list[list[str]]:
    """Links that become one body each, the topmost first, groups and members depth first."""
    groups: dict[str, list[str]] = {}
    top: dict[str, str] = {}
    for body in tree.bodies:
        joint = tree.joint_above.get(body.name)
        melts = merge and joint is not None and joint.kind == "fixed" and body.name not in kept
        top[body.name] = top[joint.parent] if melts and joint else body.name
        groups.setdefault(top[body.name], []).append(body.name)
    return list(groups.values())


def _name_giver(tree: Tree, members: list[str]) -> str:
    """The link whose name and frame the body takes."""
    first = members[0]
    inertials = {link: tree.by_body[link].inertial for link in members}
    masses = {link: inertial.mass_kg if inertial else 0.0 for link, inertial in inertials.items()}
    if first != tree.root or masses[first] >= PLACEHOLDER_KG:
        return first
    heaviest = max(members, key=lambda link: masses[link])  # the first of equals
    if masses[heaviest] < PLACEHOLDER_KG:
        return first
    X_first_heaviest = _poses_from(first, tree, members)[heaviest]
    if tree.base == "floating":
        stays = math.dist(X_first_heaviest.rotation[:, 2], (0.0, 0.0, 1.0)) < TILT
    else:
        stays = X_first_heaviest == IDENTITY
    return heaviest if stays else first


def _poses_from(origin: str, tree: Tree, members: list[str]) -> dict[str, Pose]:
    """X_origin_link of every member, composed along the fixed joints that lead there.

    Going from `origin` and not from the root keeps the bits of whatever lies below it.
    """
    beside: dict[str, list[tuple[str, Pose]]] = defaultdict(list)
    for link in members[1:]:
        joint = tree.joint_above[link]
        beside[joint.parent].append((link, joint.X_parent_joint))
        beside[link].append((joint.parent, joint.X_parent_joint.inverse()))
    poses = {origin: IDENTITY}
    stack = [origin]
    while stack:
        link = stack.pop()
        for other, X_link_other in beside[link]:
            if other not in poses:
                poses[other] = poses[link] @ X_link_other
                stack.append(other)
    return poses


def _attached(tree: Tree, placed: Mapping[str, tuple[str, Pose]]) -> Iterator[Joint]:
    """The joints that still connect two bodies, between those that their links became part of."""
    for joint in tree.joints:
        parent, X_body_link = placed[joint.parent]
        if parent != placed[joint.child][0]:
            pose = X_body_link @ joint.X_parent_joint
            yield replace(joint, parent=parent, X_parent_joint=pose)
