"""What a tree's own weight does to its joints in one pose, and in the worst of many."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from assetbuild.init.joint_range import bounds
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.tree import forward_kinematics

GRAVITY = 9.81
SAMPLES = 40
"""Random poses in which the worst load is looked for, besides the pose of zeros."""
SEED = 1


def gravity_loads(
    tree: Tree, pose: Mapping[str, float], joints: Iterable[Joint]
) -> dict[str, float]:
    """What each joint must push to hold all that hangs on it, N m or N; the root stands upright."""
    X_root = forward_kinematics(tree, with_mimics(tree, pose))
    mass: dict[str, float] = {}
    moment: dict[str, Array] = {}
    for body in tree.bodies:
        inertial = body.inertial
        mass[body.name] = inertial.mass_kg if inertial else 0.0
        com = X_root[body.name].apply(inertial.com_m if inertial else (0.0, 0.0, 0.0))
        moment[body.name] = mass[body.name] * np.asarray(com)
    for joint in reversed(tree.joints):  # children come after their parents
        mass[joint.parent] += mass[joint.child]
        moment[joint.parent] = moment[joint.parent] + moment[joint.child]
    found = {}
    for joint in joints:
        X = X_root[joint.child]
        axis = X.rotation @ np.asarray(joint.axis)
        if joint.kind == "prismatic":
            found[joint.name] = abs(mass[joint.child] * GRAVITY * float(axis[2]))
        else:
            arm = moment[joint.child] - mass[joint.child] * np.asarray(X.xyz)
            found[joint.name] = abs(float(axis @ np.cross(arm, (0.0, 0.0, GRAVITY))))
    return found


def worst_loads(tree: Tree) -> dict[str, float]:
    """The largest of `gravity_loads` over the joints' ranges; what mimics a joint loads it too."""
    loads = _sampled_loads(tree)
    return {joint.name: max(load[joint.name] for load in loads) for joint in tree.moving_joints}


def overloaded(tree: Tree) -> dict[str, float]:
    """Share of the random poses that need more than the stated effort, by joint that states one."""
    loads = _sampled_loads(tree)[1:]
    stated = {j.name: j.limits.effort for j in tree.moving_joints if j.limits.effort}
    return {n: sum(load[n] > most for load in loads) / len(loads) for n, most in stated.items()}


def _sampled_loads(tree: Tree) -> list[dict[str, float]]:
    """`gravity_loads` in the pose of zeros and in random ones."""
    joints = tree.moving_joints
    found = []
    for pose in sample_poses(joints, SAMPLES):
        loads = gravity_loads(tree, pose, joints)
        for joint in joints:
            leader, factor = joint, 1.0
            while leader.mimic is not None:
                factor *= abs(leader.mimic.multiplier)
                leader = tree.by_joint[leader.mimic.joint]
            if leader is not joint:
                loads[leader.name] += factor * loads[joint.name]
        found.append(loads)
    return found


def sample_poses(joints: Sequence[Joint], count: int) -> list[dict[str, float]]:
    """The pose of zeros and random ones over the joints' ranges, the same every time."""
    random = np.random.default_rng(SEED)
    free = [joint for joint in joints if joint.mimic is None]
    ends = [bounds(joint) for joint in free]
    low = np.array([max(lower, -math.pi) for lower, _ in ends])
    high = np.array([min(upper, math.pi) for _, upper in ends])
    drawn = low + (high - low) * random.random((count, len(free)))
    names = [joint.name for joint in free]
    zero = np.clip(np.zeros(len(free)), low, high)
    return [dict(zip(names, map(float, row), strict=True)) for row in (zero, *drawn)]
