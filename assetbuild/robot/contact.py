"""Surfaces that touch, and pairs of bodies that never do."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from assetbuild.recipe_types import Model, NonNegative, Pattern, Real, unstated


class Contact(Model):
    """A surface. Two shapes may touch when one's contype meets the other's conaffinity."""

    friction: tuple[NonNegative, NonNegative, NonNegative] = Field(
        (1.0, 0.005, 0.0001), description="sliding, torsional (m), rolling (m)"
    )
    condim: Literal[1, 3, 4, 6] = Field(
        3, description="1: no friction, 3: sliding, 4: also torsional, 6: also rolling"
    )
    priority: int = Field(
        0,
        ge=0,
        le=100,
        description="the surface with the higher one decides alone; equal ones are mixed",
    )
    solref: tuple[Real, Real] | None = Field(
        None,
        description="MuJoCo's softness: time constant (s) and damping ratio; both negative: "
        "-N/m, -N s/m",
    )
    solimp: tuple[Real, Real, Real, Real, Real] | None = Field(
        None, description="MuJoCo's impedance: dmin, dmax, width (m), midpoint, power"
    )
    margin: NonNegative = Field(0.0, description="contacts exist from this distance, m")
    gap: NonNegative = Field(0.0, description="part of the margin without force, m")
    contype: int = Field(
        1,
        ge=-(2**31),
        lt=2**31,
        description="MuJoCo's contype: bits (-1: all); two shapes may touch when one's contype "
        "meets the other's conaffinity",
    )
    conaffinity: int = Field(
        1, ge=-(2**31), lt=2**31, description="MuJoCo's conaffinity: bits (-1: all)"
    )

    @model_validator(mode="after")
    def _signs(self) -> Self:
        if self.solref is not None and (self.solref[0] > 0) != (self.solref[1] > 0):
            raise ValueError("`solref`: both positive, or both negative")
        return self

    def meets(self, other: Contact) -> bool:
        """Whether the bits of two surfaces let their shapes touch."""
        return bool(self.contype & other.conaffinity or other.contype & self.conaffinity)


@unstated
class Surface(Contact):
    """What differs on some links; what is not stated is as on all others."""


class Contacts(Contact):
    """The surface of all collision geometry."""

    links: dict[Pattern, Surface] = Field(
        default_factory=dict, description="other surfaces; the first pattern that matches wins"
    )

    @property
    def common(self) -> Contact:
        """The surface of all that no rule of `links` changes."""
        return Contact(**{key: getattr(self, key) for key in Contact.model_fields})


def _two_names(pair: tuple[str, str]) -> tuple[str, str]:
    if pair[0] == pair[1]:
        raise ValueError("a pair needs two different links")
    return pair


LinkPair = Annotated[tuple[str, str], AfterValidator(_two_names)]


class Exclude(Model):
    """Pairs of bodies that never collide."""

    adjacent: bool = Field(True, description="bodies that a joint connects")
    sampled: int = Field(
        0,
        ge=0,
        le=1_000_000,
        description="random poses within the limits; pairs that touch in all or in none of them "
        "are excluded; 0 = do not sample, 10000 is a good number",
    )
    pairs: tuple[LinkPair, ...] = Field((), description="pairs of source links")
