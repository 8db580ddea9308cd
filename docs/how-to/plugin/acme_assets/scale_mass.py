"""`scale_mass: {link, factor}`: a link of the same shape, lighter or heavier."""

from __future__ import annotations

from pydantic import Field

from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import MassEdit
from assetbuild.recipe_types import Positive
from assetbuild.robot.model import Body, Inertial

SCALED = Rule("scale_mass.done", "info", "mass and inertia of a link were scaled", "nothing")


class ScaleMass(MassEdit):
    """Mass and inertia times a factor."""

    factor: Positive = Field(description="of mass and inertia")

    def change(self, body: Body) -> tuple[Inertial, Finding] | None:
        """None: a link without an inertia stays as it is."""
        old = body.inertial
        if old is None:
            return None
        mass = self.factor * old.mass_kg
        xx, yy, zz, xy, xz, yz = (self.factor * value for value in old.inertia_com_kg_m2)
        finding = SCALED(f"link {body.name}", f"mass {old.mass_kg:.4g} -> {mass:.4g} kg")
        return Inertial(mass, old.com_m, (xx, yy, zz, xy, xz, yz)), finding
