"""A pose that the drives can hold: an arm too heavy to stay stretched is turned until it is not."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np

from assetbuild.init.anatomy import chain_to
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.tree import forward_kinematics

GRAVITY = 9.81
HOLDS = 0.8
"""Share of the effort limit above which a drive is said to hold its pose badly."""
STEPS = 48
"""Positions of a joint that are tried, over its range."""


def held_pose(tree: Tree, pose: Mapping[str, float], legged: Collection[str]) -> dict[str, float]:
    """The pose with hinges turned, from the root outwards, that gravity would overcome.

    Each as little as brings it and those beyond below `HOLDS`; where nothing does, to the best.
    pose: of every joint that mimics none, rad or m; legged: joints of legs, which stand. The root
    is taken as level.
    """
    found = dict(pose)
    shares = _shares(tree, found)
    for joint in tree.moving_joints:
        is_hinge = joint.kind in ("revolute", "continuous")
        if joint.name not in found or joint.name in legged or not is_hinge:
            continue
        if shares.get(joint.name, 0.0) > HOLDS:
            found[joint.name] = _turned(tree, found, joint)
            shares = _shares(tree, found)
    return found


def _turned(tree: Tree, pose: Mapping[str, float], joint: Joint) -> float:
    """The nearest position of the joint in which it and those beyond hold, else the best."""
    beyond = {j.name for body in tree.bodies if joint in (way := chain_to(tree, body.name))
              for j in way[way.index(joint) :]}  # fmt: skip

    def worst(value: float) -> float:
        shares = _shares(tree, {**pose, joint.name: value})
        return max(share for name, share in shares.items() if name in beyond)

    best, least = pose[joint.name], worst(pose[joint.name])
    for value in _nearest_first(joint, best):
        share = worst(value)
        if share < least:
            best, least = value, share
        if least <= HOLDS:
            break
    return best


def _nearest_first(joint: Joint, start: float) -> list[float]:
    """Positions over the range, rad; of two at the same distance the lower."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous" or lower is None or upper is None:
        lower, upper = -math.pi, math.pi
    values = [round(float(v), 3) for v in np.linspace(lower, upper, STEPS)[1:-1]]
    return sorted(values, key=lambda value: (abs(value - start), value))


def _shares(tree: Tree, pose: Mapping[str, float]) -> dict[str, float]:
    """Of each driven hinge: the torque of gravity on all beyond it, over its effort limit."""
    X_root = forward_kinematics(tree, pose)
    torques = {joint.name: 0.0 for joint in tree.moving_joints if joint.limits.effort}
    for body in tree.bodies:
        if body.inertial is None:
            continue
        weight = np.array([0.0, 0.0, -GRAVITY * body.inertial.mass_kg])
        com = X_root[body.name].apply(body.inertial.com_m)
        for joint in chain_to(tree, body.name):
            if joint.name in torques and joint.kind in ("revolute", "continuous"):
                X_joint = X_root[joint.child]
                axis = X_joint.rotation @ np.asarray(joint.axis)
                moment = np.cross(com - np.asarray(X_joint.xyz), weight)
                torques[joint.name] += float(axis @ moment)
    efforts = {joint.name: joint.limits.effort or math.inf for joint in tree.moving_joints}
    return {name: abs(torque) / efforts[name] for name, torque in torques.items()}
