"""Loops as mimic joints, for formats without loops: what follows one driven joint, linearly.

A joint of a loop that one drive moves has a position for each position of the drive. The line is
fitted by least squares over the range of that drive, up to 1.5 rad or 0.1 m from the first pose.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from assetbuild.robot.closure import RANK, constraint_jacobian
from assetbuild.robot.dynamics import motions
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import by_constraint, path_of
from assetbuild.robot.model import Control, Joint, Loop, LoopMimic, Mimic, Tree
from assetbuild.robot.reflected import poses_along

SINGLE = ("revolute", "continuous", "prismatic")


def loop_mimics(tree: Tree, control: Control) -> tuple[tuple[LoopMimic, ...], dict[str, str]]:
    """The mimics of the loops that ask for them; by name of a loop, why it can have none."""
    asked = by_constraint(loop for loop in control.loops if loop.urdf == "mimic")
    found: dict[str, LoopMimic] = {}
    refused: dict[str, str] = {}
    for name, loops in asked.items():
        path = [j for j in tree.joints if any(j in path_of(tree, loop) for loop in loops)]
        made = _of_loop(tree, control, name, loops, path)
        if isinstance(made, str):
            refused[name] = made
        else:
            found = {each.joint: each for each in made} | found
    return tuple(found.values()), refused


def _of_loop(
    tree: Tree, control: Control, name: str, loops: Sequence[Loop], path: Sequence[Joint]
) -> list[LoopMimic] | str:
    """One mimic for each joint of the loop that does not lead, or why there is none."""
    driven = {row.joint for row in control.actuators if row.model != "passive"}
    leaders = sorted({_leader(tree, joint) for joint in path} & driven)
    if odd := [joint for joint in path if joint.kind not in SINGLE]:
        return f"joint `{odd[0].name}` is {odd[0].kind}: `split_joint` makes hinges of it"
    if len(leaders) != 1:
        listed = ", ".join(f"`{leader}`" for leader in leaders) or "none"
        return f"one driven joint must move it, here {listed}"
    (leader,) = leaders
    followers = [j.name for j in path if j.mimic is None and j.name != leader]
    home = dict(initial_pose(tree, control).joints)
    if not _are_led(tree, loops, home, followers):
        return "its other joints can move while the driven one stands still"
    everywhere = {joint.name for loop in control.loops for joint in path_of(tree, loop)}
    poses = list(poses_along(tree, control, home, tree.by_joint[leader], everywhere - driven))
    q = np.array([pose[leader] for pose in poses])
    if np.ptp(q) <= 0.0:
        return f"`{leader}` cannot move from where it starts"
    ends = (float(q.min()), float(q.max()))
    made = []
    for follower in followers:
        asked = np.array([pose[follower] for pose in poses])
        slope, start = (float(c) for c in np.polyfit(q, asked, 1))
        off = float(np.abs(start + slope * q - asked).max())
        made.append(LoopMimic(name, follower, Mimic(leader, slope, start), off, ends))
    return made


def _leader(tree: Tree, joint: Joint) -> str:
    """The joint that a joint follows in the end, itself where it mimics none."""
    while joint.mimic is not None:
        joint = tree.by_joint[joint.mimic.joint]
    return joint.name


def _are_led(
    tree: Tree, loops: Sequence[Loop], home: Mapping[str, float], followers: Collection[str]
) -> bool:
    """Whether the loops hold these joints where all others stand still."""
    moving = motions(tree, home)
    columns = [moving.free + moving.joints.index(name) for name in followers]
    jacobian = constraint_jacobian(loops, moving.bodies)[:, columns]
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    return int((sizes > RANK * max(float(sizes.max(initial=0.0)), 1.0)).sum()) == len(columns)
