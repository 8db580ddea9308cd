"""Does a robot that stands stay where it is on a slope that friction holds?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.quantities import Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.drives import servoed
from assetbuild.simulators.mujoco.slope import SHARE, creep

CREEP = Rule(
    "slope.creep",
    "warning",
    "a standing robot slides in MuJoCo on a slope below the angle of friction",
    "`cone: elliptic`, a larger `impratio` or more `iterations`, in `mjcf` or `mjx`",
)


class Slope(mujoco.InMujoco):
    """Tilts the ground under the initial pose, in the full model and the mjx file.

    Finding `slope.creep`; figures by file: the slope in rad, its friction and the speed in m/s.
    """

    also: ClassVar[tuple[str, ...]] = ("mjx",)
    reads: ClassVar[tuple[str, ...]] = ("control.json",)

    section: ClassVar[str] = "validate.slope"
    about: ClassVar[str] = "stand on a slope in MuJoCo; null = do not"

    share: float = Field(SHARE, gt=0.0, lt=1.0, description="of the angle of friction")
    speed: Positive = Field(0.001, description="m/s that the feet may slide, warning")

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot, `mjcf/scene.xml` and, where it is built, `mjx/scene_mjx.xml`."""
        control = RobotFiles(files.inputs).control
        figures: dict[str, object] = {}
        for folder, path, model in mujoco.full_and_mjx_models(files.inputs, "scene", figures):
            found = creep(servoed(model, control), self.share)
            if isinstance(found, str):
                figures[folder] = {"skipped": found}
                continue
            figures[folder] = {
                "angle_rad": found.angle,
                "friction": found.friction,
                "speed_m_s": found.speed,
            }
            if found.speed > self.speed:
                yield CREEP(
                    "robot",
                    f"{path.name}: its feet slide at {1e3 * found.speed:.3g} mm/s on a slope of "
                    f"{self.share:.2g} of the angle of friction (limit {1e3 * self.speed:g} mm/s)",
                    data={"speed_m_s": found.speed, "limit_m_s": self.speed},
                )
        write_figures(files, figures, {"speed_m_s": self.speed})
