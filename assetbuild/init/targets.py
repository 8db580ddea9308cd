"""What a robot can become: a target that cannot hold it is left out, with the reason."""

from __future__ import annotations

from collections.abc import Collection

from assetbuild.edits.share_mass import meeting_point
from assetbuild.errors import RecipeError
from assetbuild.init.look import InspectedRobot
from assetbuild.init.words import plain, some
from assetbuild.robot.chains import find_chains, is_massless, weighs


def targets(robot: InspectedRobot, springs: Collection[str] = ()) -> str:
    """The line of the recipe. springs: joints with one that the USD cannot hold."""
    free = next((joint.name for joint in robot.tree.joints if joint.kind == "floating"), None)
    if free is not None:
        reason = f"joint {plain(free)} is floating, which only a base can be in MJCF and USD"
        return f"targets: [urdf]   # {reason}"
    reason = not_in_usd(robot)
    if springs and not reason:
        reason = f"it cannot hold the springs of {some(list(springs))}; see `usd.spring`"
    if reason:
        return f"targets: [urdf, mjcf]   # no usd: {plain(reason, 160)}"
    return "targets: [urdf, mjcf, usd]"


def not_in_usd(robot: InspectedRobot) -> str:
    """Why no articulation of PhysX is this robot, exactly; "" when one is."""
    for joint in robot.tree.joints:
        if joint.kind == "planar":
            return f"joint {joint.name} is planar, which no articulation holds"
    shown = {shape.link for shape in robot.shapes.shapes}
    for chain in find_chains(robot.links, shown):
        # Edits come before merging: an end that fixed joints will give a mass has none to share.
        if is_massless(robot.links.by_body[chain.body]):
            return f"bodies without mass between the joints of {chain.body}"
        for link in chain.between:
            try:
                meeting_point(link, chain.joints[chain.between.index(link) + 1 :])
            except RecipeError as error:
                return f"a body without mass: {error.message.partition(': ')[2]}"
    for body in robot.tree.bodies:
        moves = robot.tree.base == "floating" or body.name != robot.tree.root
        if not moves or not is_massless(body):
            continue
        if weighs(robot.tree, body.name):
            return f"{body.name} has no mass but for the bodies that fixed joints hold to it"
        above = robot.tree.joint_above.get(body.name)
        if above is not None and above.kind == "fixed" and body.name in shown:
            return f"{body.name} has no mass, and is excluded from other pairs than {above.parent}"
    return ""
