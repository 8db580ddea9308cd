"""Which bodies of a robot MuJoCo lets pass through each other by itself, without an `<exclude>`.

MuJoCo takes all bodies that are welded together (no joint between them) for one. Bodies of one such
group never touch; nor do a group and the one that carries it, unless the carrier is welded to the
world or the model disables the flag `filterparent`. An engine without this rule, such as PhysX,
which filters only the two bodies of a joint, needs these pairs written out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

from assetbuild.robot.chains import joint_rows
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Shapes, SourceShapes

WORLD = ""
"""The group of all bodies that fixed joints hold to a fixed base."""


@dataclass(frozen=True)
class ContactFilter:
    """MuJoCo's rule for one robot.

    group: by body, the topmost body of what is welded to it, or `WORLD`. carrier: by group, the
    group that it moves on. filters_parents: False where an MJCF source switches that part off.
    """

    group: Mapping[str, str]
    carrier: Mapping[str, str]
    filters_parents: bool

    @classmethod
    def of(cls, tree: Tree, shapes: Shapes | SourceShapes, control: Control) -> ContactFilter:
        """Rows of joints with massless links between them are joints of one body in MJCF."""
        rows = joint_rows(tree, {shape.link for shape in shapes.shapes})
        group, carrier = {tree.root: WORLD if tree.base == "fixed" else tree.root}, {}
        for joint in tree.joints:  # parents come first
            if joint.kind == "fixed":
                group[joint.child] = group[joint.parent]
            else:
                group[joint.child] = joint.child
                carrier[joint.child] = group[rows[joint.child].parent]
        switched_off = any('filterparent="disable"' in item.element for item in control.mjcf_only)
        return cls(group, carrier, not switched_off)

    def holds_without(self, root: str, a: str, b: str) -> bool:
        """Whether MuJoCo still lets two bodies pass when the floating root is bolted to the world.

        Of a test stand, where a user takes the free joint out.
        """
        base = self.group[root]
        return self.passes(a, b) and (
            self.group[a] == self.group[b] or base not in (self.group[a], self.group[b])
        )

    def passes(self, a: str, b: str) -> bool:
        """Whether MuJoCo lets two bodies pass through each other."""
        one, other = self.group[a], self.group[b]
        if one == other:
            return True
        if not self.filters_parents or WORLD in (one, other):
            return False
        return self.carrier.get(one) == other or self.carrier.get(other) == one


def passing_pairs(
    tree: Tree, shapes: Shapes | SourceShapes, control: Control
) -> Iterator[tuple[str, str]]:
    """Pairs of bodies with collision shapes that MuJoCo lets pass, each sorted by name."""
    rule = ContactFilter.of(tree, shapes, control)
    solid = {tree.placement(shape.link)[0] for shape in shapes.of("collision")}
    yield from (pair for pair in combinations(sorted(solid), 2) if rule.passes(*pair))
