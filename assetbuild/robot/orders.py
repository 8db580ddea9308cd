"""In which order engines, trainers and motor buses count the joints of a robot."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from assetbuild.robot.model import Joint, Tree

DEPTH_FIRST = ("urdf", "mujoco", "newton")
"""They walk down one limb before they begin the next, as the tree itself is stored."""
BREADTH_FIRST = ("isaaclab",)
"""It takes all joints that are equally far from the root, then those one further."""
BUS = "bus"


def joint_orders(tree: Tree, bus: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Names of the moving joints by who counts them. bus: of the real robot; else as the URDF."""
    deep = tuple(joint.name for joint in tree.moving_joints)
    orders = dict.fromkeys(DEPTH_FIRST, deep) | dict.fromkeys(BREADTH_FIRST, breadth_first(tree))
    return orders | {BUS: tuple(bus) or deep}


def breadth_first(tree: Tree, counted: Collection[str] | None = None) -> tuple[str, ...]:
    """The moving joints by their distance from the root, then as their parents, then as stored.

    counted: those of a robot in which the others do not move; None = all.
    """
    moving = {joint.name for joint in tree.moving_joints}
    counted = set(tree.by_joint) if counted is None else set(counted)
    found, level = list[str](), [tree.root]
    while level:
        joints = [joint for body in level for joint in _next(tree, body, counted)]
        found += [joint.name for joint in joints if joint.name in moving]
        level = [joint.child for joint in joints]
    return tuple(found)


def _next(tree: Tree, body: str, counted: Collection[str]) -> Iterator[Joint]:
    """The nearest joints below a body that count."""
    for joint in tree.joints:
        if joint.parent == body:
            yield from [joint] if joint.name in counted else _next(tree, joint.child, counted)


def permutation(names: Sequence[str], of: Sequence[str]) -> tuple[int, ...]:
    """Where each of the names stands in another order: `[values[i] for i in permutation]`."""
    places = {name: place for place, name in enumerate(of)}
    return tuple(places[name] for name in names)
