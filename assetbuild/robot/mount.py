"""Where a part sits on a robot, and what holds it."""

from __future__ import annotations

from pydantic import Field

from assetbuild.quantities import Model, Positive, Real

Three = tuple[Real, Real, Real]


class At(Model):
    """Where the root of a part sits."""

    link: str = Field(description="link of the base robot")
    xyz: Three = Field((0.0, 0.0, 0.0), description="of the part's root in that link, m")
    rpy: Three = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw in that link, rad")


class Mount(Model):
    """What holds the part: a homogeneous box, fixed to the same link."""

    mass: Positive = Field(description="kg")
    size: tuple[Positive, Positive, Positive] = Field(description="edges, m")
    at: Three = Field(
        (0.0, 0.0, 0.0), description="its centre, from the part's root, m; its axes are the part's"
    )
