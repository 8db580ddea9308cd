"""Do the loops stay closed in Newton while the driven joints swing?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Self

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.kinds import RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import loop_swing, newton
from assetbuild.simulators.consumers import FAILED, ConsumerCheck
from assetbuild.simulators.environments import Environment
from assetbuild.simulators.loop_swing import LoopSwing


class NewtonLoops(ConsumerCheck):
    """Swings the driven joints of `usd/<robot>.usda` in Newton and measures every gap."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    consumer: ClassVar[str] = "newton"
    home: ClassVar[Environment] = newton.HOME
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
        main = files.inputs / f"usd/{self.robot}.usda"
        experiment = loop_swing.experiment(tree, control, asked)
        done = newton.perform(main, (experiment,), self.limits.wall_s)["loops"]
        if done.motion is None:
            write_figures(files, {"skipped": "Newton does not swing the USD"})
            message = f"Newton does not swing the USD: {done.failure}"
            yield FAILED("robot", message, hint="the message is Newton's")
            return
        worst = loop_swing.opened(tree, control, done.motion)
        limits = dict.fromkeys(("open", "largest_gap"), self.wish.gap)
        write_figures(files, loop_swing.figures(asked, worst), limits)
        yield from loop_swing.judge("Newton", self.wish, asked, worst)
