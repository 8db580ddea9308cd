"""Does a robot that stands stay where it is on a slope that friction holds?

MuJoCo's model says how steep the slope may be, for every simulator.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import Experiment, Motion, SimulatorCheck, standing
from assetbuild.simulators.mujoco.drives import servoed
from assetbuild.simulators.mujoco.slope import FALLEN, SHARE, SLOW, Slope, creep

REST_S, WATCH_S = 2.0, 2.0
"""What swings comes to rest, then it is watched."""
WAYS = {"x": (1.0, 0.0), "y": (0.0, 1.0)}


class SlopeWish(Model):
    """Stand on a slope; null = do not."""

    share: float = Field(SHARE, gt=0.0, lt=1.0, description="of the angle of friction")
    speed: Positive = Field(SLOW, description="m/s that the feet may slide, warning")


class SlopeCheck(SimulatorCheck):
    """Tilts the ground under the initial pose.

    Figures by target: the slope in rad, its friction and the speed in m/s.
    """

    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    sections: ClassVar[Mapping[str, str]] = {"validate.slope": "wish"}
    creeps: ClassVar[Rule]

    wish: SlopeWish = SlopeWish()

    def creep(self, inputs: Path, model: mujoco.Model, robot: RobotFiles) -> Slope | str:
        """How fast it slides, or why nothing can be said."""
        tree, control = robot.tree, robot.control
        slope = creep(servoed(model, control), self.wish.share, self.wish.speed)
        if isinstance(slope, str):
            return slope
        start, ground = dict(initial_pose(tree, control).joints), standing(tree, control)
        ground = replace(
            ground, slippery=slope.friction / slope.stated, solver=mujoco.contact_solver(model)
        )
        g, step = math.dist(ground.gravity, (0.0, 0.0, 0.0)), ground.timestep
        down, up = g * math.sin(slope.angle), g * math.cos(slope.angle)
        steps, every = round((REST_S + WATCH_S) / step), max(1, round(0.1 / step))
        asked = [
            Experiment(way, replace(ground, gravity=(down * x, down * y, -up)), steps, every, start)
            for way, (x, y) in WAYS.items()
        ]
        done = self.perform(inputs, asked)
        speeds = [_speed(done[way].motion, np.array(down)) for way, down in WAYS.items()]
        return replace(slope, speed=slope.scale * max(speeds))

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and the simulator's scene."""
        figures: dict[str, object] = {}
        limit = self.wish.speed
        for form, file, model in mujoco.full_and_mjx_models(files.inputs, "scene", figures):
            target, name = self.label(form, file)
            sliding = self.creep(files.inputs, model, RobotFiles(files.inputs))
            if isinstance(sliding, str):
                figures[target] = {"skipped": sliding}
                continue
            stood = math.isfinite(sliding.speed)
            figures[target] = {
                "angle_rad": sliding.angle,
                "friction": sliding.friction,
                **({"speed_m_s": sliding.speed} if stood else {"skipped": "the robot falls"}),
            }
            if not sliding.speed <= limit:
                did = f"its feet slide at {1e3 * sliding.speed:.3g} mm/s" if stood else "it falls"
                yield self.creeps(
                    "robot",
                    f"{name}: {did} on a slope of {self.wish.share:.2g} of the angle of friction "
                    f"(limit {1e3 * limit:g} mm/s)",
                    data={"speed_m_s": sliding.speed if stood else None, "limit_m_s": limit},
                )
        write_figures(files, figures, {"speed_m_s": limit})


def _speed(motion: Motion | None, down: np.ndarray) -> float:
    """Speed of the root down the slope, m/s; infinite where the robot fell or went to infinity."""
    if motion is None or not motion.finite:
        return math.inf
    _, x, y, _ = motion.turn[-1]
    if 1.0 - 2.0 * float(x * x + y * y) < math.cos(FALLEN):
        return math.inf
    first = int(np.searchsorted(motion.time, motion.time[-1] - WATCH_S))
    slid = (motion.root[-1, :2] - motion.root[first, :2]) @ down
    return abs(float(slid)) / float(motion.time[-1] - motion.time[first])
