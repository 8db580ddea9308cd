"""Do the loops stay closed in MuJoCo while the driven joints swing?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Self

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.kinds import Check, RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import loop_swing, mujoco_motion
from assetbuild.simulators.loop_swing import LoopSwing


class Loops(Check):
    """Swings the driven joints of `mjcf/<robot>.xml`, its base held, and measures every gap."""

    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")

    engines: ClassVar[tuple[str, ...]] = ("mujoco",)
    sections: ClassVar[Mapping[str, str]] = {"validate.loops": "wish"}

    robot: str
    """Name of the robot: the stem of the main file."""
    wish: LoopSwing = LoopSwing()

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self | None:
        """Only for a robot that may have loops: by its recipe, its parts or its MJCF."""
        asked = any(map(recipe.value, loop_swing.SOURCES))
        return super().configure(recipe) if asked else None

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and its MJCF."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        if reason := loop_swing.unfit(tree, control):
            write_figures(files, {"skipped": reason})
            return
        asked = loop_swing.trial(tree, control, self.wish)
        path = files.inputs / "mjcf" / f"{self.robot}.xml"
        model = mujoco_motion.held_model(path, asked.servos)
        mujoco_motion.drive_as(model, asked.servos)
        step = control.simulation.timestep
        motion = mujoco_motion.held_sine(
            model,
            asked.sine,
            step,
            contacts=False,
            rubbing=True,
            limited=False,
            every=max(1, round(loop_swing.SAMPLE_S / step)),
        )
        worst = loop_swing.opened(tree, control, motion)
        limits = dict.fromkeys(("open", "largest_gap"), self.wish.gap)
        write_figures(files, loop_swing.figures(asked, worst), limits)
        yield from loop_swing.judge("MuJoCo", self.wish, asked, worst)
