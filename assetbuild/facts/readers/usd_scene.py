"""`usd/scene.usda`: the floor, the light, gravity, the rate, and the robot where it starts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.facts.compare import FLOAT32, Precision
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table

_ROBOT = "the scene refers to the robot's own file, which is compared by itself"
_MUJOCO = "MuJoCo's own"


class UsdSceneReader(Reader):
    """Every prim of the scene but the robot's, and all that it says of the robot's."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    preload: ClassVar[tuple[str, ...]] = (
        "pxr.Usd",
        "pxr.UsdGeom",
        "pxr.UsdPhysics",
        "pxr.UsdShade",
    )
    form: ClassVar[str] = "usd_scene"
    called: ClassVar[str] = "the USD scene"
    folder: ClassVar[str] = "usd"
    behind: ClassVar[tuple[str, ...]] = ("usd/scene.usda",)
    precision: ClassVar[Precision] = Precision(FLOAT32)
    lacks: ClassVar[Mapping[str, str]] = {
        "robot base": _ROBOT,
        "robot base pose": _ROBOT,
        "robot articulation root": _ROBOT,
        "robot self-collision": _ROBOT,
        "joint": _ROBOT,
        "loop": _ROBOT,
        "frame": _ROBOT,
        "shape": _ROBOT,
        "pair": _ROBOT,
        "sensor": _ROBOT,
        "camera": _ROBOT,
        "body": _ROBOT,
        "robot start pose": _ROBOT,
        "keyframe": "USD has none: each body stands where it starts",
        "simulation decimation": "the trainers' modules say it",
        "simulation integrator": _MUJOCO,
        "simulation cone": _MUJOCO,
        "simulation solver": _MUJOCO,
        "simulation iterations": _MUJOCO,
        "simulation line search iterations": _MUJOCO,
        "simulation impratio": _MUJOCO,
    }

    def file(self, root: Path, robot: str) -> Path | None:
        """`scene.usda`; a robot of that name has none."""
        path = root / "scene.usda"
        return path if path.exists() and robot != "scene" else None

    def read(self, path: Path) -> Table:
        """UsageError where it does not open."""
        from assetbuild.facts.usd_scene import read_scene

        return read_scene(path)

    def expected(self, reference: Reference) -> Table:
        """Gravity and rate of the recipe, the robot in its initial pose."""
        from assetbuild.facts.usd_scene import scene_table

        return scene_table(self.robot, reference)
