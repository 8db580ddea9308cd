"""Limits and couplings as stiff as the recipe's `limits` and `couplings` ask."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control, MjcfOnly, Softness, Tree
from assetbuild.robot.sides import Side, side_of
from assetbuild.robot.softness import (
    Allowed,
    CouplingError,
    Held,
    LimitError,
    soft_couplings,
    soft_limits,
)

LIMITS_SOFT = Rule(
    "limits.soft",
    "warning",
    "full effort pushes a joint further past its limits in MuJoCo than `limits` allows",
    "state the rotor's inertia (`motors` or `armature`), or a shorter timestep",
)
COUPLINGS_SOFT = Rule(
    "couplings.soft",
    "warning",
    "full effort parts a joint from the one it mimics by more in MuJoCo than `couplings` allows",
    "state the rotor's inertia (`motors` or `armature`), or a shorter timestep",
)
SLACK = 1.01
"""Times the wish; rounding is no finding."""


def softened(
    tree: Tree,
    control: Control,
    sides: Sequence[Side],
    limits: LimitError,
    couplings: CouplingError,
) -> tuple[Control, list[Finding]]:
    """The control with what MuJoCo's default would not hold, and what cannot be held.

    What an MJCF source says of its constraints stays, unless the recipe states a wish.
    """
    at_limits = tuple(_ours(soft_limits(tree, control, limits), control, sides, "limits"))
    coupled = tuple(_ours(soft_couplings(tree, control, couplings), control, sides, "couplings"))
    findings = [
        *_findings(LIMITS_SOFT, "past its limits", tree, at_limits, limits),
        *_findings(COUPLINGS_SOFT, "away from where it is held", tree, coupled, couplings),
    ]
    stiffer = replace(control, soft_limits=_stated(at_limits), soft_couplings=_stated(coupled))
    return stiffer, findings


def _ours(
    held: Iterable[Held], control: Control, sides: Sequence[Side], section: str
) -> Iterator[Held]:
    """Without joints whose softness an MJCF source decides."""
    place = {"limits": "joint", "couplings": "mimic"}[section]
    said = {item.owner for item in control.mjcf_only if _says_softness(item, place)}
    for one in held:
        side = side_of(sides, one.joint)
        if one.joint not in said and (not side.from_mjcf or section in side.stated):
            yield one


def _says_softness(item: MjcfOnly, place: str) -> bool:
    return item.place == place and ("solref" in item.element or "solimp" in item.element)


def _stated(held: Iterable[Held]) -> tuple[tuple[str, Softness], ...]:
    return tuple((one.joint, one.softness) for one in held if one.softness is not None)


def _findings(
    rule: Rule, where: str, tree: Tree, held: Iterable[Held], allowed: Allowed
) -> Iterator[Finding]:
    for one in held:
        joint = tree.by_joint[one.joint]
        most, unit = allowed.of(joint), "m" if joint.kind == "prismatic" else "rad"
        if one.error > SLACK * most:
            yield rule(
                f"joint {one.joint}",
                f"full effort pushes it {one.error:.3g} {unit} {where} (limit {most:g} {unit}): it "
                "moves too little inertia for MuJoCo to hold that effort at this timestep",
                hint="state the rotor's inertia (`motors` or `armature`), or a shorter timestep",
                data={"error": one.error, "allowed": most},
            )
