"""Joints in a row: massless links between them only let one body turn in several ways.

A URDF says a ball joint as three hinges with two links between them that have no mass and no
shape. MJCF says the same as three joints on one body, exactly; a simulator that needs mass on
every body (PhysX) cannot take the links as they are (see the edit `share_mass`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from assetbuild.grouping import grouped
from assetbuild.robot.model import MOVING, Body, Joint, JointKind, Tree
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3, quat_between, rotation_of, vec3

MAX_DOFS = 6
"""A free body has no more; with more the mass matrix is singular, and MuJoCo refuses."""

_DOFS = {"planar": 3, "ball": 3, **dict.fromkeys(MOVING, 1)}


@dataclass(frozen=True)
class Chain:
    """joints: from the parent body down to `body`; between: the massless links, in that order."""

    joints: tuple[Joint, ...]
    between: tuple[str, ...]

    @property
    def parent(self) -> str:
        """The body above the first joint."""
        return self.joints[0].parent

    @property
    def body(self) -> str:
        """The body that all the joints move."""
        return self.joints[-1].child

    @property
    def pose_in_parent(self) -> Pose:
        """Pose of the body in the parent where every joint is 0."""
        pose = IDENTITY
        for joint in self.joints:
            pose = pose @ joint.X_parent_joint
        return pose

    @property
    def joint_poses(self) -> tuple[Pose, ...]:
        """Pose of each joint's frame in the body where every joint is 0.

        With Y_k = X_{k+1} ... X_n (the body in the frame of joint k), the product of exponentials
        X_1 R_1 ... X_n R_n is X_1 ... X_n times (Y_1^-1 R_1 Y_1) ... (Y_n^-1 R_n Y_n): each joint
        moves the body about an axis that stands at Y_k^-1 in it. Lynch and Park, Modern Robotics,
        4.1.3 (body form).
        """
        poses = [IDENTITY]
        for joint in self.joints[:0:-1]:
            poses.append(poses[-1] @ joint.X_parent_joint.inverse())
        return tuple(reversed(poses))


def axis_in_body(joint: Joint, X_body_joint: Pose) -> Vec3:
    """Unit vector: the joint's axis in the axes of the body."""
    if X_body_joint.quat == IDENTITY.quat:
        return joint.axis
    return vec3(X_body_joint.rotation @ joint.axis)


def find_chains(tree: Tree, shown: Collection[str] = ()) -> tuple[Chain, ...]:
    """Every row of two joints or more with nothing but massless links between them.

    shown: links of the source that carry shapes; a body that shows or hits something is none of
    these, nor one that frames were merged into: they would move with a link that is not there.
    Rows that end in a body without weight, or have more than `MAX_DOFS` degrees of freedom, are
    left as they are: no simulator can move them.
    """
    occupied = {tree.placement(link)[0] for link in shown} | {frame.body for frame in tree.frames}
    below = grouped(tree.joints, lambda joint: joint.parent)

    def passes(body: str) -> bool:
        above, under = tree.joint_above.get(body), below.get(body, [])
        return (
            is_massless(tree.by_body[body])
            and body not in occupied
            and above is not None
            and above.kind in _DOFS
            and len(under) == 1
            and under[0].kind in _DOFS
        )

    chains = []
    for first in tree.joints:
        if passes(first.parent) or not passes(first.child):
            continue
        joints = [first]
        while passes(joints[-1].child):
            joints += below[joints[-1].child]
        if (
            weighs(tree, joints[-1].child)
            and sum(_DOFS[joint.kind] for joint in joints) <= MAX_DOFS
        ):
            chains.append(Chain(tuple(joints), tuple(joint.child for joint in joints[:-1])))
    return tuple(chains)


def joint_rows(tree: Tree, shown: Collection[str]) -> dict[str, Chain]:
    """The joints that move each body but the root, as MJCF has them: mostly a single one.

    shown: as for `find_chains`. The links between the joints of a chain have rows too.
    """
    rows = {joint.child: Chain((joint,), ()) for joint in tree.joints}
    return rows | {chain.body: chain for chain in find_chains(tree, shown)}


