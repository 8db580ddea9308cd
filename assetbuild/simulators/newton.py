"""Newton as checks use it: the experiments of `physx`, on the same stages, in its own environment.

Its solver is MuJoCo's on the CPU: what differs from MuJoCo is what Newton read in the USD, and
which defaults it has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from assetbuild.engine.world import World
from assetbuild.simulators import physx
from assetbuild.simulators.environments import Environment, ask

HOME = Environment("newton", ("newton[sim,importers]==1.8.0",))
PROGRAM = Path(__file__).with_name("_newton_motion_child.py")
BEYOND_IMPORTS = (
    "assetbuild.simulators._newton_motion_child",
    "assetbuild.simulators._newton_child",
)


def perform(
    main: Path, experiments: Sequence[physx.Experiment], seconds: float
) -> Mapping[str, physx.Outcome]:
    """As `physx.perform`; `held` is the JSON that the program writes."""

    def start(runs: list[dict[str, object]], folder: Path, limit: float) -> str:
        python = HOME.python(World())
        if python is None:
            return "Newton is not installed"
        _, failure = ask(python, PROGRAM, {"runs": runs, "answers": str(folder)}, folder, limit)
        return f"Newton: {failure}" if failure else ""

    return physx.perform_in(start, lambda raw, _: raw, main, experiments, seconds)
