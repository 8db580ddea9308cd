"""Does a robot that stands stay where it is on a slope that friction holds?"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from assetbuild.findings import Rule
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.drives import servoed
from assetbuild.simulators.mujoco.motion import MujocoCheck
from assetbuild.simulators.mujoco.slope import Creep, creep
from assetbuild.simulators.slopes import SlopeCheck

CREEP = Rule(
    "slope.creep",
    "warning",
    "a standing robot slides in MuJoCo on a slope below the angle of friction",
    "`cone: elliptic`, a larger `impratio` or more `iterations`, in `mjcf` or `mjx`; where these "
    "are set, a pose that its drives hold: feet below the hips, a larger kp",
)


class Slope(SlopeCheck, MujocoCheck):
    """In the full model and the mjx file."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    also: ClassVar[tuple[str, ...]] = ("mjx",)
    reads: ClassVar[tuple[str, ...]] = ("control.json",)
    creeps: ClassVar[Rule] = CREEP

    def scenes(
        self, inputs: Path, figures: dict[str, object]
    ) -> Iterator[tuple[str, str, mujoco.Model]]:
        """`mjcf/scene.xml` and, where it is built, `mjx/scene_mjx.xml`."""
        for target, path, model in mujoco.full_and_mjx_models(inputs, "scene", figures):
            yield target, path.name, model

    def creep(self, inputs: Path, model: mujoco.Model, robot: RobotFiles) -> Creep | str:
        """In MuJoCo, whose ground tilts while the robot stands on it."""
        return creep(servoed(model, robot.control), self.wish.share, self.wish.speed)
