"""Newton as checks use it: experiments on the stages that PhysX gets, in its own environment.

Its solver is MuJoCo's on the CPU: what differs from MuJoCo is what Newton read in the USD, and
which defaults it has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.simulators.consumers import ConsumerCheck, Environment
from assetbuild.simulators.experiments import Experiment, Outcome, SimulatorCheck
from assetbuild.simulators.stages import perform_on_stages

HOME = Environment("newton", ("newton[sim,importers]==1.8.0",))
PROGRAM = Path(__file__).with_name("_child.py")
BEYOND_IMPORTS = ("assetbuild.simulators.newton._child",)


class NewtonCheck(ConsumerCheck, SimulatorCheck):
    """Base of the checks that ask Newton."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    home: ClassVar[Environment] = HOME
    engine: ClassVar[str] = "Newton"

    def start(self, job: dict[str, object], folder: Path) -> str:
        """Do a job; how Newton died, or ""."""
        failure = self.home.ask(PROGRAM, job, folder, self.limits.wall_s)[1]
        return f"Newton: {failure}" if failure else ""

    def perform(self, inputs: Path, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
        """Run experiments on `usd/`."""
        return perform_on_stages(self.start, inputs / f"usd/{self.robot}.usda", experiments)