def rigid_with(tree: Tree, body: str) -> list[str]:
    """The body and all that fixed joints hold to it."""
    held = [body]
    for name in held:  # grows while it is walked
        held += [j.child for j in tree.joints if j.parent == name and j.kind == "fixed"]
    return held


def weighs(tree: Tree, body: str) -> bool:
    """Whether it has mass, or something that fixed joints hold to it: MuJoCo can move it then."""
    return not all(is_massless(tree.by_body[name]) for name in rigid_with(tree, body))


def is_massless(body: Body) -> bool:
    """No mass and no inertia at all, stated or not."""
    inertial = body.inertial
    return inertial is None or (inertial.mass_kg == 0.0 and not any(inertial.inertia_com_kg_m2))


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ROWS: Mapping[str, tuple[tuple[str, Vec3], ...]] = {
    "planar": (("x", X), ("y", Y), ("yaw", Z)),
    "ball": (("x", X), ("y", Y), ("z", Z)),
    "floating": (("x", X), ("y", Y), ("z", Z), ("yaw", Z), ("pitch", Y), ("roll", X)),
}
"""Kind -> names and axes of the joints that replace it, from the parent to the child."""
_ANGLES = frozenset({"yaw", "pitch", "roll"})


def split(tree: Tree, names: frozenset[str]) -> Tree:
    """The tree with these joints of several coordinates as rows of joints with one each.

    Each keeps its name as the start of theirs. The links between them have no mass, so the motion
    is the same; only the three angles of a ball have a pose (the second at 90 degrees) in which two
    of them turn about one axis.
    """
    joints: list[Joint] = []
    between: dict[str, tuple[str, ...]] = {}
    for joint in tree.joints:
        row = _row(joint) if joint.name in names else (joint,)
        joints += row
        between[joint.child] = tuple(each.child for each in row[:-1])
    bodies: list[Body] = []
    for body in tree.bodies:  # depth first: what lies between stands before the child
        bodies += [*map(Body, between.get(body.name, ())), body]
    return replace(tree, bodies=tuple(bodies), joints=tuple(joints))


def between(joint: Joint) -> tuple[str, ...]:
    """Names of the links that a split puts between the joints."""
    return tuple(each.child for each in _row(joint)[:-1])


def made_links(source: Tree) -> frozenset[str]:
    """Links to which edits give a mass: massless ones, and those that splits would add."""
    split_ones = [joint for joint in source.joints if joint.kind in ROWS]
    added = {name for joint in split_ones for name in between(joint)} - {*source.by_body}
    return frozenset(added | {body.name for body in source.bodies if is_massless(body)})


def angles_of(turn: Quat) -> tuple[float, float, float]:
    """Angles of the three hinges of a ball: R = Rx(a) Ry(b) Rz(c), rad."""
    r = rotation_of(turn)
    x = math.atan2(-r[1, 2], r[2, 2])
    return x, math.atan2(r[0, 2], math.hypot(r[0, 0], r[0, 1])), math.atan2(-r[0, 1], r[0, 0])


def _row(joint: Joint) -> tuple[Joint, ...]:
    """Joints from the parent to the child; a plane's normal is the axis of its joint.

    All stand at the child's frame, so that it stays where it is. Damping and friction are left
    out: they have one unit, and the row has two.
    """
    parts = ROWS[joint.kind]
    turn = Pose(quat=quat_between(Z, joint.axis) if joint.kind == "planar" else IDENTITY.quat)
    made, parent, X_parent = [], joint.parent, joint.X_parent_joint
    for number, (suffix, axis) in enumerate(parts):
        name, is_last = f"{joint.name}_{suffix}", number == len(parts) - 1
        kind: JointKind = "continuous"
        if joint.kind != "ball" and suffix not in _ANGLES:
            kind = "prismatic"
        child = joint.child if is_last else f"{name}_link"
        made.append(Joint(name, kind, parent, child, X_parent, vec3(turn.rotation @ axis)))
        parent, X_parent = child, IDENTITY
    return tuple(made)
