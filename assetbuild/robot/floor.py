"""The floor that a robot's scenes stand on: one for all formats."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.pose import Array, Vec3
from assetbuild.robot.tree import forward_kinematics

BELOW_M, ORIGINS_M = 0.005, 0.01
"""A fixed robot whose shapes or whose frames reach further below z = 0 (a hand) hangs over the
floor, not in it."""
MARGIN_M = 0.01
"""Least height of a hanging robot's shapes over the floor."""
_PLANE = re.compile(r"""<geom\b[^>]*\btype="plane\"""")


@dataclass(frozen=True)
class Floor:
    """height_m: z in the world; friction: sliding, torsional (m), rolling (m)."""

    height_m: float
    friction: Vec3


def floor_of(tree: Tree, control: Control) -> Floor:
    """The floor has the robot's smallest friction, and engines take the larger of the two surfaces.

    So what the recipe says of a surface is what acts. A surface with a priority decides alone.
    """
    surfaces = [
        control.contact,
        *(surface for _, surface in control.contacts if not surface.priority),
    ]
    sliding, torsional, rolling = (
        min(values) for values in zip(*(s.friction for s in surfaces), strict=True)
    )
    height = _height(tree, starting_origins(tree, control), control.reach_m)
    return Floor(height, (sliding, torsional, rolling))


def starting_origins(tree: Tree, control: Control) -> Array:
    """(n, 3) world positions of all bodies and frames in the initial pose, m."""
    start = initial_pose(tree, control)
    X_root = forward_kinematics(tree, dict(start.joints))
    points = [X_root[f.body].apply(f.X_body_frame.xyz) for f in tree.frames]
    points += [np.asarray(X.xyz) for X in X_root.values()]
    return tree.root_pose(start).apply(np.array(points))


def _height(tree: Tree, origins: Array, reach_m: float) -> float:
    """0, or lower under a fixed robot that reaches below z = 0, m."""
    lowest = float(origins[:, 2].min())
    if tree.base == "floating" or (lowest > -ORIGINS_M and reach_m <= BELOW_M):
        return 0.0
    below = lowest - math.dist(origins.min(axis=0), origins.max(axis=0)) / 2
    return math.floor(min(below, -reach_m - MARGIN_M) * 10) / 10


def brings_floor(tree: Tree, control: Control) -> bool:
    """Whether the robot, joined to the world of its source, brings a plane from there."""
    root = tree.bodies[0].name
    return tree.base == "fixed" and any(
        item.place == "body" and item.owner in ("", root) and _PLANE.match(item.element)
        for item in control.mjcf_only
    )
