"""What a robot can become: a target that cannot hold it is left out, with the reason."""

from __future__ import annotations

from collections.abc import Collection

from assetbuild.init.look import InspectedRobot
from assetbuild.init.words import plain, some
from assetbuild.robot.chains import is_massless, weighs

MERGED = "`fixed_joints: {merge: true}`, and the edit `share_mass` for links without mass above it"


def targets(
    robot: InspectedRobot, springs: Collection[str] = (), motion: Collection[str] = ()
) -> str:
    """The line of the recipe.

    springs: joints with one that the USD cannot hold; motion: what else it cannot, in words.
    """
    free = next((joint.name for joint in robot.tree.joints if joint.kind == "floating"), None)
    if free is not None:
        reason = f"joint {plain(free)} is floating, which only a base can be in MJCF and USD; "
        reason += "the edit `split_joint` makes six joints of it"
        return f"targets: [urdf]   # {reason}"
    ball = next((joint.name for joint in robot.tree.joints if joint.kind == "ball"), None)
    if ball is not None:
        reason = f"joint {plain(ball)} is a ball, which MJCF alone has here"
        hint = "the edit `split_joint` makes three hinges of it, if it never turns to 90 degrees"
        return f"targets: [mjcf]   # {reason}; {hint}"
    reason = not_in_usd(robot)
    if springs and not reason:
        reason = f"it cannot hold the springs of {some(list(springs))}; see `usd.spring`"
    if motion and not reason:
        reason = f"it cannot hold {next(iter(motion))}; see `usd.motion`"
    if reason:
        return f"targets: [urdf, mjcf]   # no usd: {plain(reason, 160)}"
    return "targets: [urdf, mjcf, usd]"


def not_in_usd(robot: InspectedRobot) -> str:
    """Why no articulation of PhysX is this robot, exactly; "" when one is."""
    shown = {shape.link for shape in robot.shapes.shapes}
    for name in carried(robot):
        return f"{name} has no mass but for the bodies that fixed joints hold to it; {MERGED}"
    for body in robot.tree.bodies:
        above = robot.tree.joint_above.get(body.name)
        if above is None or above.kind != "fixed":
            continue
        if is_massless(body) and body.name in shown:
            return f"{body.name} has no mass, and is excluded from other pairs than {above.parent}"
    return ""


def carried(robot: InspectedRobot) -> list[str]:
    """Moving bodies without mass, to which fixed joints hold bodies that have some."""
    tree = robot.tree
    return [
        body.name
        for body in tree.bodies
        if (tree.base == "floating" or body.name != tree.root)
        and is_massless(body)
        and weighs(tree, body.name)
    ]
