"""A tiny robot as the report reads it."""

from __future__ import annotations

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


def subject(robot: TinyRobot | None = None) -> Subject:
    robot = robot or tiny_quadruped()
    measured = measure(robot.tree, robot.control)
    return Subject(recipe(), {}, robot.tree, robot.shapes, robot.control, measured)
