"""What a recipe says of the MJCF beyond the robot: the solver."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from assetbuild.quantities import Model, Positive

Integrator = Literal["Euler", "RK4", "implicit", "implicitfast"]
Cone = Literal["pyramidal", "elliptic"]


class MjcfOptions(Model):
    """Solver options of the MJCF: the `<option>` of `<robot>.xml`."""

    integrator: Integrator = Field(
        "implicitfast", description="implicitfast integrates gains and damping implicitly"
    )
    cone: Cone | None = Field(
        None, description="without it elliptic for a floating base (feet slip less), else pyramidal"
    )
    impratio: Positive | None = Field(
        None, description="frictional to normal impedance; without it 100 with an elliptic cone"
    )
    solver: Literal["Newton", "CG", "PGS"] = Field("Newton", description="of the constraints")
    iterations: int | None = Field(None, ge=1, le=10_000, description="of the solver, at most")
    ls_iterations: int | None = Field(None, ge=1, le=10_000, description="of its line search")
