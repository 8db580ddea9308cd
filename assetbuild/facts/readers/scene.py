"""`mjcf/scene.xml` and `scene_mjx.xml`: the robot on a floor, what people open in a viewer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.errors import StepError, UsageError
from assetbuild.facts.mjcf_fields import plain
from assetbuild.facts.mjcf_model import compiled_facts
from assetbuild.facts.reader import Reader, all_but
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table, Value
from assetbuild.robot.floor import brings_floor, floor_of, starting_origins
from assetbuild.robot.pose import rotation_of
from assetbuild.simulators.mujoco import Model, floors, load

SMALLEST_VIEW_M = 0.5


class SceneFacts(Reader):
    """Compares the floor with the robot's, and that a scene changes nothing of the robot's file."""

    shares = True
    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    file_globs: ClassVar[tuple[str, ...]] = ("mjcf/scene.xml", "mjcf/{robot}.xml")
    format_id: ClassVar[str] = "scene"
    display_name: ClassVar[str] = "the scene"
    folder: ClassVar[str] = "mjcf"
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    lacks: ClassVar[Mapping[str, str]] = all_but(["floor"], "the robot's own file says it")

    def read(self, path: Path) -> Table:
        """The floor, other shapes of the world, and what the robot's own file says otherwise."""
        beside = f"{self.robot}{path.stem.removeprefix('scene')}.xml"  # `go1_mjx.xml`
        robot, scene = _compiled(path.with_name(beside)), _compiled(path)
        before, after = compiled_facts(robot).facts, compiled_facts(scene).facts
        facts = Table()
        for key in dict.fromkeys((*before, *after)):
            if before.get(key) != after.get(key):
                word = key.quantity.removeprefix("mjcf:")
                facts.put(key.kind, key.name, {f"mjcf:{word}": after.get(key, "missing")})
        there = {robot.geom(index).name for index in range(robot.ngeom)}
        planes = [index for index in floors(scene) if scene.geom(index).name not in there]
        for index in range(scene.ngeom):
            name = str(scene.geom(index).name)
            if name not in there and index not in planes[:1]:
                facts.put("shape", name, {"mjcf:type": plain(scene.geom_type[index])})
        for index in planes[:1]:
            facts.put("floor", "", _floor(scene, index))
        facts.put("view", "", {
            "mjcf:centre": plain(scene.stat.center),
            "mjcf:extent": float(scene.stat.extent),
            "mjcf:lights": float(scene.nlight - robot.nlight),
        })  # fmt: skip
        return facts

    def expected(self, reference: Reference) -> Table:
        """A view of the robot, and the floor below it where its own MJCF brings none."""
        origins = starting_origins(reference.tree, reference.control)
        size = max(SMALLEST_VIEW_M, float(np.linalg.norm(np.ptp(origins, axis=0))))
        middle = (origins.min(axis=0) + origins.max(axis=0)) / 2.0
        facts = Table()
        facts.put("view", "", {
            "mjcf:centre": tuple(round(value, 2) for value in middle.tolist()),
            "mjcf:extent": round(size, 2),
            "mjcf:lights": 1.0,
        })  # fmt: skip
        if not brings_floor(reference.tree, reference.control):
            floor = floor_of(reference.tree, reference.control)
            facts.put("floor", "", {
                "height": floor.height_m,
                "friction": floor.friction,
                "mjcf:normal": (0.0, 0.0, 1.0),
                "mjcf:masks": (1.0, 1.0),
            })  # fmt: skip
        return facts


class SceneMjxFacts(SceneFacts):
    """The scene of the mjx model."""

    own_name = "scene_mjx"
    needs: ClassVar[tuple[str, ...]] = ("mjx",)
    file_globs: ClassVar[tuple[str, ...]] = ("mjcf/scene_mjx.xml", "mjcf/{robot}_mjx.xml")
    format_id: ClassVar[str] = "scene_mjx"
    display_name: ClassVar[str] = "the scene of the mjx model"


def _compiled(path: Path) -> Model:
    try:
        return load(path, visuals=False).model
    except StepError as error:
        raise UsageError(f"MuJoCo refuses `{path}`: {error.message}") from None


def _floor(model: Model, plane: int) -> dict[str, Value]:
    """How wide its grid is drawn is no matter."""
    turn = rotation_of(tuple(float(v) for v in model.geom_quat[plane]))  # type: ignore[arg-type] # four
    return {
        "height": float(model.geom_pos[plane, 2]),
        "friction": plain(model.geom_friction[plane]),
        "mjcf:normal": tuple(turn[:, 2].tolist()),
        "mjcf:masks": (float(model.geom_contype[plane]), float(model.geom_conaffinity[plane])),
    }
