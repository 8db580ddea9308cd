"""What a recipe says of its own robot, against its source."""

from __future__ import annotations

from assetbuild.recipe.models import Recipe
from assetbuild.robot.sides import Side


def own_side(recipe: Recipe, prefix: str = "") -> Side:
    """Who decides what in the robot of a recipe; prefix: of its names in a composite."""
    exclude, fixed = recipe.collision.exclude, recipe.fixed_joints
    from_mjcf = recipe.source.mjcf is not None
    # An MJCF has pairs of its own.
    own_pairs = from_mjcf and "adjacent" not in exclude.model_fields_set
    return Side(
        prefix=prefix,
        from_mjcf=from_mjcf,
        stated=_stated_keys(recipe) if from_mjcf else (),
        adjacent=exclude.adjacent and not own_pairs,
        keeps=from_mjcf and "merge" not in fixed.model_fields_set,
    )


def _stated_keys(recipe: Recipe) -> tuple[str, ...]:
    """What the recipe itself says of all that an MJCF may say too: `simulation.timestep`."""
    found: list[str] = ["actuators"] if recipe.actuators else []
    for name in ("contact", "simulation", "mjcf"):
        found += [f"{name}.{key}" for key in recipe.stated(name)]
    return tuple(sorted(found))
