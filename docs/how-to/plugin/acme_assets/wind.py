"""Would a gust push the robot over?"""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Check, write_figures
from assetbuild.recipe_types import Positive
from assetbuild.robot.files import RobotFiles

AIR_KG_M3 = 1.2
GUST = Rule("wind.gust", "warning", "a gust accelerates the robot", "hold it, or calm the wind")


class Wind(Check):
    """Findings `wind.gust`; figures: the force on the robot and its mass."""

    section = "validate.wind"
    about = "a gust from the side; null = do not run it"
    reads = ("tree.json",)

    speed: Positive = Field(10.0, description="m/s, of the gust")
    area: Positive = Field(0.1, description="m2 that it meets")

    def run(self, files: Files) -> Iterator[Finding]:
        """F = rho v^2 A / 2, against a tenth of the robot's weight."""
        bodies = RobotFiles(files.inputs).tree.bodies
        mass = sum(body.inertial.mass_kg for body in bodies if body.inertial)
        force = 0.5 * AIR_KG_M3 * self.speed**2 * self.area
        write_figures(files, {"force_N": force, "mass_kg": mass})
        if force > 0.1 * 9.81 * mass:
            message = f"{force:.3g} N of wind on {mass:.3g} kg"
            yield GUST("robot", message, data={"force_N": force, "mass_kg": mass})
