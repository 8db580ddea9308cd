"""Dropped without contacts and drives, does the robot fall as its integrator must?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import Fall, fall_figures, judge_fall

LOAD = Rule("free_fall.load", "error", "MuJoCo refuses the MJCF", "see `mjcf.load`")
WRONG_DROP = Rule(
    "free_fall.drop",
    ("warning", "error"),
    "the robot does not fall by g/2 t (t + dt) (an error above 5 %)",
    "check whether a part is fixed to the world",
)
FIXED_BASE = Rule("free_fall.fixed_base", "info", "a fixed base is not dropped", "nothing")


class FreeFall(Check):
    """Compares the drop of the centre of mass in MuJoCo with g/2 t (t + dt)."""

    isolated = True
    preload = ("mujoco",)
    needs = ("mjcf",)
    reads = ("tree.json",)

    robot: str
    engines = ("mujoco",)
    sections: ClassVar = {"validate.free_fall": "drop"}

    drop: Fall = Fall()

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `tree.json` and `mjcf/<robot>.xml`."""
        tree = RobotFiles(files.inputs).tree
        if tree.base == "fixed":
            write_figures(files, {"skipped": "fixed base"})
            yield FIXED_BASE("robot", "a fixed base does not fall: not dropped")
            return
        try:
            model = mujoco.load(files.inputs / "mjcf" / f"{self.robot}.xml", visuals=False).model
        except StepError as error:
            write_figures(files, {"skipped": "the MJCF does not load"})
            yield LOAD("robot", f"nothing to drop: {error.message}")
            return
        fall, tolerance = mujoco.free_fall(model, self.drop.seconds), self.drop.tolerance
        limits = {"relative_error": tolerance, "sideways_m": tolerance * max(fall.expected_m, 1e-6)}
        write_figures(files, fall_figures(fall), limits)
        if fall.finite:
            yield from judge_fall(fall, self.drop, WRONG_DROP, rounding=1e-9)
        else:
            yield WRONG_DROP(
                "robot",
                "the simulation became unstable in free fall",
                severity="error",
                hint="look for tiny inertias and for a large timestep",
            )
