"""Dropped without contacts and drives, does the robot fall as its integrator must?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import experiments, mujoco
from assetbuild.simulators.experiments import Fall

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
        write_figures(
            files,
            {
                "seconds": fall.seconds,
                "drop_m": fall.drop_m,
                "expected_m": fall.expected_m,
                "relative_error": fall.relative_error,
                "sideways_m": fall.sideways_m,
            }
            if fall.finite
            else {"finite": False},
            {"relative_error": tolerance, "sideways_m": tolerance * max(fall.expected_m, 1e-6)},
        )
        yield from self._judge(fall)

    def _judge(self, fall: experiments.FreeFall) -> Iterator[Finding]:
        if not fall.finite:
            yield WRONG_DROP(
                "robot",
                "the simulation became unstable in free fall",
                severity="error",
                hint="look for tiny inertias and for a large timestep",
            )
            return
        # Compared as lengths, so that without gravity nothing may move at all.
        error = max(abs(fall.drop_m - fall.expected_m), fall.sideways_m)
        if error > self.drop.tolerance * fall.expected_m + 1e-9:
            broken = error > self.drop.broken * fall.expected_m
            yield WRONG_DROP(
                "robot",
                f"fell {fall.drop_m:.6g} m and {fall.sideways_m:.3g} m sideways in "
                f"{fall.seconds:g} s, expected {fall.expected_m:.6g} m",
                severity="error" if broken else "warning",
                hint="is part of the robot fixed to the world, or gravity compensated?",
                data={
                    "drop_m": fall.drop_m,
                    "expected_m": fall.expected_m,
                    "sideways_m": fall.sideways_m,
                    "tolerance": self.drop.tolerance,
                },
            )
