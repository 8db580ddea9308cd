"""MuJoCo beside another simulator, row by row: how both move the robot.

What each of them holds is compared with the robot by the read-backs. A row has a rank, and two
limits: the design's, for a warning, and the coarse one of practice, for an error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.alignment.asked import experiments_of
from assetbuild.alignment.moved import Compared, FloorLimits
from assetbuild.alignment.row import Row, findings_of
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import NOT_LOADED, Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import SimulatorCheck, Swing
from assetbuild.simulators.free_fall import Fall
from assetbuild.simulators.mujoco.motion import perform

RANKS = ("HIGH", "MEDIUM")
VERDICTS = ("error", "warning", "ok", "told")


class AlignmentCheck(SimulatorCheck):
    """`mjcf/` in MuJoCo and `usd/` in another simulator: how they move."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    sections: ClassVar[Mapping[str, str]] = {"validate.alignment": "floor", "validate.sine": "sine"}
    recipe_fields: ClassVar[Mapping[str, str]] = {"fall": "validate.free_fall"}
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
            model = mujoco.load(mjcf / f"{self.robot}.xml", visuals=False).model
        except StepError:
            write_figures(files, {NOT_LOADED: "the MJCF does not load"})  # `mjcf.load` says why
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
        rows = [*both.rows()]
        if (held := theirs["load"].held) is not None:
            rows += self.held_rows(model, held, tree)
        rows.sort(key=lambda row: (RANKS.index(row.rank), VERDICTS.index(row.verdict)))
        write_figures(files, {"rows": [row.shown(self.engine) for row in rows]})
        for name, done in theirs.items():
            if not done.finite:
                message = f"no comparison of `{name}`: {done.failure}"
                yield self.failed("robot", message, data={"simulator": self.engine.lower()})
        yield from findings_of(rows, self.off, self.engine)

    def held_rows(self, model: mujoco.Model, held: Any, tree: Tree) -> Iterator[Row]:
        """Rows about what the other engine holds. held: as it says. Any: JSON."""
        yield from ()
