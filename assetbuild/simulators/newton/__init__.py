"""Newton as checks use it: experiments on the stages that PhysX gets, in its own environment.

Its solver is MuJoCo's on the CPU: what differs from MuJoCo is what Newton read in the USD, and
which defaults it has.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from assetbuild.simulators.consumers import ConsumerCheck, Environment
from assetbuild.simulators.stages import StageCheck

HOME = Environment("newton", ("newton[sim,importers]==1.8.0",))
_PROGRAM = Path(__file__).with_name("_child.py")
BEYOND_IMPORTS = ("assetbuild.simulators.newton._child",)


class NewtonCheck(ConsumerCheck, StageCheck):
    """Base of the checks that ask Newton."""

    home: ClassVar[Environment] = HOME
    engine: ClassVar[str] = "Newton"

    @staticmethod
    def start(job: dict[str, object], folder: Path, seconds: float) -> str:
        """Do a job by Newton's own Python."""
        return HOME.ask(_PROGRAM, job, folder, seconds)[1]
