"""Surfaces that touch, and pairs of bodies that never do."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from assetbuild.quantities import Model, NonNegative, Pattern, Positive, Real

_FRICTION = "sliding, torsional (m), rolling (m)"
_CONDIM = "1: no friction, 3: sliding, 4: also torsional, 6: also rolling"
_PRIORITY = "the surface with the higher one decides alone; equal ones are mixed"
_SOLREF = "MuJoCo's softness: time constant (s) and damping ratio; both negative: -N/m, -N s/m"
_SOLIMP = "MuJoCo's impedance: dmin, dmax, width (m), midpoint, power"
_MASK = "MuJoCo's contype: bits; two shapes may touch when one's mask meets the other's partners"


class Surface(Model):
    """What differs on some links; what is not said is as on all others."""

    friction: tuple[NonNegative, NonNegative, NonNegative] | None = Field(
        None, description=_FRICTION
    )
    condim: Literal[1, 3, 4, 6] | None = Field(None, description=_CONDIM)
    priority: int | None = Field(None, ge=0, le=100, description=_PRIORITY)
    solref: tuple[Real, Real] | None = Field(None, description=_SOLREF)
    solimp: tuple[Real, Real, Real, Real, Real] | None = Field(None, description=_SOLIMP)
    margin: NonNegative | None = Field(None, description="contacts exist from this distance, m")
    gap: NonNegative | None = Field(None, description="part of the margin without force, m")
    mask: int | None = Field(None, ge=0, lt=2**31, description=_MASK)
    partners: int | None = Field(None, ge=0, lt=2**31, description="MuJoCo's conaffinity: bits")


class Contact(Model):
    """The surface of all collision geometry."""

    friction: tuple[NonNegative, NonNegative, NonNegative] = Field(
        (1.0, 0.005, 0.0001), description=_FRICTION
    )
    condim: Literal[1, 3, 4, 6] = Field(3, description=_CONDIM)
    priority: int = Field(0, ge=0, le=100, description=_PRIORITY)
    solref: tuple[Real, Real] | None = Field(None, description=_SOLREF)
    solimp: tuple[Real, Real, Real, Real, Real] | None = Field(None, description=_SOLIMP)
    margin: NonNegative = Field(0.0, description="contacts exist from this distance, m")
    gap: NonNegative = Field(0.0, description="part of the margin without force, m")
    mask: int = Field(1, ge=0, lt=2**31, description=_MASK)
    partners: int = Field(1, ge=0, lt=2**31, description="MuJoCo's conaffinity: bits")
    links: dict[Pattern, Surface] = Field(
        default_factory=dict, description="other surfaces; the first pattern that matches wins"
    )

    @model_validator(mode="after")
    def _signs(self) -> Contact:
        for solref in (self.solref, *(surface.solref for surface in self.links.values())):
            if solref is not None and (solref[0] > 0) != (solref[1] > 0):
                raise ValueError("`solref`: both positive, or both negative")
        return self


class Simulation(Model):
    """What the generated files and checks step with."""

    timestep: Positive = Field(0.005, description="s")
    decimation: int = Field(4, ge=1, le=10_000, description="simulation steps per control step")
    gravity: tuple[Real, Real, Real] = Field((0.0, 0.0, -9.81), description="m/s2, world frame")


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
