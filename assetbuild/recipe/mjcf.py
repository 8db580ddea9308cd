"""What a recipe says about its MJCF files beyond the robot: the solver, and the MJX model."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from assetbuild.quantities import Model, Pattern, Positive

Integrator = Literal["Euler", "RK4", "implicit", "implicitfast"]
Cone = Literal["pyramidal", "elliptic"]


class Mjcf(Model):
    """The `<option>` of `<robot>.xml`."""

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


class Mjx(Model):
    """The model for MJX and mujoco_warp: `<robot>_mjx.xml`."""

    integrator: Literal["Euler", "RK4", "implicitfast"] = Field(
        "implicitfast", description="`implicit` does not run on MJX"
    )
    cone: Cone = Field("pyramidal", description="pyramidal is the faster one there")
    impratio: Positive | None = Field(None, description="frictional to normal impedance")
    solver: Literal["Newton", "CG"] = Field("Newton", description="of the constraints")
    iterations: int = Field(4, ge=1, le=10_000, description="of the solver, at most")
    ls_iterations: int = Field(8, ge=1, le=10_000, description="of its line search")
    self_collision: bool = Field(
        False, description="parts of the robot touch one another; else only the world (masks)"
    )
    condim: Literal[1, 3, 4, 6] | None = Field(
        None,
        description="most dimensions of a contact, 3 = without twisting and rolling friction: on a "
        "pyramidal cone a contact has 10 rows with 6, 4 with 3; without it as in `contact`",
    )
    max_vertices: int = Field(
        64, ge=4, le=1000, description="most vertices of a convex collision mesh; more is an error"
    )
    touching: Pattern = Field(
        ".*", description="links that touch anything; the collision of all others is left out"
    )
