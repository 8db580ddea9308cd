"""Does the recipe fit itself, and does it fit this robot? Errors with their lines."""

from __future__ import annotations

import re
from collections.abc import Collection

from assetbuild.compose.plan import check_parts
from assetbuild.control.control import ControlStep
from assetbuild.errors import AssetBuildError, Gather, RecipeError, did_you_mean
from assetbuild.geometry.jobs import check_files
from assetbuild.plan.edits import edits_of
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.validation import shown
from assetbuild.robot.actuators import RowError
from assetbuild.robot.model import Tree
from assetbuild.samples.state_ranges import StateRanges


def check_names(*recipes: LoadedRecipe) -> None:
    """Files and cross references inside of recipes: their parts, and their variants if given."""
    wrong = Gather(RecipeError)
    for loaded in recipes:
        for each in (loaded, *loaded.parts):
            _check_pieces(each, wrong)
            with wrong:
                _check_edits(each)
            with wrong:
                _check_stand(each)
        with wrong:
            check_parts(loaded)
    wrong.stop()


def _check_pieces(loaded: LoadedRecipe, wrong: Gather) -> None:
    collision = loaded.recipe.collision
    with wrong:
        check_files(loaded, collision.default, ("collision", "default"))
    for pattern, rule in collision.links.items():
        with wrong:
            check_files(loaded, rule, ("collision", "links", pattern))


def _check_edits(loaded: LoadedRecipe) -> None:
    for _, edit, place in edits_of(loaded):
        if loaded.recipe.source.mjcf is not None and not edit.follows_names:
            message = f"`{edit.step_name()}` of a robot from MJCF: its sensors, drives and poses "
            hint = "rename and turn joints in the MJCF itself"
            raise loaded.error(place, message + "would not follow", hint)


def _check_stand(loaded: LoadedRecipe) -> None:
    recipe = loaded.recipe
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
    patterns: list[tuple[tuple[str | int, ...], str]] = [
        *((("collision", "links", pattern), pattern) for pattern in recipe.collision.links),
        *((("contact", "links", pattern), pattern) for pattern in recipe.contact.links),
    ]
    if recipe.feet is not None:
        patterns.append((("feet", "links"), recipe.feet.links))
    kept = recipe.fixed_joints.keep_bodies
    patterns += [(("fixed_joints", "keep_bodies", i), pattern) for i, pattern in enumerate(kept)]
    wrong, rows = Gather(RecipeError), Gather(RowError)
    for key, pattern in patterns:
        with wrong:
            _must_match(loaded, key, pattern, names)
    with rows:
        control.check(tree)
    if recipe.randomize is not None:
        with rows:
            StateRanges(robot=recipe.robot, randomize=recipe.randomize).check(tree)
    for error in rows.found:
        with wrong:
            raise _placed(loaded, error)
    wrong.stop()


def _placed(loaded: LoadedRecipe, error: AssetBuildError) -> RecipeError:
    """A RowError with its line. The row of a part has another index in the part's recipe."""
    assert isinstance(error, RowError)  # noqa: S101 # that is what is gathered
    _, own = loaded.origin(error.key)
    message = error.message.replace(shown(error.key[:2]), shown(own[:2]), 1)
    return RecipeError(message, where=loaded.where(error.key), hint=error.hint)


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
