"""Does the recipe fit itself, and does it fit this robot? Errors with their keys."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path

from assetbuild.compose.plan import check_parts
from assetbuild.control.control import ControlStep
from assetbuild.engine.world import World
from assetbuild.errors import Gather, did_you_mean
from assetbuild.geometry.jobs import check_files
from assetbuild.plan.edits import edits_of, must_match
from assetbuild.recipe.models import CollisionRule, Recipe
from assetbuild.recipe.validation import Key, KeyedError
from assetbuild.robot.actuator_table import RowError
from assetbuild.robot.actuators import motor_of
from assetbuild.robot.model import Tree
from assetbuild.samples.state_ranges import StateRanges


def check_names(recipe: Recipe, folder: Path, world: World) -> None:
    """Files and cross references inside of a recipe in a folder."""
    wrong = Gather(RowError)
    collision = recipe.collision
    rules: list[tuple[Key, CollisionRule]] = [(("collision", "default"), collision.default)]
    rules += [(("collision", "links", pattern), rule) for pattern, rule in collision.links.items()]
    for key, rule in rules:
        with wrong:
            check_files(rule, key, folder, world)
    for check in (_check_edits, _check_stand, check_parts):
        with wrong:
            check(recipe)
    for index, row in enumerate(recipe.actuators or ()):
        with wrong:
            motor_of(index, row, recipe.motors)
    wrong.stop()


def _check_edits(recipe: Recipe) -> None:
    for _, edit, place in edits_of(recipe.edits):
        if recipe.source.mjcf is not None and not edit.follows_names:
            message = f"`{edit.step_name()}` of a robot from MJCF: its sensors, drives and poses "
            hint = "rename and turn joints in the MJCF itself"
            raise KeyedError(place, message + "would not follow", hint)


def _check_stand(recipe: Recipe) -> None:
    stand = recipe.value("validate.stand")
    from_mjcf = recipe.source.mjcf is not None  # which has keyframes of its own
    if stand is not None and stand.keyframe not in recipe.keyframes and not from_mjcf:
        raise KeyedError(
            ("validate", "stand", "keyframe"),
            f"no keyframe `{stand.keyframe}`",
            did_you_mean(stand.keyframe, recipe.keyframes),
        )


def check_against_robot(recipe: Recipe, links: Tree, tree: Tree, control: ControlStep) -> None:
    """Patterns of the recipe that match nothing of this robot, and the actuator table."""
    names = [body.name for body in links.bodies]
    patterns: list[tuple[Key, str]] = [
        *((("collision", "links", pattern), pattern) for pattern in recipe.collision.links),
        *((("contact", "links", pattern), pattern) for pattern in recipe.contact.links),
    ]
    if recipe.feet is not None:
        patterns.append((("feet", "links"), recipe.feet.links))
    kept = recipe.fixed_joints.keep_bodies
    patterns += [(("fixed_joints", "keep_bodies", i), pattern) for i, pattern in enumerate(kept)]
    wrong = Gather(RowError)
    for key, pattern in patterns:
        with wrong:
            must_match(key, pattern, names, "link of the source")
    with wrong:
        control.check(tree)
    if recipe.randomize is not None:
        with wrong:
            StateRanges.configure(recipe).check(tree)
    wrong.stop()


def turned_meshes(patterns: Sequence[str], paths: Collection[str]) -> frozenset[str]:
    """The meshes whose up axis is honoured; a pattern that matches none is an error."""
    meshes: set[str] = set()
    for index, pattern in enumerate(patterns):
        key = ("source", "honour_up_axis", index)
        must_match(key, pattern, sorted(paths), "mesh of the source")
        meshes |= {path for path in paths if re.fullmatch(pattern, path)}
    return frozenset(meshes)
