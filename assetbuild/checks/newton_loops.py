"""Do the loops stay closed in Newton while the driven joints swing?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Self

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.kinds import RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators import loop_swing
from assetbuild.simulators.consumers import FAILED, ConsumerCheck
from assetbuild.simulators.environments import Environment
from assetbuild.simulators.experiments import Motion
from assetbuild.simulators.loop_swing import LoopSwing, Trial
from assetbuild.simulators.newton import HOME
from assetbuild.simulators.usd_names import joint_identifiers

BEYOND_IMPORTS = ("assetbuild.simulators._newton_loops_child",)
NO_POSE = np.zeros((0, 3))


class NewtonLoops(ConsumerCheck):
    """Swings the driven joints of `usd/<robot>.usda` in Newton and measures every gap."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    consumer: ClassVar[str] = "newton"
    home: ClassVar[Environment] = HOME
    sections: ClassVar[Mapping[str, str]] = {"validate.loops": "wish"}

    wish: LoopSwing = LoopSwing()

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self | None:
        """Only for a robot that may have loops: by its recipe, its parts or its MJCF."""
        asked = any(map(recipe.value, loop_swing.SOURCES))
        return super().configure(recipe) if asked else None

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and its USD."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        if reason := loop_swing.unfit(tree, control):
            write_figures(files, {"skipped": reason})
            return
        asked = loop_swing.trial(tree, control, self.wish)
        path = (files.inputs / f"usd/{self.robot}.usda").absolute()
        job = job_of(str(path), tree, control, asked)
        answer, failure = self.answer("_newton_loops_child.py", job)
        answer = answer or {"failure": failure}
        if "failure" in answer:
            write_figures(files, {"skipped": "Newton does not swing the USD"})
            message = f"Newton does not swing the USD: {answer['failure']}"
            yield FAILED("robot", message, hint="the message is Newton's")
            return
        worst = loop_swing.opened(tree, control, motion_of(tree, answer))
        limits = dict.fromkeys(("open", "largest_gap"), self.wish.gap)
        write_figures(files, loop_swing.figures(asked, worst), limits)
        yield from loop_swing.judge("Newton", self.wish, asked, worst)


def job_of(path: str, tree: Tree, control: Control, asked: Trial) -> dict[str, object]:
    """What the child is asked, by the names of the joint prims."""
    names, sine, step = joint_identifiers(tree), asked.sine, control.simulation.timestep
    return {
        "file": path,
        "dt": step,
        "gravity": control.simulation.gravity,
        "hold": tree.base == "floating",
        "steps": round(sine.seconds / step),
        "every": max(1, round(loop_swing.SAMPLE_S / step)),
        "frequency": sine.frequency_hz,
        "start": {names[name]: q for name, q in sine.middle.items()},
        "servos": {
            names[name]: (sine.middle[name], sine.swing[name], servo.kp, servo.kd)
            for name, servo in asked.servos.items()
        },
    }


def motion_of(tree: Tree, answer: Mapping[str, Any]) -> Motion:  # Any: JSON of the child
    """The child's answer, by the robot's own names; not finite where it says so."""
    if not answer["finite"]:
        nowhere = np.array([math.nan])
        return Motion(nowhere, {"": nowhere}, NO_POSE, NO_POSE, NO_POSE)
    names = {file: name for name, file in joint_identifiers(tree).items()}
    joints = {names[file]: np.asarray(track) for file, track in answer["joints"].items()}
    return Motion(np.asarray(answer["time"]), joints, NO_POSE, NO_POSE, NO_POSE)
