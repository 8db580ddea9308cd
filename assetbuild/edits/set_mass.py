"""`set_mass: {link, mass}`: another mass, the same shape."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import MassEdit
from assetbuild.recipe_types import Positive
from assetbuild.robot.inertia import Tensor
from assetbuild.robot.model import Body, Inertial

SET_MASS = Rule(
    "edit.set_mass", "info", "a link has another mass; its inertia was scaled, or kept", "nothing"
)


class SetMass(MassEdit):
    """The inertia grows with the mass (same shape, denser), unless `inertia: keep`."""

    mass: Positive = Field(description="kg")
    inertia: Literal["scale", "keep"] = Field(
        "scale", description="scale: in proportion to the mass; keep: as it is"
    )

    def change(self, body: Body) -> tuple[Inertial, Finding]:
        """See `LinkEdit`."""
        before = body.inertial
        if before is None:
            raise RecipeError(
                f"set_mass: link `{body.name}` has no inertial",
                hint="use `inertia_from_geometry` or `set_inertia`",
            )
        scales = self.inertia == "scale" and before.mass_kg > 0.0
        factor = self.mass / before.mass_kg if scales else 1.0
        xx, yy, zz, xy, xz, yz = (factor * value for value in before.inertia_com_kg_m2)
        tensor: Tensor = (xx, yy, zz, xy, xz, yz)
        how = f"its inertia times {factor:.6g}" if scales else "its inertia as it was"
        finding = SET_MASS(
            f"link {body.name}",
            f"mass {before.mass_kg:.6g} -> {self.mass:.6g} kg, {how}",
            data={
                "before_kg": before.mass_kg,
                "after_kg": self.mass,
                "before_kg_m2": before.inertia_com_kg_m2,
                "after_kg_m2": tensor,
                "stated": ("mass",),
            },
        )
        return Inertial(self.mass, before.com_m, tensor), finding
