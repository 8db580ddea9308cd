"""A floating joint below an empty root, as `world`, is a floating base in other words."""

from __future__ import annotations

import re
from dataclasses import replace

from assetbuild.init.anatomy import Anatomy
from assetbuild.init.look import InspectedRobot
from assetbuild.init.source import UrdfSource
from assetbuild.recipe.source import Patch


def without_empty_root(source: UrdfSource, robot: InspectedRobot) -> tuple[UrdfSource, str]:
    """The source behind patches that remove such a root, and the joint's name; "" for none.

    Only a URDF that spells link and joint once each, since a xacro computes its text.
    """
    joint, root = _floating_joint(robot) if source.key == "urdf" else ("", "")
    if not joint:
        return source, ""
    because = f"the joint `{joint}` lets the robot float: `base: floating` says so to every format"
    patches = []
    for tag, name in (("joint", joint), ("link", root)):
        passage = _passage(source, tag, name)
        if passage is None:
            return source, ""
        patches.append(Patch(file=source.file, find=passage, replace="", because=because))
    data = source.data
    for patch in patches:
        data = data.replace(str(patch.find).encode(), b"")
    return replace(source, data=data, patches=(*source.patches, *patches)), joint


def floating(anatomy: Anatomy, joint: str) -> Anatomy:
    """The same robot, which floats because its source says so."""
    if not joint:
        return anatomy
    reason = f"the source's joint {joint} lets it float"
    return replace(anatomy, base="floating", base_reason=reason)


def _floating_joint(robot: InspectedRobot) -> tuple[str, str]:
    """(joint, root) of the one joint below an empty root, where that joint floats."""
    links = robot.links
    below = [joint for joint in links.joints if joint.parent == links.root]
    shaped = {shape.link for shape in robot.shapes.shapes}
    empty = links.by_body[links.root].inertial is None and links.root not in shaped
    if empty and len(below) == 1 and below[0].kind == "floating":
        return below[0].name, links.root
    return "", ""


def _passage(source: UrdfSource, tag: str, name: str) -> str | None:
    """The text of an element, where it stands exactly once."""
    text = source.data.decode("utf-8", "replace")
    opening = rf'<{tag}\b[^<>]*\bname\s*=\s*["\']{re.escape(name)}["\'][^<>]*'
    found = re.findall(rf"{opening}/>|{opening}(?<!/)>.*?</{tag}\s*>", text, re.DOTALL)
    return found[0] if len(found) == 1 and text.count(found[0]) == 1 else None
