"""What a torque at a joint accelerates while all loops of the robot stay closed.

The inertia that a drive feels changes with the pose of a looped mechanism, manyfold near a dead
centre, so gains that suit one pose may not suit another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.closure import close, free_motions
from assetbuild.robot.dynamics import Dynamics, dynamics
from assetbuild.robot.loops import path_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Joint, Loop, Tree
from assetbuild.robot.pose import Array

STEPS = 8
"""Poses that are looked at to either side of the first one."""
REACH = {True: 0.1, False: 1.5}
"""m of a slide, rad of a hinge: no farther from the first pose, within the limits."""


@dataclass(frozen=True)
class Reflected:
    """The least and the most that one joint feels, kg m2 or kg, and its position at each."""

    least: float
    at_least: float
    most: float
    at_most: float


def felt_inertia(loops: Sequence[Loop], robot: Dynamics) -> dict[str, float]:
    """The inertia that each joint feels, kg m2 or kg; infinite where the loops lock the joint."""
    if not loops:
        return robot.effective_inertia
    basis = free_motions(loops, robot.motions)
    compliance: Array = basis @ np.linalg.pinv(basis.T @ robot.mass @ basis, hermitian=True)
    compliance = compliance @ basis.T
    found = {}
    for name in robot.joints:
        column = robot.column(name)
        soft = float(compliance[column, column])
        found[name] = 1.0 / soft if soft > 0.0 else np.inf
    return found


def held_by(
    loops: Sequence[Loop], robot: Dynamics, torque: Mapping[str, float], driven: Sequence[str]
) -> dict[str, float]:
    """Torques of the driven joints that hold what those of all joints hold, N m or N.

    Both do the same work in every motion that keeps the loops closed; the smallest such torques.
    """
    if not loops:
        return dict(torque)
    basis = free_motions(loops, robot.motions)[robot.free :]
    work = basis.T @ np.array([torque.get(name, 0.0) for name in robot.joints])
    rows = basis[[robot.joints.index(name) for name in driven]]
    found = np.linalg.lstsq(rows.T, work, rcond=None)[0]
    return dict(zip(driven, map(float, found), strict=True))


def reflected_range(
    tree: Tree, control: Control, home: Mapping[str, float]
) -> dict[str, Reflected]:
    """Of each driven joint of the loops, while it alone moves away from `home`.

    The undriven joints of the loops follow. The range ends at the joint's limits, and where the
    loops do not close any more. Poses in which they lock the joint are left out.
    """
    armature = {row.joint: row.armature for row in control.actuators}
    driven = {row.joint for row in control.actuators if row.model != "passive"}
    chain = {joint.name: joint for loop in control.loops for joint in path_of(tree, loop)}
    found = {}
    for name in chain.keys() & driven:
        felt = {}
        for pose in poses_along(tree, control, home, chain[name], chain.keys() - driven):
            robot = dynamics(tree, pose, armature)
            here = felt_inertia(control.loops, robot)[name]
            if np.isfinite(here):
                felt[pose[name]] = here
        if not felt:
            continue
        least, most = min(felt, key=felt.__getitem__), max(felt, key=felt.__getitem__)
        found[name] = Reflected(felt[least], least, felt[most], most)
    return dict(sorted(found.items()))


def poses_along(
    tree: Tree, control: Control, home: Mapping[str, float], joint: Joint, free: set[str]
) -> Iterator[dict[str, float]]:
    """Closed ones while one joint moves away from home, the first included; `free` ones follow."""
    first = with_mimics(tree, home)
    yield first
    reach = REACH[joint.kind == "prismatic"]
    lower, upper = joint.limits.lower, joint.limits.upper
    for end in (-reach, reach):
        pose = first
        for step in range(1, STEPS + 1):
            asked = first[joint.name] + end * step / STEPS
            if (lower is not None and asked < lower) or (upper is not None and asked > upper):
                break
            solved = close(tree, control.loops, {**pose, joint.name: asked}, free, 1)
            if not solved.closed:
                break
            pose = dict(solved.positions)
            yield pose
