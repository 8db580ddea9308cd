"""What a recipe says of the MJCF beyond the robot: the solver."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from assetbuild.recipe_types import Model, Positive

Integrator = Literal["Euler", "RK4", "implicit", "implicitfast"]
Cone = Literal["pyramidal", "elliptic"]


GRAMMARS = (3.11, 4.0)


def _known(value: float) -> float:
    if value not in GRAMMARS:
        raise ValueError("the grammars are those of MuJoCo 3.11 and 4.0")
    return value


class MjcfOptions(Model):
    """Solver options of the MJCF: the `<option>` of `<robot>.xml`, and the words it may have."""

    grammar: Annotated[float, AfterValidator(_known)] = Field(
        3.11,
        json_schema_extra={"enum": list(GRAMMARS)},
        description="version of MuJoCo whose words a source's MJCF may have; 4.0 keeps words that "
        "3.11 and mjlab do not know, which are refused without it",
    )
    integrator: Integrator = Field(
        "implicitfast", description="implicitfast integrates gains and damping implicitly"
    )
    cone: Cone | None = Field(
        None, description="of friction; without it elliptic, with which feet and fingers slip less"
    )
    impratio: Positive | None = Field(
        None, description="frictional to normal impedance; without it 50 with an elliptic cone"
    )
    solver: Literal["Newton", "CG", "PGS"] = Field("Newton", description="of the constraints")
    iterations: int | None = Field(None, ge=1, le=10_000, description="of the solver, at most")
    ls_iterations: int | None = Field(None, ge=1, le=10_000, description="of its line search")
    tolerance: Positive = Field(
        1e-12,
        description="improvement of a step, relative to the robot's mean inertia, at which the "
        "solver stops; with MuJoCo's default of 1e-8, light fingers of a heavy robot let go",
    )
