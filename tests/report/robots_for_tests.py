"""A tiny robot as the report reads it, and with one thing changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from tiny import TinyRobot, tiny_quadruped

from assetbuild.body.measure_bodies import measure
from assetbuild.pipeline.recipes import whole_model
from assetbuild.recipe.models import Recipe
from assetbuild.report.card import Subject


def recipe(**more: object) -> Recipe:
    source = {"path": ".", "urdf": "r.urdf"}
    return whole_model().model_validate(
        {"schema": "assetbuild/v1", "robot": "tiny", "source": source, **more}
    )


def subject(robot: TinyRobot | None = None, made_of: Recipe | None = None) -> Subject:
    robot = robot or tiny_quadruped()
    measured = measure(robot.tree, robot.control)
    return Subject(made_of or recipe(), {}, robot.tree, robot.shapes, robot.control, measured)


def changed(things: Sequence[Any], name: str, **values: object) -> tuple[Any, ...]:
    """Bodies, joints or shapes, of which one has other values. Any: one of these."""
    assert name in {thing.name for thing in things}
    return tuple(replace(one, **values) if one.name == name else one for one in things)


def with_joint(robot: TinyRobot, name: str, **values: object) -> TinyRobot:
    joints = changed(robot.tree.joints, name, **values)
    return replace(robot, tree=replace(robot.tree, joints=joints))


def with_drives(robot: TinyRobot, **values: object) -> TinyRobot:
    """The same change of all drives."""
    drives = tuple(replace(drive, **values) for drive in robot.control.actuators)
    return replace(robot, control=replace(robot.control, actuators=drives))
