"""In which order engines, trainers and motor buses count the joints of a robot."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence

from assetbuild.robot.model import Joint, Tree

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
    counted, order = set(tree.by_joint), list[Joint]()
    waiting = _next(tree, tree.root, counted)[::-1]
    while waiting:
        order.append(waiting.pop())
        waiting += _next(tree, order[-1].child, counted)[::-1]
    moving = {joint.name for joint in tree.moving_joints}
    return tuple(joint.name for joint in order if joint.name in moving)


def breadth_first(tree: Tree, counted: Collection[str] | None = None) -> tuple[str, ...]:
    """The moving joints by their distance from the root, then as their parents, then by name.

    counted: those of a robot in which the others do not move; None = all.
    """
    moving = {joint.name for joint in tree.moving_joints}
    counted = set(tree.by_joint) if counted is None else set(counted)
    order, level = list[str](), [tree.root]
    while level:
        joints = [joint for body in level for joint in _next(tree, body, counted)]
        order += [joint.name for joint in joints if joint.name in moving]
        level = [joint.child for joint in joints]
    return tuple(order)


def _next(tree: Tree, body: str, counted: Collection[str]) -> list[Joint]:
    """The nearest joints below a body that count, as USD's readers sort them."""
    return sorted(_below(tree, body, counted), key=lambda joint: _in_usd(joint.name))


def _below(tree: Tree, body: str, counted: Collection[str]) -> Iterator[Joint]:
    for joint in tree.joints:
        if joint.parent == body:
            yield from [joint] if joint.name in counted else _below(tree, joint.child, counted)


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
