"""Links of a URDF that hang on two joints: one of these is taken away and becomes a loop."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from assetbuild.errors import SourceError
from assetbuild.init.patches import patched
from assetbuild.init.source import UrdfSource
from assetbuild.recipe.source import Patch
from assetbuild.robot.model import Joint
from assetbuild.source.urdf.joints import read_joint
from assetbuild.source.urdf.second_parent import loop_of, to_cut
from assetbuild.source.urdf.xml import parse


def cut_loops(source: UrdfSource) -> UrdfSource:
    """The source without the second joints of links, and the loops that stand for them.

    The same source where there is none, where no loop can stand for the joint, where the text does
    not show it plainly, and of a xacro, whose own text says no joints: a build refuses these.
    """
    if source.key != "urdf":
        return source
    with suppress(SourceError):
        return _cut(source)
    return source


def _cut(source: UrdfSource) -> UrdfSource:
    root = parse(source.data, source.shown)
    links = {link.get("name") or "": link for link in root.all("link")}
    nodes = {joint.get("name") or "": joint for joint in root.all("joint")}
    joints = [read_joint(name, node, set(nodes), links)[0] for name, node in nodes.items()]
    text = source.data.decode("utf-8", "replace")
    loops, patches, remarks = list(source.loops), list[Patch](), list(source.remarks)
    while pair := _second_parent(joints):
        cut = to_cut(joints, *pair)
        row, element = loop_of(cut), _element(text, cut.name)
        joints.remove(cut)
        if row is None or element is None or _are_rigid(joints, cut.parent, cut.child):
            return source
        why = f"`{cut.child}` hangs on `{' and `'.join(f'{j.name}`' for j in pair)}"
        because = f"{why}: this one becomes a loop, below"
        patches.append(Patch(file=source.file, find=element, replace="", because=because))
        loops.append(row)
        if cut.kind == "revolute":
            lower, upper = cut.limits.lower, cut.limits.upper
            remarks.append(f"the loop `{cut.name}` does not hold its limits {lower} to {upper}")
    return replace(patched(source, patches), loops=tuple(loops), remarks=tuple(remarks))


def _second_parent(joints: Sequence[Joint]) -> tuple[Joint, Joint] | None:
    """The first joint whose child hangs on another one already, and that other one."""
    above: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in above:
            return joint, above[joint.child]
        above[joint.child] = joint
    return None


def _are_rigid(joints: Sequence[Joint], one: str, other: str) -> bool:
    """Whether fixed joints alone lead from one link to the other: no motion would close a loop."""
    import networkx

    fixed = networkx.Graph((joint.parent, joint.child) for joint in joints if joint.kind == "fixed")
    return one in fixed and other in fixed and networkx.has_path(fixed, one, other)


def _element(text: str, name: str) -> str | None:
    """The text of a joint; None unless it stands there once, apart from comments."""
    pattern = rf"<joint\b(?=[^<>]*\sname\s*=\s*[\"']{re.escape(name)}[\"'])[^<>]*>.*?</joint\s*>"
    found = [each for each in re.findall(pattern, text, re.DOTALL) if "<parent" in each]
    return found[0] if len(found) == 1 and text.count(found[0]) == 1 else None
