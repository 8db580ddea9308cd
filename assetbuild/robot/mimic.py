"""Mimic joints: their values follow from the joints they mimic."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from assetbuild.robot.model import Joint, Tree


def with_mimics(tree: Tree, q: Mapping[str, float]) -> dict[str, float]:
    """A value for every moving joint in tree order: from `q`, else 0; mimic joints follow.

    A mimic joint's own entry in `q` is ignored: q = offset + multiplier * q(joint), chains
    included. Raises ValueError for mimic joints in a circle, KeyError for an unknown leader.
    """
    return {joint.name: _value(tree, joint, q, ()) for joint in tree.moving_joints}


def led_range(tree: Tree, joint: Joint) -> tuple[float, float] | None:
    """(lower, upper) that a mimic joint's leader asks of it, rad or m.

    None = it mimics nothing, or a leader without limits.
    """
    leader, factor, offset = leading(tree, joint)
    if joint.mimic is None or leader.range is None:
        return None
    ends = [offset + factor * end for end in leader.range]
    return min(ends), max(ends)


def leading(tree: Tree, joint: Joint) -> tuple[Joint, float, float]:
    """(leader, multiplier, offset): the joint at the head of its chain, and what it asks of this.

    q(joint) = offset + multiplier * q(leader); the joint itself, 1 and 0 where it mimics nothing.
    """
    if joint.mimic is None:
        return joint, 1.0, 0.0
    leader, factor, offset = leading(tree, tree.by_joint[joint.mimic.joint])
    mimic = joint.mimic
    return leader, mimic.multiplier * factor, mimic.offset + mimic.multiplier * offset


def common_range(tree: Tree, leader: Joint) -> tuple[float, float] | None:
    """(lower, upper) of a leader in which all that follow it stay in their own ranges, rad or m.

    A follower whose two limits are equal states no range. None = the leader has no limits; lower
    is above upper where no position suits all.
    """
    if leader.range is None:
        return None
    lower, upper = leader.range
    for joint in tree.moving_joints:
        own_leader, factor, offset = leading(tree, joint)
        follows = joint.mimic is not None and own_leader.name == leader.name
        if follows and factor != 0.0 and joint.range and not joint.is_locked:
            low, high = sorted((end - offset) / factor for end in joint.range)
            lower, upper = max(lower, low), min(upper, high)
    return lower, upper


def has_range(joint: Joint) -> bool:
    """Whether it states two limits that leave it room."""
    return joint.range is not None and not joint.is_locked


def _value(tree: Tree, joint: Joint, q: Mapping[str, float], seen: tuple[str, ...]) -> float:
    if joint.mimic is None:
        return float(q.get(joint.name, 0.0))
    if joint.name in seen:
        raise ValueError(f"mimic joints in a circle: {' -> '.join((*seen, joint.name))}")
    leader = _value(tree, tree.by_joint[joint.mimic.joint], q, (*seen, joint.name))
    return joint.mimic.offset + joint.mimic.multiplier * leader


def without_mimics(tree: Tree) -> Tree:
    """The tree with every joint free to move by itself, as MuJoCo counts inertia."""
    return replace(tree, joints=tuple(replace(joint, mimic=None) for joint in tree.joints))
