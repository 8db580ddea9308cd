"""How far the real robot may be from its description: `randomize` in a recipe."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Annotated, TypeVar

from pydantic import AfterValidator, Field

from assetbuild.recipe_types import Model, NonNegative, Pattern, Positive, Real
from assetbuild.robot.model import Tree

Ranges = TypeVar("Ranges")
Group = tuple[str, Ranges, tuple[str, ...]]
"""A pattern, its ranges, and the names that they are of."""


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError("the first number must not exceed the second")
    return pair


FactorRange = Annotated[tuple[Positive, Positive], AfterValidator(_rising)]
Range = Annotated[tuple[NonNegative, NonNegative], AfterValidator(_rising)]
StepRange = Annotated[
    tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]], AfterValidator(_rising)
]


class RandomMatter(Model):
    """How the matter of a body may differ from the description; draws are uniform."""

    density: FactorRange = Field((0.8, 1.2), description="factor of the mass, shape unchanged")
    com: NonNegative | tuple[NonNegative, NonNegative, NonNegative] = Field(
        0.01, description="largest shift of the matter, m; one number, or one per body axis"
    )
    stretch: Annotated[float, Field(ge=0, le=1)] = Field(
        0.0, description="largest |ln| of the factor by which it is stretched along each axis"
    )
    shear: Annotated[float, Field(ge=0, le=1)] = Field(0.0, description="largest shear, 1")
    source: str = Field("", description="where the range comes from: CAD, datasheet, measured")


class RandomPayload(Model):
    """A homogeneous box that may be mounted."""

    link: str = Field(description="source link that carries it")
    mass: Range = Field(description="least and most, kg")
    size: tuple[Positive, Positive, Positive] = Field(description="edges of the box, m")
    at: tuple[Real, Real, Real] = Field((0.0, 0.0, 0.0), description="its centre on the link, m")
    source: str = Field("", description="where the range comes from")


class RandomJoint(Model):
    """How a joint and its drive may differ; factors of the actuator table's numbers."""

    kp: FactorRange = Field((1.0, 1.0), description="factor")
    kd: FactorRange = Field((1.0, 1.0), description="factor")
    damping: FactorRange = Field((1.0, 1.0), description="factor")
    friction: FactorRange = Field((1.0, 1.0), description="factor, dry friction of the joint")
    armature: FactorRange = Field((1.0, 1.0), description="factor")
    effort: FactorRange = Field((1.0, 1.0), description="factor of the effort limit")
    delay: StepRange = Field((0, 0), description="of the command, simulation steps; for trainers")
    encoder_bias: NonNegative = Field(0.0, description="largest, rad or m; for trainers")
    source: str = Field("", description="where the ranges come from")


class Randomize(Model):
    """What a trainer may vary, so that every variant is a robot that could exist."""

    seed: int = Field(0, ge=0, le=2**63 - 1, description="the same seed draws the same robots")
    links: dict[Pattern, RandomMatter] = Field(
        default_factory=dict, description="bodies by the name of their link; first match wins"
    )
    payloads: tuple[RandomPayload, ...] = Field((), max_length=100, description="boxes to carry")
    joints: dict[Pattern, RandomJoint] = Field(
        default_factory=dict, description="moving joints; the first pattern that matches wins"
    )
    friction: Range | None = Field(
        None, description="sliding friction of all collision geometry, least and most"
    )
    friction_source: str = Field("", description="where that range comes from")
    restitution: Range | None = Field(
        None, description="bounce of all collision geometry; for Isaac Lab, MuJoCo has none"
    )

    def of_bodies(self, tree: Tree) -> list[Group[RandomMatter]]:
        """The ranges of `links`, each with the bodies that have mass and that it is of."""
        return first_match_groups(self.links, [b.name for b in tree.bodies if not b.is_massless])

    def of_joints(self, tree: Tree) -> list[Group[RandomJoint]]:
        """The ranges of `joints`, each with the moving joints that it is of."""
        return first_match_groups(self.joints, [joint.name for joint in tree.moving_joints])


def first_match(table: Mapping[str, Ranges], name: str) -> Ranges | None:
    """What the table says of a name: the first pattern that matches it whole."""
    return next((value for pattern, value in table.items() if re.fullmatch(pattern, name)), None)


def by_joint(table: Ranges | Mapping[str, Ranges], joint: str) -> Ranges | None:
    """What holds for a joint: the same for all, or that of the first pattern that matches."""
    return first_match(table, joint) if isinstance(table, Mapping) else table


def first_match_groups(table: Mapping[str, Ranges], names: Iterable[str]) -> list[Group[Ranges]]:
    """The rows of a table in its order; none without names."""
    left, rows = list(names), []
    for pattern, ranges in table.items():
        matched = tuple(name for name in left if re.fullmatch(pattern, name))
        left = [name for name in left if name not in matched]
        if matched:
            rows.append((pattern, ranges, matched))
    return rows


def per_axis(com: float | tuple[float, float, float]) -> tuple[float, float, float]:
    """`com` of a body, m along each of its axes."""
    return com if isinstance(com, tuple) else (com, com, com)


JOINT_FACTORS = ("kp", "kd", "damping", "friction", "armature", "effort")
"""Keys of `RandomJoint` that are factors of the actuator table's number of the same name."""
