"""A link of a URDF with two parents: the joint to cut, and the loop that takes its place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from assetbuild.robot.loops import LoopFrame, LoopRow
from assetbuild.robot.model import Joint
from assetbuild.robot.pose import IDENTITY, Vec3, rpy_of

_LOOPS: dict[str, Literal["weld", "hinge"]] = {
    "fixed": "weld",
    "revolute": "hinge",
    "continuous": "hinge",
}
"""Kind of the loop by that of the joint that it stands for."""


def to_cut(joints: Sequence[Joint], one: Joint, other: Joint) -> Joint:
    """Which of two joints with the same child becomes a loop; driven joints stay.

    Only what hangs on the root by other joints may keep the link: the tree stays in one piece.
    """
    both = [joint for joint in (other, one) if _stays(joints, joint, {one.name, other.name})]
    keep = max(both or [other, one], key=_is_driven)
    return other if keep is one else one


def loop_of(cut: Joint) -> LoopRow | None:
    """The loop that holds what the joint held, but for its limits; None where none can."""
    kind = _LOOPS.get(cut.kind)
    if kind is None:
        return None
    X = cut.X_parent_joint
    turn = rpy_of(X.quat) if X.quat != IDENTITY.quat else (0.0, 0.0, 0.0)
    return LoopRow(
        name=cut.name,
        kind=kind,
        a=LoopFrame(link=cut.parent, xyz=X.xyz, rpy=turn),
        b=LoopFrame(link=cut.child),
        axis=cut.axis if kind == "hinge" else None,
    )


def loop_hint(joints: Sequence[Joint], one: Joint, other: Joint) -> str:
    """What to write instead of one of two joints with the same child."""
    cut = to_cut(joints, one, other)
    row = loop_of(cut)
    if row is None:
        return f"remove `{cut.name}`, and close the loop by the recipe's `loops`"
    turn = f", rpy: {_row(row.a.rpy)}" if any(row.a.rpy) else ""
    end = f"{{link: {cut.parent}, xyz: {_row(row.a.xyz)}{turn}}}"
    axis = f", axis: {_row(row.axis)}" if row.axis else ""
    loop = f"{{name: {cut.name}, kind: {row.kind}{axis}, a: {end}, b: {{link: {cut.child}}}}}"
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
