"""What holds parts of the robot together or lets them pass: `<contact>` and `<equality>`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.etree.ElementTree import Element

from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.model import Control, Joint, Tree
from assetbuild.robot.shapes import Shapes
from assetbuild.targets.mjcf.chains import JointPlacement
from assetbuild.targets.mjcf.drives import locked_at
from assetbuild.targets.mjcf.xml import element, number, numbers


def contact_section(
    tree: Tree,
    shapes: Shapes,
    control: Control,
    seats: JointPlacement,
    body_names: Mapping[str, str],
) -> Element:
    """The pairs of the recipe that MuJoCo does not filter itself, with a floating base or pinned.

    MuJoCo filters a body and its parent, unless the parent is part of the world.
    """
    rule = ContactFilter.of(tree, shapes, control)
    pairs = [
        element("exclude", {"body1": body_names[a], "body2": body_names[b]})
        for a, b in control.excludes
        if not {a, b} & seats.hidden  # without shapes, they touch nothing
        and not rule.holds_without(tree.root, a, b)
    ]
    return element("contact", None, pairs)


def equality_section(
    joints: Iterable[Joint], control: Control, sites: Mapping[str, tuple[str, str]]
) -> Element:
    """Mimic joints: q = offset + multiplier * q(leader). Locked ones: q = a constant.

    Loops hold two sites together: of two bodies and one anchor MuJoCo holds what meets at qpos0.
    sites: names by that of the loop.
    """
    held: list[Element] = []
    soft = dict(control.soft_couplings)
    for joint in joints:
        leader, offset, multiplier = None, locked_at(joint), 0.0
        if joint.mimic:
            leader, offset = joint.mimic.joint, joint.mimic.offset
            multiplier = joint.mimic.multiplier
        if offset is not None:
            attributes = {
                "name": joint.name,
                "joint1": joint.name,
                "joint2": leader,
                "polycoef": numbers((offset, multiplier, 0.0, 0.0, 0.0)),
            }
            if joint.name in soft:
                attributes["solref"] = numbers(soft[joint.name].solref)
                attributes["solimp"] = numbers(soft[joint.name].solimp)
            held.append(element("joint", attributes))
    for loop in control.loops:
        is_weld = loop.kind == "weld"
        attributes = {
            "name": loop.name,
            "site1": sites[loop.name][0],
            "site2": sites[loop.name][1],
            "torquescale": number(loop.torque_scale) if is_weld else None,
            "solref": numbers(loop.solref),
            "solimp": numbers(loop.solimp),
        }
        held.append(element(loop.kind, attributes))
    return element("equality", None, held)
