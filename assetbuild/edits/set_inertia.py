"""`set_inertia: {link, inertia, mass, com}`: measured mass properties."""

from __future__ import annotations

from pydantic import Field

from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import MassEdit
from assetbuild.recipe_types import Model, Positive, Real
from assetbuild.robot.inertia import Tensor, mass_data
from assetbuild.robot.model import Body, Inertial
from assetbuild.robot.pose import Vec3

SET_INERTIA = Rule("edit.set_inertia", "info", "a link has other mass properties", "nothing")


class Moments(Model):
    """kg m2, about the centre of mass, in the axes of the link, as in a URDF."""

    ixx: Positive = Field(description="kg m2")
    iyy: Positive = Field(description="kg m2")
    izz: Positive = Field(description="kg m2")
    ixy: Real = Field(0.0, description="kg m2")
    ixz: Real = Field(0.0, description="kg m2")
    iyz: Real = Field(0.0, description="kg m2")


class SetInertia(MassEdit):
    """What is not given stays; a link without an inertial needs `mass`."""

    inertia: Moments = Field(description="ixx iyy izz ixy ixz iyz, kg m2, about the centre of mass")
    mass: Positive | None = Field(None, description="kg; without it the mass stays")
    com: tuple[Real, Real, Real] | None = Field(
        None, description="centre of mass in the link, m; without it it stays"
    )

    def change(self, body: Body) -> tuple[Inertial, Finding]:
        """See `LinkEdit`."""
        old = body.inertial or Inertial(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
        mass = old.mass_kg if self.mass is None else self.mass
        if mass <= 0.0:
            raise RecipeError(
                f"set_inertia: link `{body.name}` has no mass", hint="give `mass`, in kg"
            )
        com: Vec3 = old.com_m if self.com is None else self.com
        i = self.inertia
        tensor: Tensor = (i.ixx, i.iyy, i.izz, i.ixy, i.ixz, i.iyz)
        new = Inertial(mass, com, tensor)
        finding = SET_INERTIA(
            f"link {body.name}",
            f"mass {old.mass_kg:.6g} -> {mass:.6g} kg; "
            f"ixx iyy izz {_moments_text(old.inertia_com_kg_m2)} -> {_moments_text(tensor)} kg m2",
            data={
                **mass_data(old, new),
                "stated": ("inertia",) if self.mass is None else ("inertia", "mass"),
            },
        )
        return new, finding


def _moments_text(tensor: Tensor) -> str:
    return " ".join(f"{value:.4g}" for value in tensor[:3])
