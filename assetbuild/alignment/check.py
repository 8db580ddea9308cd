"""MuJoCo beside another simulator, row by row: the form that people fill in by hand before they
move from one simulator to another.

Rows are ranked: CRITICAL ones decide whether the two simulate the same robot, LOW ones inform.
Each row has two limits: the design's, for a warning, and the coarse one of practice, for an error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.alignment.asked import experiments_of
from assetbuild.alignment.held import held_rows, mujoco_table, scene_rows
from assetbuild.alignment.moved import Compared, FloorLimits
from assetbuild.alignment.row import Row, findings_of
from assetbuild.alignment.touching import Pairs, touching_row
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.facts.table import Table
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import Experiment, SimulatorCheck, Swing
from assetbuild.simulators.free_fall import Fall
from assetbuild.simulators.mujoco.motion import perform

RANKS = ("CRITICAL", "HIGH", "MEDIUM", "LOW")
VERDICTS = ("error", "warning", "ok", "told")


class AlignmentCheck(SimulatorCheck):
    """`mjcf/` in MuJoCo and `usd/` in another simulator: what they hold, how they move."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    sections: ClassVar[Mapping[str, str]] = {"validate.alignment": "floor", "validate.sine": "sine"}
    told: ClassVar[Mapping[str, str]] = {"fall": "validate.free_fall"}
    off: ClassVar[Rule]
    failed: ClassVar[Rule]

    sine: Swing | None = Swing()
    fall: Fall = Fall()
    floor: FloorLimits = FloorLimits()
    iterations: int = 1
    """How often the simulator applies gravity in a step."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: all rows, worst first within their rank."""
        robot, mjcf = RobotFiles(files.inputs), files.inputs / "mjcf"
        tree, control = robot.tree, robot.control
        try:
            model, scene = (mujoco.load(mjcf / f"{n}.xml").model for n in (self.robot, "scene"))
        except StepError:
            write_figures(files, {"skipped": "the MJCF does not load"})  # `mjcf.load` says why
            return
        experiments = experiments_of(tree, control, self.sine)
        theirs = self.perform(files.inputs, tuple(experiments.values()))
        both = Compared(
            tree,
            control,
            self.sine or Swing(),
            self.fall,
            self.floor,
            self.iterations,
            lambda asked: perform(mjcf, self.robot, (asked,))[asked.name],
            experiments,
            theirs,
        )
        rows = [*scene_rows(files.inputs, self.robot, scene)]
        if (held := theirs["load"].held) is not None:
            ours, other, pairs = self.read(files.inputs, held, mujoco_table(model, tree), tree)
            rows += [touching_row(model, pairs, tree, self.engine)]
            rows += held_rows(model, ours, other)
        rows += both.rows()
        rows.sort(key=lambda row: (RANKS.index(row.rank), VERDICTS.index(row.verdict)))
        shown = [row.shown(self.engine) for row in rows]
        more, findings = self.beyond(rows, control, experiments)
        write_figures(files, {"rows": shown, **more})
        for name, done in theirs.items():
            if not done.finite:
                message = f"no comparison of `{name}`: {done.failure}"
                yield self.failed("robot", message, data={"simulator": self.engine.lower()})
        yield from findings_of(rows, self.off, self.engine)
        yield from findings

    def read(self, inputs: Path, held: Any, ours: Table, tree: Tree) -> tuple[Table, Table, Pairs]:
        """What MuJoCo holds, as the other holds it; what that holds; and what may touch there."""
        raise NotImplementedError

    def beyond(
        self, rows: Sequence[Row], control: Control, asked: Mapping[str, Experiment]
    ) -> tuple[Mapping[str, object], tuple[Finding, ...]]:
        """Figures and findings that follow from the rows."""
        return {}, ()
