"""Forward kinematics of a tree, and joint values with mimic joints filled in."""

from __future__ import annotations

import math
from collections.abc import Mapping

from assetbuild.robot.model import MOVING, Joint, Tree
from assetbuild.robot.pose import IDENTITY, Pose, vec3


def forward_kinematics(tree: Tree, q: Mapping[str, float]) -> dict[str, Pose]:
    """X_root_body of every body, by name, in tree order; the root is the identity.

    q: joint name -> rad or m; joints that are not named are 0. Mimic joints are taken from `q`
    like any other (see `with_mimics`). Joints of more than one coordinate stay at their origin.
    """
    poses = {tree.root: IDENTITY}
    for body in tree.bodies[1:]:
        joint = tree.joint_above[body.name]
        X_parent_child = joint.X_parent_joint @ joint_motion(joint, q.get(joint.name, 0.0))
        poses[body.name] = poses[joint.parent] @ X_parent_child
    return poses


def joint_motion(joint: Joint, value: float) -> Pose:
    """X_joint_child of a joint at `value` rad or m; the identity for joints that do not move."""
    if joint.kind not in MOVING or value == 0.0:
        return IDENTITY
    x, y, z = joint.axis
    if joint.kind == "prismatic":
        return Pose(vec3((x * value, y * value, z * value)))
    c, s = math.cos(value / 2), math.sin(value / 2)
    sign = -1.0 if c < 0.0 else 1.0  # w >= 0, as everywhere
    return Pose(quat=(sign * c, sign * s * x, sign * s * y, sign * s * z))


def with_mimics(tree: Tree, q: Mapping[str, float]) -> dict[str, float]:
    """A value for every moving joint in tree order: `q`, 0 without one; mimic joints follow.

    A mimic joint's own entry in `q` is ignored: q = offset + multiplier * q(joint), chains
    included. Raises ValueError for mimic joints in a circle and KeyError for a leader that is
    not in the tree.
    """
    return {joint.name: _value(tree, joint, q, ()) for joint in tree.moving_joints}


def _value(tree: Tree, joint: Joint, q: Mapping[str, float], seen: tuple[str, ...]) -> float:
    if joint.mimic is None:
        return float(q.get(joint.name, 0.0))
    if joint.name in seen:
        raise ValueError(f"mimic joints in a circle: {' -> '.join((*seen, joint.name))}")
    leader = _value(tree, tree.by_joint[joint.mimic.joint], q, (*seen, joint.name))
    return joint.mimic.offset + joint.mimic.multiplier * leader
