"""The pose in which a robot starts, in every format, trainer and simulator."""

from __future__ import annotations

from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Keyframe, Tree
from assetbuild.robot.tree import bounds


def initial_pose(tree: Tree, control: Control) -> Keyframe:
    """The keyframe `home`, else the first keyframe, else every joint as near to 0 as it may stand.

    0 may lie outside the limits (a dog's knee): PhysX then pushes so hard that all turns to NaN
    within a few steps. Joints that mimic others follow them. Without a keyframe the name is empty
    and the base has no pose.
    """
    if control.initial_keyframe is not None:
        return control.initial_keyframe
    ends = {joint.name: bounds(joint) for joint in tree.moving_joints}
    nearest = {name: min(max(0.0, lower), upper) for name, (lower, upper) in ends.items()}
    return Keyframe("", tuple(with_mimics(tree, nearest).items()))
