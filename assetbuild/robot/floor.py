"""The floor that a robot's scenes stand on: one for all formats."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.pose import Array, Vec3
from assetbuild.robot.tree import forward_kinematics

BELOW_M = 0.01
"""A bolted robot that reaches further below its base (a hand) hangs over the floor, not in it."""


@dataclass(frozen=True)
class Floor:
    """height_m: z in the world; friction: sliding, torsional (m), rolling (m)."""

    height_m: float
    friction: Vec3


def floor_of(tree: Tree, control: Control) -> Floor:
    """The floor has the robot's smallest friction, and engines take the larger of the two surfaces.

    So what the recipe says of a surface is what acts. A surface with a priority decides alone.
    """
    surfaces = [control.contact, *(own for _, own in control.contacts if not own.priority)]
    sliding, torsional, rolling = (
        min(values) for values in zip(*(s.friction for s in surfaces), strict=True)
    )
    height = _height(tree, starting_origins(tree, control))
    return Floor(height, (sliding, torsional, rolling))


def starting_origins(tree: Tree, control: Control) -> Array:
    """(n, 3) world positions of all bodies and frames in the initial pose, m."""
    start = initial_pose(tree, control)
    X_root = forward_kinematics(tree, dict(start.joints))
    points = [X_root[f.body].apply(f.X_body_frame.xyz) for f in tree.frames]
    points += [np.asarray(X.xyz) for X in X_root.values()]
    return tree.root_pose(start).apply(np.array(points))


def _height(tree: Tree, origins: Array) -> float:
    """0, or lower under a bolted robot that reaches below its base, m."""
    lowest = float(origins[:, 2].min())
    if tree.base == "floating" or lowest > -BELOW_M:
        return 0.0
    reach = lowest - math.dist(origins.min(axis=0), origins.max(axis=0)) / 2
    return math.floor(reach * 10) / 10
