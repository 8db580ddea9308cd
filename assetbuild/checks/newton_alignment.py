"""MuJoCo beside Newton: the rows of `alignment`, with the USD in Newton's solver.

Both are MuJoCo's dynamics, so that a row that is off is about what Newton read in the USD, or
about a default of its solver.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from assetbuild.alignment.pair import Engine, FloorLimits, Pair
from assetbuild.alignment.row import findings_of
from assetbuild.alignment.rows import newton_rows
from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import newton
from assetbuild.simulators.consumers import ConsumerCheck
from assetbuild.simulators.environments import Environment
from assetbuild.simulators.experiments import Fall, Swing
from assetbuild.simulators.physx import Outcome

FAILED_RUN = Rule(
    "alignment.newton.run",
    "error",
    "Newton refuses the USD, or an experiment went to infinity in it",
    "the message is Newton's",
)
ENGINE = Engine("Newton", 1, newton_rows)


class NewtonAlignment(ConsumerCheck):
    """`mjcf/` in MuJoCo and `usd/` in Newton: what they hold, how they fall, follow, stand."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    consumer: ClassVar[str] = "newton"
    home: ClassVar[Environment] = newton.HOME
    sections: ClassVar[Mapping[str, str]] = {"validate.alignment": "floor", "validate.sine": "sine"}
    told: ClassVar[Mapping[str, str]] = {"fall": "validate.free_fall"}

    sine: Swing | None = Swing()
    fall: Fall = Fall()
    floor: FloorLimits = FloorLimits()

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: all rows, worst first within their rank."""
        robot = RobotFiles(files.inputs)
        pair = Pair(
            files, self.robot, robot.tree, robot.control, self.sine, ENGINE, self.fall, self.floor
        )
        main = files.inputs / f"usd/{self.robot}.usda"
        outcomes = newton.perform(main, pair.experiments(), self.limits.wall_s)
        rows = tuple(pair.rows(outcomes))
        write_figures(files, {"rows": [row.shown(ENGINE.name) for row in rows]})
        yield from failed_runs(outcomes)
        yield from findings_of(rows, ENGINE.name)


def failed_runs(outcomes: Mapping[str, Outcome]) -> Iterator[Finding]:
    """One for each experiment that Newton did not bring to its end, or not with numbers."""
    for name, done in outcomes.items():
        if not done.finite:
            yield FAILED_RUN("robot", f"no comparison of `{name}`: {done.failure}")
