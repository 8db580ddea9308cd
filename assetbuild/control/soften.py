"""Limits and couplings as stiff as the recipe's `limits` and `couplings` ask.

The check `full_effort` measures what came of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from assetbuild.robot.model import Control, MjcfOnly, Softness, Tree
from assetbuild.robot.sides import Side, side_of
from assetbuild.robot.softness import (
    CouplingError,
    LimitError,
    soft_couplings,
    soft_limits,
)

PLACES = {"limits": "joint", "couplings": "mimic"}
"""Section of the recipe -> the place of MJCF's own words about the same."""


def softened(
    tree: Tree,
    control: Control,
    sides: Sequence[Side],
    limits: LimitError,
    couplings: CouplingError,
) -> Control:
    """The control with what MuJoCo's default would not hold.

    What an MJCF source says of its constraints stays, unless the recipe states a wish.
    """
    at_limits = _ours(soft_limits(tree, control, limits), control, sides, "limits")
    coupled = _ours(soft_couplings(tree, control, couplings), control, sides, "couplings")
    return replace(control, soft_limits=tuple(at_limits), soft_couplings=tuple(coupled))


def _ours(
    held: Iterable[tuple[str, Softness]], control: Control, sides: Sequence[Side], section: str
) -> Iterator[tuple[str, Softness]]:
    """Without joints whose softness an MJCF source decides."""
    said = {item.owner for item in control.mjcf_only if _says_softness(item, PLACES[section])}
    for joint, soft in held:
        side = side_of(sides, joint)
        ours = not side.from_mjcf or section in side.stated
        if ours and joint not in said:
            yield joint, soft


def _says_softness(item: MjcfOnly, place: str) -> bool:
    return item.place == place and ("solref" in item.element or "solimp" in item.element)
