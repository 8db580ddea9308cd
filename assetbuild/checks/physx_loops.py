"""Do the loops stay closed in PhysX while the driven joints swing?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Self

from assetbuild.engine.step import Files, Limits
from assetbuild.findings import Finding
from assetbuild.kinds import Check, RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import loop_swing, physx
from assetbuild.simulators.loop_swing import LoopSwing


class PhysxLoops(Check):
    """Swings the driven joints of `usd/<robot>.usda` in PhysX and measures every gap."""

    usual_s = 30.0
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    requires: ClassVar[Mapping[str, str]] = physx.REQUIRES
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = physx.PRELOAD
    limits: ClassVar[Limits] = Limits(wall_s=600.0, memory_mb=16384)

    engines: ClassVar[tuple[str, ...]] = ("physx",)
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
        """Reads the robot and its USD."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        if reason := loop_swing.unfit(tree, control):
            write_figures(files, {"skipped": reason})
            return
        asked = loop_swing.trial(tree, control, self.wish)
        main = files.inputs / f"usd/{self.robot}.usda"
        experiment = loop_swing.experiment(tree, control, asked)
        done = physx.perform(main, (experiment,))["loops"]
        worst = loop_swing.opened(tree, control, done.motion if done.finite else None)
        limits = dict.fromkeys(("open", "largest_gap"), self.wish.gap)
        write_figures(files, loop_swing.figures(asked, worst), limits)
        yield from loop_swing.judge("PhysX", self.wish, asked, worst)
