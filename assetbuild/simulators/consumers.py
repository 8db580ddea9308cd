"""A check that lets somebody else's trainer try the bundle, in an environment of its own."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from assetbuild.engine.step import Limits
from assetbuild.engine.world import World
from assetbuild.findings import Rule
from assetbuild.kinds import Check, RecipeView
from assetbuild.quantities import Model, Positive
from assetbuild.simulators.environments import Environment

FAILED = Rule(
    "smoke.failed",
    "error",
    "the trainer does not accept the bundle; the message is its own",
    "read what it names in `python/`, `mjcf/` or `usd/`",
)
NOT_FINITE = Rule(
    "smoke.finite",
    "error",
    "observations, rewards or weights are not finite",
    "check gains and timestep",
)
SINKS = Rule(
    "smoke.height",
    "warning",
    "the root sinks by more than 30 %",
    "see the checks `stand` and `gains`",
)


class SmokeBounds(Model):
    """What a robot may do under zero actions in a trainer."""

    low: Positive = Field(0.7, lt=1, description="share of the starting height, warning below")
    fallen: Positive = Field(0.25, lt=1, description="share of environments that fall, warning")


class ConsumerCheck(Check):
    """Base of the checks `smoke_<consumer>`: their trainer's versions are part of their key."""

    usual_s = 30.0

    # The work is done by a process of its own, whose place the environment names, and a GPU's
    # runtime takes more address space than any limit would leave it.
    in_parent: ClassVar[bool] = True
    limits: ClassVar[Limits] = Limits(wall_s=3600.0, cpus=2)
    listed_in: ClassVar[str] = "validate.smoke"
    consumer: ClassVar[str]
    home: ClassVar[Environment]

    robot: str
    """Name of the robot: the stem of its files."""
    environment: str
    """Name of the environment, which holds the digest of its requirements."""

    @classmethod
    def listed_as(cls) -> str:
        """The trainer's name."""
        return cls.consumer

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """With the name of its environment, which holds the digest of its requirements."""
        found = super().values(recipe)
        return None if found is None else found | {"environment": cls.home.folder.name}

    def missing(self, world: World) -> str:
        """The environment is made by `assetbuild smoke`, which may use the network."""
        return "" if self.home.python(world) is not None else self.absent()

    @classmethod
    def absent(cls) -> str:
        """How to get the environment."""
        return f"run `assetbuild smoke RECIPE --consumer {cls.consumer}` once"

    def answer(self, program: str, job: dict[str, object]) -> tuple[dict[str, object] | None, str]:
        """What a program found, or why it found nothing. program: its path below this folder."""
        with tempfile.TemporaryDirectory(prefix=f"{self.consumer}-") as folder:
            path = Path(__file__).parent / program
            return self.home.ask(path, job, Path(folder).resolve(), self.limits.wall_s)
