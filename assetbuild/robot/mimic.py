"""Mimic joints: their values follow from the joints they mimic."""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.robot.model import Joint, Mimic, Tree


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
    if joint.mimic is None:
        return None
    leader = tree.by_joint[joint.mimic.joint]
    limits = led_range(tree, leader) or (leader.limits.lower, leader.limits.upper)
    if None in limits or (leader.kind == "continuous" and leader.mimic is None):
        return None
    ends = [joint.mimic.offset + joint.mimic.multiplier * v for v in limits if v is not None]
    return min(ends), max(ends)


def _value(tree: Tree, joint: Joint, q: Mapping[str, float], seen: tuple[str, ...]) -> float:
    if joint.mimic is None:
        return float(q.get(joint.name, 0.0))
    if joint.name in seen:
        raise ValueError(f"mimic joints in a circle: {' -> '.join((*seen, joint.name))}")
    leader = _value(tree, tree.by_joint[joint.mimic.joint], q, (*seen, joint.name))
    return joint.mimic.offset + joint.mimic.multiplier * leader


def first_leader(tree: Tree, mimic: Mimic) -> Mimic:
    """The same motion, led by the joint that follows none: Newton takes no chain of mimics."""
    above = tree.by_joint[mimic.joint].mimic
    if above is None:
        return mimic
    offset = mimic.offset + mimic.multiplier * above.offset
    return first_leader(tree, Mimic(above.joint, mimic.multiplier * above.multiplier, offset))
