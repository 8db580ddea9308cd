"""In which order engines, trainers and motor buses count the joints of a robot."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace

from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.tree import depth_first as limb_by_limb

BUS = "bus"


def joint_orders(tree: Tree, bus: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Names of the moving joints by who counts them. bus: of the real robot; else as the URDF.

    The URDF and MuJoCo walk down one limb before they begin the next, as the tree is stored. What
    reads USD takes joints that begin at one link by their names: Newton limb by limb, PhysX, and so
    Isaac Lab, first all joints that are equally far from the root.
    """
    stored = tuple(joint.name for joint in tree.moving_joints)
    return {
        "urdf": stored,
        "mujoco": stored,
        "newton": depth_first(tree),
        "isaaclab": breadth_first(tree),
        BUS: tuple(bus) or stored,
    }


def depth_first(tree: Tree) -> tuple[str, ...]:
    """The moving joints limb by limb, those of one link by their names in USD."""
    moving = {joint.name for joint in tree.moving_joints}
    return tuple(joint.name for joint in _walk(tree, tree.by_joint) if joint.name in moving)


def breadth_first(tree: Tree, counted: Collection[str] | None = None) -> tuple[str, ...]:
    """The moving joints by their distance from the root, then as their parents, then by name.

    counted: those of a robot in which the others do not move; None = all.
    """
    moving = {joint.name for joint in tree.moving_joints}
    joints = _walk(tree, tree.by_joint if counted is None else {*counted})
    distance = {tree.root: 0}
    for joint in joints:
        distance[joint.child] = distance[joint.parent] + 1
    by_distance = sorted(joints, key=lambda joint: distance[joint.child])
    return tuple(joint.name for joint in by_distance if joint.name in moving)


def _walk(tree: Tree, counted: Collection[str]) -> tuple[Joint, ...]:
    """The joints that count, limb by limb, as USD's readers sort them; all others are rigid."""
    held_by = {tree.root: tree.root}
    for joint in tree.joints:  # parents come first
        held_by[joint.child] = joint.child if joint.name in counted else held_by[joint.parent]
    joints = [
        replace(joint, parent=held_by[joint.parent])
        for joint in sorted(tree.joints, key=lambda joint: _in_usd(joint.name))
        if joint.name in counted
    ]
    return limb_by_limb(tree.root, joints)[1]


def _in_usd(name: str) -> str:
    """The joint's identifier, but for what keeps two that are alike apart."""
    near = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"_{near}" if near[:1].isdigit() else near


def permutation(names: Sequence[str], of: Sequence[str]) -> tuple[int, ...]:
    """Where each of the names stands in another order.

    >>> values = ("of knee", "of hip")
    >>> [values[place] for place in permutation(("hip", "knee"), of=("knee", "hip"))]
    ['of hip', 'of knee']
    """
    places = {name: place for place, name in enumerate(of)}
    return tuple(places[name] for name in names)
