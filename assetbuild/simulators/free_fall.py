"""Dropped without contacts and drives, does the robot fall as the simulator's integrator must?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Control
from assetbuild.simulators.experiments import Experiment, Outcome, SimulatorCheck, drop

LEAST_M = 0.01
"""A smaller drop, as without gravity, is judged as one of this size: the joints' forces shake the
centre of mass by what the steps round."""


class Fall(Model):
    """Dropped without contact and drives; null = do not run it."""

    seconds: Positive = Field(0.4, description="s")
    tolerance: Positive = Field(
        0.003, description="relative, against the integrator's formula, warning"
    )
    error_limit: Positive = Field(0.05, description="the same, error")


@dataclass(frozen=True)
class FreeFall:
    """How the whole robot's centre of mass fell. drop: along gravity; sideways: across it; m."""

    seconds: float
    drop_m: float
    expected_m: float
    sideways_m: float

    @property
    def relative_error(self) -> float:
        """The error of the drop, relative to the expected one."""
        return abs(self.drop_m - self.expected_m) / self.scale_m

    @property
    def scale_m(self) -> float:
        """What errors are compared with."""
        return max(self.expected_m, LEAST_M)


def fall_of(
    experiment: Experiment, done: Outcome, iterations: int = 1, carried: float = 0.0
) -> FreeFall | None:
    """The fall against g/2 t (t + dt / N); None where nothing finite came out.

    The integrators are semi-implicit: n steps of dt from rest fall so far, t = n dt. PhysX's solver
    applies gravity in each of its N position iterations.
    carried: share of the robot's weight that the engine compensates.
    """
    if done.motion is None or not done.finite:
        return None
    gravity = np.asarray(experiment.setting.gravity)
    g = float(np.linalg.norm(gravity))
    down = gravity / g if g else np.array([0.0, 0.0, -1.0])
    t, moved = float(done.motion.time[-1]), done.motion.com[-1] - done.motion.com[0]
    fallen = float(moved @ down)
    sideways = float(np.linalg.norm(moved - fallen * down))
    pulled = (1.0 - carried) * g
    expected = pulled / 2 * t * (t + experiment.setting.timestep / iterations)
    return FreeFall(t, fallen, expected, sideways)


class FreeFallCheck(SimulatorCheck):
    """Compares the drop of the centre of mass with the integrator's law."""

    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    sections: ClassVar[Mapping[str, str]] = {"validate.free_fall": "wish"}
    wrong: ClassVar[Rule]
    rounding: ClassVar[float]
    """m, of the engine."""

    wish: Fall = Fall()
    iterations: int = 1
    """How often the solver applies gravity in a step."""

    def carried(self, control: Control) -> Mapping[str, float]:
        """Body -> share of its weight that the engine compensates, because the MJCF asks for it."""
        raise NotImplementedError

    def held(self, control: Control) -> str:
        """What brakes the floating base in the simulator's file, because the MJCF asks for it."""
        return ""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and the simulator's file."""
        robot = RobotFiles(files.inputs)
        held = "fixed base" if robot.tree.base == "fixed" else self.held(robot.control)
        if held:
            write_figures(files, {"skipped": held})
            return
        asked = drop(robot.control, self.wish.seconds)
        done = self.perform(files.inputs, (asked,))[asked.name]
        shares, bodies = self.carried(robot.control), robot.tree.bodies
        carried_kg = sum(shares.get(b.name, 0.0) * b.inertial.mass_kg for b in bodies if b.inertial)
        carried = carried_kg / total_mass(robot.tree) if carried_kg else 0.0
        fall = fall_of(asked, done, self.iterations, carried)
        if fall is None:
            write_figures(files, {"finite": False})
            message = f"did not fall: {done.failure or 'nothing finite came out'}"
            hint = "look for tiny inertias and for a large timestep"
            yield self.wrong("robot", message, severity="error", hint=hint)
            return
        tolerance, scale = self.wish.tolerance, fall.scale_m
        limits = {"relative_error": tolerance, "sideways_m": tolerance * scale}
        more = {"iterations": self.iterations} if self.iterations > 1 else {}
        figures = {**asdict(fall), "relative_error": fall.relative_error, **more}
        write_figures(files, figures, limits)
        error = max(abs(fall.drop_m - fall.expected_m), fall.sideways_m)
        if error > tolerance * scale + self.rounding:
            yield self.wrong(
                "robot",
                f"fell {fall.drop_m:.6g} m and {fall.sideways_m:.3g} m sideways in "
                f"{fall.seconds:g} s, expected {fall.expected_m:.6g} m",
                severity="error" if error > self.wish.error_limit * scale else "warning",
                hint="is a part fixed to the world, damped, or free of gravity?",
                data={
                    "drop_m": fall.drop_m,
                    "expected_m": fall.expected_m,
                    "sideways_m": fall.sideways_m,
                    "tolerance": tolerance,
                },
            )
