"""What a recipe says of mass properties, as the steps of this room take it."""

from __future__ import annotations

from assetbuild.body.inertia_rules import Bounds
from assetbuild.recipe.models import Recipe


def bounds_of(recipe: Recipe) -> Bounds:
    """Those of `validate.inertia`."""
    wish = recipe.validate_.inertia
    return Bounds(
        triangle_slack=wish.triangle_slack,
        radius_m=wish.radius,
        density_kg_m3=wish.density,
        small_mass_kg=wish.small_mass,
    )
