"""A link of a URDF with two parents: the joint to cut, and the loop that takes its place."""

from __future__ import annotations

from collections.abc import Sequence

from assetbuild.robot.model import Joint
from assetbuild.robot.pose import IDENTITY, Vec3, rpy_of

LOOPS = {"fixed": "weld", "revolute": "hinge", "continuous": "hinge"}
"""Kind of the loop by that of the joint that it stands for."""


def loop_hint(joints: Sequence[Joint], one: Joint, other: Joint) -> str:
    """What to write instead of one of two joints with the same child; driven joints stay.

    Only what hangs on the root by other joints may keep the link: the tree stays in one piece.
    """
    both = [joint for joint in (other, one) if _stays(joints, joint, {one.name, other.name})]
    keep = max(both or [other, one], key=_is_driven)
    cut = other if keep is one else one
    kind = LOOPS.get(cut.kind)
    if kind is None:
        return f"remove `{cut.name}`, and close the loop by the recipe's `loops`"
    X = cut.X_parent_joint
    turn = f", rpy: {_row(rpy_of(X.quat))}" if X.quat != IDENTITY.quat else ""
    end = f"{{link: {cut.parent}, xyz: {_row(X.xyz)}{turn}}}"
    axis = f", axis: {_row(cut.axis)}" if kind == "hinge" else ""
    loop = f"{{name: {cut.name}, kind: {kind}{axis}, a: {end}, b: {{link: {cut.child}}}}}"
    more = "; it holds no limits" if cut.kind == "revolute" else ""
    return f"remove `{cut.name}` and write `loops: [{loop}]`{more}"


def _stays(joints: Sequence[Joint], joint: Joint, cut: set[str]) -> bool:
    """Whether the parent of a joint does not itself hang on the joint's child."""
    above = {j.child: j.parent for j in joints if j.name not in cut}
    link, seen = joint.parent, set[str]()
    while link in above and link not in seen:
        seen.add(link)
        link = above[link]
    return joint.child not in (link, *seen)


def _is_driven(joint: Joint) -> bool:
    return bool(joint.limits.effort)


def _row(values: Vec3) -> str:
    return "[" + ", ".join(f"{value:.9g}" for value in values) + "]"
