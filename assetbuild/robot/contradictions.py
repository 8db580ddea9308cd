"""Mass properties that a body's own shapes, or its mirror twin, contradict.

A hollow part, a heavy end and a rounded number are no contradiction. No mass has a moment of
inertia above m r², where r reaches from its centre to its farthest point; and two parts of one
shape on both sides of a robot were built alike. Beyond `FACTOR` of either, one number is wrong.
In public URDFs these are placeholders of 1 kg m² on small links, tensors that lost digits, and one
hand whose links were never weighed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.findings import Finding, Rule
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.inertia import matrix_of, principal_moments
from assetbuild.robot.mimic import without_mimics
from assetbuild.robot.model import Control, Inertial, Joint, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.tree import forward_kinematics
from assetbuild.robot.twins import Part, twins

FACTOR = 3.0
"""From here on a value is contradicted. So much of a body may be undrawn: its reach is then 1.7
times what its shapes show."""
LIKE_VOLUME, LIKE_MOMENT = 1.1, 1.25
"""Largest over smallest, of the hulls of two shapes that count as one."""
NEGLIGIBLE = 0.01
"""Share of the largest moment, or of what a joint turns; smaller ones are noise."""
DENSEST = 25_000.0
"""kg/m3, as `InertiaBounds.density`: the shapes are then no measure of the body, but a marker."""
PLANAR = 1e-3
"""Share of the largest moment by which the sum of the others exceeds it in a thick body."""
SURE = math.log(2.0)
"""One of two twins is blamed if it differs by this much more from an even filling of its shape."""

REACH = Rule(
    "inertia.reach",
    "warning",
    "the inertia is more than three times that of the whole mass at the farthest point of the "
    "body's shapes, so the robot is not ready",
    "`set_inertia`, or `inertia_from_geometry` with the link's `mass`",
    blocks=True,
)
TWIN = Rule(
    "inertia.twin",
    "warning",
    "mass or inertia differ by more than a factor of three from the mirror twin's, which has the "
    "same shape, so the robot is not ready",
    "`set_inertia` of the side that is wrong, to its twin's",
    blocks=True,
)


@dataclass(frozen=True, eq=False)
class Extent:
    """What the shapes of a body occupy. points: (n, 3) m, in its frame, their hull's at least.

    volume_m3, moments_m5: of that hull, filled evenly; (3,) principal, rising, for density 1.
    """

    points: Array
    volume_m3: float
    moments_m5: Array

    def is_like(self, other: Extent) -> bool:
        """Whether the two have one shape, however they are turned or mirrored."""
        volumes = sorted((self.volume_m3, other.volume_m3))
        if not volumes[0] > 0.0 or volumes[1] > LIKE_VOLUME * volumes[0]:
            return False
        return _ratio(self.moments_m5, other.moments_m5) <= LIKE_MOMENT


def contradictions(tree: Tree, extents: Mapping[str, Extent]) -> Iterator[Finding]:
    """`inertia.reach` and `inertia.twin` of all bodies; extents: by body, of those with shapes."""
    for name, factor in beyond_reach(tree, extents).items():
        inertial = tree.by_body[name].inertial
        assert inertial is not None  # noqa: S101 # it has been compared
        reach = reach_of(inertial, extents[name])
        yield REACH(
            f"link {name}",
            f"its inertia is {factor:.3g} times m r² ({inertial.mass_kg:.4g} kg, and the farthest "
            f"point of its shapes is {1e3 * reach:.4g} mm from the centre of mass; limit "
            f"{FACTOR:g}): no mass of this size has it",
            "a placeholder, or other units? edit `inertia_from_geometry` with its `mass`, or "
            "`set_inertia`",
            data={"factor": factor, "reach_m": reach, "limit": FACTOR},
        )
    yield from twins_apart(tree, extents)


# --- its own shapes -----------------------------------------------------------------------------


def beyond_reach(tree: Tree, extents: Mapping[str, Extent]) -> dict[str, float]:
    """Body -> its largest moment over m r², where that exceeds `FACTOR`.

    r: from the centre of mass to the farthest point of its own shapes. Only axes count about which
    the body can turn: the first link of a fixed arm has one, and no motion shows the others. Nor
    does a body count that hardly adds to what its joints turn, such as a tool frame of 1e-8 kg m2.
    """
    ratios, felt = {}, _least_felt(tree)
    for name, axes in _axes(tree).items():
        inertial, extent = tree.by_body[name].inertial, extents.get(name)
        if inertial is None or extent is None or not axes:
            continue
        if inertial.mass_kg > DENSEST * extent.volume_m3:
            continue
        scale = inertial.mass_kg * reach_of(inertial, extent) ** 2
        matrix = matrix_of(inertial.inertia_com_kg_m2)
        one = all(np.linalg.norm(np.cross(axes[0], axis)) < 1e-6 for axis in axes)
        largest = axes[0] @ matrix @ axes[0] if one else np.linalg.eigvalsh(matrix)[-1]
        if 0.0 < FACTOR * scale < largest and largest > NEGLIGIBLE * felt[name]:
            ratios[name] = float(largest) / scale
    return ratios


def _least_felt(tree: Tree) -> dict[str, float]:
    """Body -> the least inertia that one of the coordinates above it turns at 0, kg m2.

    0 where none does; each joint counts with all that it carries, and no mimic adds to it.
    """
    moved = dynamics(without_mimics(tree), {}, {})
    turned = np.diag(moved.mass)
    felt = {tree.root: float(turned[3:6].min()) if moved.free else math.inf}
    for joint in tree.joints:
        inertia = math.inf
        if joint.kind in ("revolute", "continuous"):
            inertia = float(turned[moved.column(joint.name)])
        felt[joint.child] = min(felt[joint.parent], inertia)
    return {name: value if value < math.inf else 0.0 for name, value in felt.items()}


def reach_of(inertial: Inertial, extent: Extent) -> float:
    """Distance from the centre of mass to the farthest point of the shapes, m."""
    return float(np.linalg.norm(extent.points - np.asarray(inertial.com_m), axis=1).max())


def _axes(tree: Tree) -> dict[str, list[Array]]:
    """Body -> unit axes, in its own frame at 0, about which joints turn it; of a free one, all."""
    poses = forward_kinematics(tree, {})
    free = [*np.eye(3)] if tree.base == "floating" else []
    in_root: dict[str, list[Array]] = {tree.root: free}
    for joint in tree.joints:
        axes = _turns(joint, poses[joint.child].rotation)
        in_root[joint.child] = [*in_root[joint.parent], *axes]
    return {name: [poses[name].rotation.T @ axis for axis in axes]
            for name, axes in in_root.items()}  # fmt: skip


def _turns(joint: Joint, rotation: Array) -> list[Array]:
    if joint.kind in ("revolute", "continuous"):
        return [rotation @ np.asarray(joint.axis)]
    return [] if joint.kind in ("fixed", "prismatic") else [*np.eye(3)]


# --- its twin -----------------------------------------------------------------------------------


def twins_apart(tree: Tree, extents: Mapping[str, Extent]) -> Iterator[Finding]:
    """`inertia.twin` of twins of one shape whose masses or principal moments differ too much."""
    beyond = beyond_reach(tree, extents)
    for pair in alike(tree, extents):
        low, high = sorted(part.inertial.mass_kg for part in pair)
        if not low > 0.0:
            continue
        factor = _ratio(*map(_moments, pair))
        if max(high / low, factor) <= FACTOR:
            continue
        blame = [_blame(part, extents.get(part.name), beyond) for part in pair]
        sure = blame[0][:2] != blame[1][:2] or abs(blame[0][2] - blame[1][2]) > SURE
        wrong, right = pair if blame[0] > blame[1] else pair[::-1]
        message = (
            f"its principal moments {_moments_text(wrong)} are {factor:.3g} times or more apart "
            f"from those of its mirror twin `{right.name}`, {_moments_text(right)}"
        )
        if high / low > FACTOR:
            factor = high / low
            message = f"it weighs {wrong.inertial.mass_kg:.4g} kg, "
            message += f"its mirror twin `{right.name}` {right.inertial.mass_kg:.4g} kg"
        doubt = "" if sure else "; the source does not show which of the two is wrong"
        yield TWIN(
            f"link {wrong.name}",
            f"{message}, though both have one shape (limit {FACTOR:g}){doubt}",
            "edit `set_inertia` of the side that is wrong, to its twin's",
            data={"factor": factor, "other": right.name, "limit": FACTOR, "sure": sure},
        )


def _moments_text(part: Part) -> str:
    return f"({', '.join(f'{v:.3g}' for v in _moments(part))}) kg m²"


def alike(tree: Tree, extents: Mapping[str, Extent]) -> Iterator[tuple[Part, Part]]:
    """Left and right parts of one shape, or where neither has a shape."""
    for left, right in twins(tree, Control()).pairs:
        one, other = extents.get(left.name), extents.get(right.name)
        bare = one is None and other is None
        if bare or (one is not None and other is not None and one.is_like(other)):
            yield left, right


def _blame(
    part: Part, extent: Extent | None, beyond: Mapping[str, float]
) -> tuple[bool, bool, float]:
    """What speaks against it: no solid has it, its shapes rule it out, how far it is from them."""
    moments = _moments(part)
    a, b, c = moments
    impossible = bool(a <= 0.0 or a + b <= (1.0 + PLANAR) * c)
    if extent is None or not extent.volume_m3 > 0.0:
        return impossible, part.name in beyond, 0.0
    even = part.inertial.mass_kg * extent.moments_m5 / extent.volume_m3
    off = np.abs(np.log(np.maximum(moments, 1e-30) / even))
    ruled_out = part.name in beyond or part.inertial.mass_kg > DENSEST * extent.volume_m3
    return impossible, ruled_out, float(off.max())


def _moments(part: Part) -> Array:
    """(3,) principal, rising, kg m²."""
    return np.asarray(principal_moments(part.inertial.inertia_com_kg_m2))


def _ratio(one: Array, other: Array) -> float:
    """Largest over smallest of two triples of rising moments, tiny ones left out."""
    least = NEGLIGIBLE * max(one[-1], other[-1])
    if not least > 0.0:
        return 1.0
    low, high = np.maximum(np.minimum(one, other), least), np.maximum(one, other)
    return float((high / low).max())
