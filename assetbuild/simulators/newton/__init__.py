"""Newton as checks use it: the experiments of `physx`, on the same stages, in its own environment.

Its solver is MuJoCo's on the CPU: what differs from MuJoCo is what Newton read in the USD, and
which defaults it has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.simulators import physx
from assetbuild.simulators.consumers import ConsumerCheck
from assetbuild.simulators.environments import Environment
from assetbuild.simulators.experiments import Experiment, Outcome, SimulatorCheck

HOME = Environment("newton", ("newton[sim,importers]==1.8.0",))
PROGRAM = Path(__file__).with_name("_motion_child.py")
BEYOND_IMPORTS = (
    "assetbuild.simulators.newton._motion_child",
    "assetbuild.simulators.newton._child",
)


class NewtonCheck(ConsumerCheck, SimulatorCheck):
    """Base of the checks that ask Newton to move."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    consumer: ClassVar[str] = "newton"
    home: ClassVar[Environment] = HOME
    engine: ClassVar[str] = "Newton"

    def perform(self, inputs: Path, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
        """Run experiments on `usd/`; `held` is the JSON that the program writes."""

        def start(job: dict[str, object], folder: Path) -> str:
            failure = self.home.ask(PROGRAM, job, folder, self.limits.wall_s)[1]
            return f"Newton: {failure}" if failure else ""

        main = inputs / f"usd/{self.robot}.usda"
        return physx.perform_in(start, lambda raw, _: raw, main, experiments)
