"""An actuator table from the source's limits, by rules that the recipe states."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.init.anatomy import Leg, chain_to
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.tree import forward_kinematics

FULL_ERROR = {"rad": 0.3, "m": 0.02}
"""Tracking error at which a drive gives all its effort."""
SLOWEST_HZ = 3.0
FASTEST_HZ = 25.0
"""Natural frequency of a drive with the links beyond it: no slower, no faster."""
FASTEST_LEG_HZ = 6.0
"""The same of a standing leg under its share of the robot: stiffer ones bounce."""
DAMPING_RATIO = 0.7
BRAKE_S = 0.05
"""kd is at least kp times this: ten steps of 5 ms, so that light links stay calm."""


@dataclass(frozen=True)
class Row:
    """Joints with the same limits. kp, kd: None for a passive row. inertia: largest, kg m2.

    locked: equal limits hold them, so that a drive could move nothing.
    """

    joints: tuple[str, ...]
    effort: float | None
    velocity: float | None
    unit: str
    inertia: float
    kp: float | None = None
    kd: float | None = None
    locked: bool = False


def drive_rows(tree: Tree, pose: Mapping[str, float], legs: tuple[Leg, ...]) -> tuple[Row, ...]:
    """Joints grouped by kind, effort and velocity, with gains; mimic joints need no row."""
    felt = _felt_inertia(tree, pose)
    carried = _carried(tree, pose, legs)
    groups: dict[tuple[str, float | None, float | None, bool], list[Joint]] = defaultdict(list)
    for joint in tree.moving_joints:
        if joint.mimic is None:
            unit = "m" if joint.kind == "prismatic" else "rad"
            limits = joint.limits
            locked = limits.lower is not None and limits.lower == limits.upper
            effort = None if locked else limits.effort or None
            groups[unit, effort, limits.velocity or None, locked].append(joint)
    rows = []
    for (unit, effort, velocity, locked), joints in groups.items():
        names = tuple(joint.name for joint in joints)
        inertia = max(felt[name] for name in names)
        load = max(carried.get(name, 0.0) for name in names)
        kp, kd = _gains(effort, unit, inertia, load) if effort is not None else (None, None)
        rows.append(Row(names, effort, velocity, unit, inertia, kp, kd, locked))
    return tuple(rows)


def _gains(effort: float, unit: str, inertia: float, load: float) -> tuple[float, float]:
    """(kp, kd): full effort at `FULL_ERROR`, within the two natural frequencies.

    inertia: of the links beyond the joint; load: of what it carries as part of a standing leg.
    """
    slow = inertia * (2 * math.pi * SLOWEST_HZ) ** 2
    fast = max(inertia * FASTEST_HZ**2, load * FASTEST_LEG_HZ**2) * (2 * math.pi) ** 2
    kp = min(max(effort / FULL_ERROR[unit], slow), fast) if fast > 0.0 else effort
    brake = BRAKE_S * kp
    if load > 0.0:  # a light robot on stiff dampers hops
        brake = min(brake, 2 * DAMPING_RATIO * math.sqrt(kp * load))
    kd = max(brake, 2 * DAMPING_RATIO * math.sqrt(kp * inertia))
    return _rounded(kp), _rounded(kd)


def _rounded(value: float) -> float:
    """Two digits: more would pretend to know."""
    return float(f"{value:.2g}")


def _felt_inertia(tree: Tree, pose: Mapping[str, float]) -> dict[str, float]:
    """Inertia of all links beyond each joint, about its axis at the pose, kg m2 or kg."""
    X_root = forward_kinematics(tree, pose)
    felt: dict[str, float] = defaultdict(float)
    for body in tree.bodies:
        if body.inertial is None:
            continue
        X = X_root[body.name]
        com = X.apply(body.inertial.com_m)
        tensor = X.rotation @ matrix_of(body.inertial.inertia_com_kg_m2) @ X.rotation.T
        for joint in chain_to(tree, body.name):
            if joint.kind == "fixed":
                continue
            X_joint = X_root[joint.child]
            axis = X_joint.rotation @ np.asarray(joint.axis)
            if joint.kind == "prismatic":
                felt[joint.name] += body.inertial.mass_kg
                continue
            arm = np.cross(axis, com - np.asarray(X_joint.xyz))
            felt[joint.name] += float(axis @ tensor @ axis + body.inertial.mass_kg * (arm @ arm))
    return {joint.name: max(felt[joint.name], 0.0) for joint in tree.moving_joints}


def _carried(tree: Tree, pose: Mapping[str, float], legs: tuple[Leg, ...]) -> dict[str, float]:
    """What a standing leg's joints move: each leg's share of the robot, on a leg's length."""
    if not legs:
        return {}
    mass = sum(body.inertial.mass_kg for body in tree.bodies if body.inertial)
    X_root = forward_kinematics(tree, pose)
    found: dict[str, float] = {}
    for leg in legs:
        body, X_body_foot = tree.placement(leg.foot)
        foot = X_root[body].apply(X_body_foot.xyz)
        hip = np.asarray(X_root[leg.joints[0].child].xyz)
        length = float(np.linalg.norm(hip - foot))
        found |= {joint.name: mass / len(legs) * length**2 for joint in leg.joints}
    return found
