"""Dropped in PhysX without contacts, does the robot fall as its solver must?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from assetbuild.engine.step import Files, Limits
from assetbuild.findings import Finding
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Fall, fall_figures, judge_fall


class PhysxFreeFall(Check):
    """Compares the drop of the centre of mass with g/2 t (t + dt/N), N position iterations."""

    usual_s = 30.0
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    requires: ClassVar[Mapping[str, str]] = physx.REQUIRES
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = physx.PRELOAD
    limits: ClassVar[Limits] = Limits(wall_s=600.0, memory_mb=16384)

    engines: ClassVar[tuple[str, ...]] = ("physx",)
    sections: ClassVar[Mapping[str, str]] = {"validate.free_fall": "drop"}
    told: ClassVar[Mapping[str, str]] = {
        "iterations": "usd.articulation.solver_position_iterations"
    }

    robot: str
    """Name of the robot: the stem of the main file."""
    drop: Fall = Fall()
    iterations: int = 8
    """Position iterations of the solver, as the USD target writes them."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `tree.json`, `control.json` and `usd/<robot>.usda`."""
        robot = RobotFiles(files.inputs)
        if robot.tree.base == "fixed":
            write_figures(files, {"skipped": "fixed base"})
            return  # `free_fall.fixed_base` says so
        simulation = robot.control.simulation
        dt = simulation.timestep
        steps = max(1, round(self.drop.seconds / dt))
        setting = physx.Setting(dt, simulation.gravity, contacts=False)
        experiment = physx.Experiment("fall", setting, steps=steps, every=steps)
        done = physx.perform(files.inputs / f"usd/{self.robot}.usda", (experiment,))["fall"]
        fall = physx.free_fall_of(done, setting, self.iterations)
        figures = fall_figures(fall) | ({"iterations": self.iterations} if fall.finite else {})
        write_figures(files, figures)
        if fall.finite:
            yield from judge_fall(fall, self.drop, physx.FREE_FALL, rounding=1e-6)
        else:
            yield physx.FREE_FALL(
                "robot",
                f"did not fall: {done.failure or 'nothing finite came out'}",
                severity="error",
                hint="see `physx.load` and `physx.finite`",
            )
