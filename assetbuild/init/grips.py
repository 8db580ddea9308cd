"""What a recipe says of hands: the contacts of what grips, the cone, and that it is tried."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence

from assetbuild.init.anatomy import Anatomy, roles
from assetbuild.init.look import InspectedRobot
from assetbuild.init.patterns import patterns_of
from assetbuild.init.tune import Tuning
from assetbuild.init.words import quoted
from assetbuild.robot.contact import Contact
from assetbuild.robot.model import Control, Tree

PRESS_S = 0.004
"""Time constant of contacts of what grips, as a Robotiq 2F-85 has it in MuJoCo Menagerie."""
SOFTNESS = ("condim", "priority", "solref", "solimp")


def driven_by(tuning: Tuning | None) -> set[str]:
    """Joints that get a drive of ours."""
    return {name for row in tuning.drives if row.gains for name in row.joints} if tuning else set()


def hand_of(
    robot: InspectedRobot, anatomy: Anatomy, tree: Tree, driven: Collection[str]
) -> list[str]:
    """Links that touch what is held: of driven fingers, of those that follow, and their palms."""
    parts = roles(tree, anatomy)
    fingers = [joint for joint in tree.moving_joints if parts[joint.name] == "finger"]
    if not any(joint.name in driven for joint in fingers):
        return []
    touching = {name for joint in fingers for name in (joint.parent, joint.child)}
    return [body.name for body in robot.links.bodies if body.name in touching]


def pads(robot: InspectedRobot, hand: Sequence[str], timestep: float) -> Iterator[str]:
    """Lines below `contact`."""
    stiff = f"solref: [{max(PRESS_S, 2.0 * timestep):g}, 1], solimp: [0.95, 0.99, 0.001, 0.5, 2]"
    yield "  # What grips gives way by less than with MuJoCo's 0.02 s, and loses nothing."
    yield "  links:"
    for pattern in patterns_of(hand, list(robot.links.by_body)):
        yield f"    {quoted(pattern)}: {{condim: 4, priority: 1, {stiff}}}"


def tried(validation: Iterable[str], hand: Sequence[str]) -> Iterator[str]:
    """The section `validate`, empty or not, and in it that hands hold something."""
    lines, wish, why = [*validation], "grip: {}", "# holds a cube, a cylinder and a sphere"
    yield from lines
    if hand:
        yield f"  {wish}   {why}" if lines else f"validate: {{{wish}}}   {why}"


# --- of an MJCF ---------------------------------------------------------------------------------


def mjcf_hand(
    robot: InspectedRobot, anatomy: Anatomy, control: Control, tuning: Tuning | None
) -> list[str]:
    """The links of the hand, as `hand_of` finds them; a tendon's actuator may drive any joint."""
    driven = {row.joint for row in control.actuators if row.model != "passive"} | driven_by(tuning)
    if any(item.place == "actuator" and not item.owner for item in control.mjcf_only):
        driven = {joint.name for joint in robot.tree.moving_joints}
    return hand_of(robot, anatomy, robot.tree, driven)


def has_pyramid(control: Control) -> bool:
    """Whether the source compiles to MuJoCo's pyramidal cone."""
    options = [item.element for item in control.mjcf_only if item.place == "option"]
    return not any('cone="elliptic"' in option for option in options)


def own_pads(robot: InspectedRobot, hand: Sequence[str], control: Control) -> Iterator[str]:
    """The section `contact`, where no surface of the source says how it gives way."""
    usual, stated = Contact(), [control.contact, *(own for _, own in control.contacts)]
    own = [key for one in stated for key in SOFTNESS if getattr(one, key) != getattr(usual, key)]
    if hand and not own:
        yield "contact:"
        yield from pads(robot, hand, control.simulation.timestep)
