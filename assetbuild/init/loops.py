"""Loops that the names of a URDF's frames show: proposed in a comment, for the user to decide.

Exporters that cut a loop leave a frame on both sides of the cut: `closedloop1_A` and `_B`,
`closing_knee_1` and `_2`, `constraint_A`.
"""

from __future__ import annotations

import itertools
import re

from assetbuild.init.draft import Draft, inline
from assetbuild.robot.model import Tree

LOOP = re.compile(r"clos|loop|constraint|fermeture", re.IGNORECASE)
SIDES = ({"A", "B"}, {"a", "b"}, {"1", "2"})


def note_loops(draft: Draft, links: Tree) -> None:
    """A row to uncomment for each pair of frames that are named as the two sides of a cut."""
    names = sorted(body.name for body in links.bodies if LOOP.search(body.name))
    pairs = [pair for pair in itertools.combinations(names, 2) if _are_sides(*pair)]
    if pairs:
        what = "These frames are named as the ends of a cut loop. To close it, state the rows here"
        more = "and `model: passive` for the joints that the loop moves:"
        draft.note(what, more, at=("loops",))
    for one, other in pairs:
        name = re.sub(r"[^A-Za-z0-9_.-]", "_", one)
        row = {"name": name, "kind": "connect", "a": {"link": one}, "b": {"link": other}}
        draft.note(f"- {inline(row)}", at=("loops",))


def _are_sides(one: str, other: str) -> bool:
    """Whether the names differ in their side alone."""
    apart = [{a, b} for a, b in zip(one, other, strict=False) if a != b]
    return len(one) == len(other) and len(apart) == 1 and apart[0] in SIDES
