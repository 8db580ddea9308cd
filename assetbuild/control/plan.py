"""The step that resolves the recipe's tables on the robot, and who wins: source or recipe."""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.control.control import ControlStep
from assetbuild.control.sample_pairs import SamplePairs
from assetbuild.engine.graph import Node
from assetbuild.engine.planner import Planner
from assetbuild.recipe.models import Recipe
from assetbuild.robot.sides import Side
from assetbuild.source.plan import Reading


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
    keys = ["actuators"] if recipe.actuators else []
    keys += [name for name in ("limits", "couplings") if recipe.states(name)]
    for name in ("contact", "simulation", "mjcf"):
        keys += [f"{name}.{key}" for key in recipe.stated(name)]
    return tuple(sorted(keys))


def control_step(
    recipe: Recipe,
    sides: tuple[Side, ...] = (),
    poses: Mapping[str, Mapping[str, float]] | None = None,
    common_surfaces: tuple[str, ...] = (),
) -> ControlStep:
    """The step with what the recipe says; sides, poses, common_surfaces: of a composite."""
    keys = ControlStep.model_fields.keys() & Recipe.model_fields.keys()
    return ControlStep(
        **{key: getattr(recipe, key) for key in keys},
        rows=recipe.actuators,
        limit_error=recipe.limits,
        coupling_error=recipe.couplings,
        exclude=recipe.collision.exclude,
        sides=sides or (own_side(recipe),),
        poses={name: dict(pose) for name, pose in (poses or {}).items()},
        common_surfaces=common_surfaces,
    )


def control(
    step: ControlStep, read: Reading, tree: Node, assembled: Node, samples: int, p: Planner
) -> Node:
    """`control.json`; samples: random poses in which pairs of bodies are looked at, 0 = none."""
    robot = {
        "tree.json": tree["tree.json"],
        "shapes.json": assembled["shapes.json"],
        "meshes/": assembled["meshes/"],
    }
    inputs = dict(robot)
    if read.control is not None:
        inputs["source_control.json"] = read.control
    if samples:
        pairs = p.add("sample_pairs", SamplePairs(samples=samples), robot)
        inputs["sampled_pairs.json"] = pairs["sampled_pairs.json"]
    return p.add("control", step, inputs)
