"""MuJoCo beside PhysX or Newton, row by row: the form that people fill in by hand before they
move from one simulator to another.

Rows are ranked: CRITICAL ones decide whether the two simulate the same robot, LOW ones inform.
Each row has two limits: the design's, for a warning, and the coarse one of practice, for an error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.alignment.gap import told
from assetbuild.alignment.pair import Engine, FloorLimits, Pair
from assetbuild.alignment.row import Row, findings_of
from assetbuild.alignment.rows import physx_rows
from assetbuild.alignment.touching import touching_in_usd, touching_row
from assetbuild.engine.step import Files, Limits
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco, physx
from assetbuild.simulators.experiments import Fall, Swing
from assetbuild.simulators.physx_causes import cause_of

UNMEASURED = "unmeasured: docs/how-to/isaaclab.md says how to fill in that half"

LOAD = Rule("alignment.physx.load", "error", "MuJoCo refuses the MJCF", "see `mjcf.load`")
FAILED_RUN = Rule(
    "alignment.physx.run",
    "error",
    "an experiment crashed or went to infinity",
    "see `physx.finite`",
)


class Alignment(Check):
    """`mjcf/` in MuJoCo and `usd/` in PhysX: what they hold, how they fall, follow, stand, land."""

    usual_s = 60.0
    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    also: ClassVar[tuple[str, ...]] = ("mjlab", "isaaclab")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    requires: ClassVar[Mapping[str, str]] = physx.REQUIRES
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = physx.PRELOAD
    limits: ClassVar[Limits] = Limits(wall_s=900.0, memory_mb=16384)

    engines: ClassVar[tuple[str, ...]] = ("mujoco", "physx")
    sections: ClassVar[Mapping[str, str]] = {"validate.alignment": "floor", "validate.sine": "sine"}
    told: ClassVar[Mapping[str, str]] = {
        "fall": "validate.free_fall",
        "iterations": "usd.articulation.solver_position_iterations",
    }

    robot: str
    """Name of the robot: the stem of the main files."""
    sine: Swing | None = Swing()
    fall: Fall = Fall()
    floor: FloorLimits = FloorLimits()
    iterations: int = 8
    """Position iterations of PhysX's solver."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: all rows, worst first within their rank."""
        from pxr import Usd

        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        try:
            mujoco.load(files.inputs / "mjcf" / "scene.xml")
        except StepError as error:
            write_figures(files, {"skipped": "the MJCF does not load"})
            yield LOAD("robot", f"nothing to compare: {error.message}")
            return
        main = files.inputs / f"usd/{self.robot}.usda"

        def held(model: Any, held: physx.Held, tree: Tree) -> Iterator[Row]:
            # Any: mujoco.MjModel
            stage = Usd.Stage.Open(str(main.with_name("scene.usda")))
            yield touching_row(model, touching_in_usd(stage), tree)
            yield from physx_rows(model, held, tree)

        engine = Engine("PhysX", self.iterations, held)
        pair = Pair(files, self.robot, tree, control, self.sine, engine, self.fall, self.floor)
        experiments = pair.experiments()
        outcomes = physx.perform(main, experiments)
        broken = {name: done for name, done in outcomes.items() if not done.finite}
        rows = tuple(pair.rows(outcomes))
        shown = [row.shown(engine.name) for row in rows]
        ranges = dict(pair.ranges(rows))
        write_figures(files, {"rows": shown, "randomize": ranges, "isaac_lab": UNMEASURED})
        for name, done in broken.items():
            asked = next(each for each in experiments if each.name == name)
            yield failed_run(name, done, cause_of(main, asked, tree, control))
        yield from findings_of(rows)
        yield from told(ranges)


def failed_run(name: str, done: physx.Outcome, cause: tuple[str, str] | None) -> Finding:
    """cause: what it is and what to write, where that is known."""
    said, hint = cause or ("", FAILED_RUN.advice)
    return FAILED_RUN(
        "robot",
        f"no comparison of `{name}`: {done.failure}{f'; it is {said}' if said else ''}",
        hint=hint,
        data={"simulator": "physx"},
    )
