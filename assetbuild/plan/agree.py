"""Does the recipe fit itself, and does it fit this robot? Errors with their lines."""

from __future__ import annotations

import re
from collections.abc import Collection

from assetbuild.control.control import ControlStep
from assetbuild.errors import RecipeError, did_you_mean
from assetbuild.geometry.jobs import check_files
from assetbuild.kinds import Target
from assetbuild.plan.edits import edits_of
from assetbuild.plugins import plugin_names
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.validation import shown
from assetbuild.robot.actuators import RowError
from assetbuild.robot.model import Tree
from assetbuild.samples.state_ranges import StateRanges


def check_names(loaded: LoadedRecipe) -> None:
    """Plug-in names and cross references inside the recipe."""
    recipe = loaded.recipe
    targets = plugin_names(Target)
    for index, name in enumerate(recipe.targets):
        if name not in targets:
            raise RecipeError(
                f"no target named `{name}`",
                where=loaded.where(("targets", index)),
                hint=did_you_mean(name, targets),
            )
    check_files(loaded, recipe.collision.default, ("collision", "default"))
    for pattern, rule in recipe.collision.links.items():
        check_files(loaded, rule, ("collision", "links", pattern))
    for _, edit, place in edits_of(loaded):
        if recipe.source.mjcf is not None and not edit.follows_names:
            message = f"`{edit.step_name()}` of a robot from MJCF: its sensors, drives and poses "
            hint = "rename and turn joints in the MJCF itself"
            raise loaded.error(place, message + "would not follow", hint)
    stand = recipe.value("validate.stand")
    from_mjcf = recipe.source.mjcf is not None  # which has keyframes of its own
    if stand is not None and stand.keyframe not in recipe.keyframes and not from_mjcf:
        raise loaded.error(
            ("validate", "stand", "keyframe"),
            f"no keyframe `{stand.keyframe}`",
            did_you_mean(stand.keyframe, recipe.keyframes),
        )


def check_against_robot(
    loaded: LoadedRecipe, links: Tree, tree: Tree, control: ControlStep
) -> None:
    """Patterns of the recipe that match nothing of this robot, and the actuator table."""
    recipe, names = loaded.recipe, [body.name for body in links.bodies]
    for pattern in recipe.collision.links:
        _must_match(loaded, ("collision", "links", pattern), pattern, names)
    for pattern in recipe.contact.links:
        _must_match(loaded, ("contact", "links", pattern), pattern, names)
    if recipe.feet is not None:
        _must_match(loaded, ("feet", "links"), recipe.feet.links, names)
    for index, pattern in enumerate(recipe.fixed_joints.keep_bodies):
        _must_match(loaded, ("fixed_joints", "keep_bodies", index), pattern, names)
    try:
        control.check(tree)
        if recipe.randomize is not None:
            StateRanges(robot=recipe.robot, randomize=recipe.randomize).check(tree)
    except RowError as error:
        # In a composite the row of a part has another index than in the part's recipe.
        _, own = loaded.origin(error.key)
        message = error.message.replace(shown(error.key[:2]), shown(own[:2]), 1)
        where = loaded.where(error.key)
        raise RecipeError(message, where=where, hint=error.hint) from None


def turned_meshes(loaded: LoadedRecipe, paths: Collection[str]) -> frozenset[str]:
    """The meshes whose up axis is honoured; a pattern that matches none is an error."""
    found: set[str] = set()
    for index, pattern in enumerate(loaded.recipe.source.honour_up_axis):
        _must_match(loaded, ("source", "honour_up_axis", index), pattern, sorted(paths), "mesh")
        found |= {path for path in paths if re.fullmatch(pattern, path)}
    return frozenset(found)


def _must_match(
    loaded: LoadedRecipe,
    key: tuple[str | int, ...],
    pattern: str,
    names: list[str],
    kind: str = "link",
) -> None:
    if not any(re.fullmatch(pattern, name) for name in names):
        hint = did_you_mean(pattern, names)
        raise loaded.error(key, f"pattern `{pattern}` matches no {kind} of the source", hint)
