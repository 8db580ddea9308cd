"""What generated files and checks step with."""

from __future__ import annotations

from pydantic import Field

from assetbuild.quantities import Model, Positive, Real


class Simulation(Model):
    """What the generated files and checks step with."""

    timestep: Positive = Field(0.005, description="s")
    decimation: int = Field(4, ge=1, le=10_000, description="simulation steps per control step")
    gravity: tuple[Real, Real, Real] = Field((0.0, 0.0, -9.81), description="m/s2, world frame")
