"""A joint of several coordinates as a row of joints with one each, which every format holds.

The links between them have no mass, so the motion is the same; only the three angles of a ball
have a pose (the second at 90 degrees) in which two of them turn about one axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from assetbuild.robot.model import Body, Joint, JointKind, Tree
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3, quat_between, rotation_of, vec3

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ROWS: Mapping[str, tuple[tuple[str, Vec3], ...]] = {
    "planar": (("x", X), ("y", Y), ("yaw", Z)),
    "ball": (("x", X), ("y", Y), ("z", Z)),
    "floating": (("x", X), ("y", Y), ("z", Z), ("yaw", Z), ("pitch", Y), ("roll", X)),
}
"""By kind: what the joints are called and their axes, from the parent to the child."""
_ANGLES = frozenset({"yaw", "pitch", "roll"})


def split(tree: Tree, names: frozenset[str]) -> Tree:
    """The tree with these joints split; each keeps its name as the start of theirs."""
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
    """Names of the links that splits of all joints of several coordinates would add."""
    split_ones = [joint for joint in source.joints if joint.kind in ROWS]
    return frozenset(name for joint in split_ones for name in between(joint)) - {*source.by_body}


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
