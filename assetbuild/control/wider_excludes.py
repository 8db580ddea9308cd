"""Excluded pairs of an MJCF whose bodies became one with others that they do not name."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import Shapes

WIDER_EXCLUDE = Rule(
    "mjcf.wider_exclude",
    "warning",
    "the source excludes one of several links that were merged into one body: now it excludes all",
    "`fixed_joints.keep_bodies` keeps a link as a body",
)


def wider_excludes(
    excludes: Collection[tuple[str, str]], tree: Tree, shapes: Shapes
) -> Iterator[Finding]:
    """A finding for each pair of bodies that loses contacts. excludes: pairs of the source's links.

    Bodies that a joint connects never touch in MuJoCo.
    """
    said = {frozenset(pair) for pair in excludes}
    adjacent = {frozenset((joint.parent, joint.child)) for joint in tree.joints}
    solid: dict[str, list[str]] = {}
    for link in dict.fromkeys(shape.link for shape in shapes.of("collision")):
        solid.setdefault(tree.placement(link)[0], []).append(link)
    bodies = (sorted(tree.placement(link)[0] for link in pair) for pair in excludes)
    for a, b in sorted({(a, b) for a, b in bodies if a != b}):
        pairs = [(one, two) for one in solid.get(a, ()) for two in solid.get(b, ())]
        lost = [pair for pair in pairs if frozenset(pair) not in said]
        if not lost or frozenset((a, b)) in adjacent:
            continue
        shown = ", ".join(f"`{one}` and `{two}`" for one, two in lost[:3])
        yield WIDER_EXCLUDE(
            f"pair {a} {b}",
            f"{shown}{', ...' if len(lost) > 3 else ''} touch in the source, and no longer here",
            f"name {lost[0][0]} or {lost[0][1]} in `fixed_joints.keep_bodies`",
            data={"pairs": len(lost)},
        )
