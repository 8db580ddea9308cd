"""Other people's trainers: the environments that they need, and checks that let them try a bundle.

Their pins clash with ours, and with one another's. An environment is made once, below the store's
folder, by `venv` and `pip`; its name holds the digest of its requirements and of this Python, so
that a new pin is a new environment. Nothing here runs during a build: `make` is called before one,
by `assetbuild smoke`.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from assetbuild.engine.machine import cache_root
from assetbuild.engine.step import Limits
from assetbuild.engine.world import World
from assetbuild.errors import MachineError
from assetbuild.findings import Rule
from assetbuild.plugin_types import Check, RecipeView
from assetbuild.recipe_types import Model, Positive
from assetbuild.simulators.children import ask, last_line

MADE = "assetbuild.json"
"""Written last: an environment without it is half made."""


@dataclass(frozen=True)
class Environment:
    """Packages that one consumer needs. requirements: as pip reads them, pinned.

    version: of Python; ours unless the packages need another. size: measured on Linux, for people.
    variable: of the user's environment, by which the Python of an installation takes its place.
    """

    name: str
    requirements: tuple[str, ...]
    version: tuple[int, int] = sys.version_info[:2]
    size: str = ""
    variable: str = ""

    @property
    def folder(self) -> Path:
        """Where it lies, made or not."""
        key = json.dumps([self.requirements, self.version])
        digest = hashlib.sha256(key.encode()).hexdigest()[:12]
        return Path(cache_root()) / "environments" / f"{self.name}-{digest}"

    def python(self, world: World) -> Path | None:
        """Its interpreter, or the one that the user names; None where that is missing."""
        if named := self._named(world):
            return named if world.is_file(named) else None
        python = self.folder / "bin" / "python"
        made = world.is_file(self.folder / MADE) and world.is_file(python)
        return python if made else None

    def ask(
        self, program: Path, job: dict[str, object], folder: Path, seconds: float
    ) -> tuple[dict[str, object] | None, str]:
        """Ask as `children.ask`, by its Python; what that compiles lies beside the environment."""
        python = self.python(World())
        if python is None:
            return None, f"{self.name} is not installed"
        variables = {
            "WARP_CACHE_PATH": str(python.parents[1] / "kernels"),
            "MUJOCO_GL": "disable",
            "WANDB_MODE": "disabled",
        }
        return ask(python, program, job, folder, seconds, variables)

    def make(self, say: Callable[[str], None]) -> None:
        """Make it where it is missing. MachineError when that fails."""
        if self._named(World()) or self.python(World()):
            return
        packages = " ".join(self.requirements)
        say(f"making the environment of {self.name}: pip install {packages}")
        half = self.folder.with_name(f"{self.folder.name}.{os.getpid()}.half")
        half.parent.mkdir(parents=True, exist_ok=True)
        try:
            _run([self._interpreter(), "-m", "venv", str(half)])
            _run([str(half / "bin" / "python"), "-m", "pip", "install", *self.requirements])
            if not self.folder.exists():
                half.rename(self.folder)
        finally:
            shutil.rmtree(half, ignore_errors=True)
        made = json.dumps({"requirements": self.requirements}) + "\n"
        (self.folder / MADE).write_text(made, encoding="utf-8")

    def _named(self, world: World) -> Path | None:
        named = world.variable(self.variable) if self.variable else None
        return Path(named) if named else None

    def _interpreter(self) -> str:
        """A Python of this version; MachineError where there is none."""
        if self.version == sys.version_info[:2]:
            return sys.executable
        name = "python{}.{}".format(*self.version)
        path = shutil.which(name)
        # pyenv puts a shim on the PATH for versions that are not selected; it fails when called.
        if (
            path is None
            or subprocess.run([path, "-V"], check=False, capture_output=True).returncode
        ):
            raise MachineError(
                f"{self.name} needs {name}, which is not on the PATH",
                hint=f"your system's packages have it, or `uv python install {name[6:]}`",
            )
        return path


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, check=False, capture_output=True)
    if done.returncode:
        raise MachineError(
            f"the environment could not be made: {last_line(done.stderr)}",
            hint="pip needs the network; `assetbuild doctor` looks at the machine",
        )


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
    home: ClassVar[Environment]

    robot: str
    """Name of the robot: the stem of its files."""
    environment: str
    """Name of the environment, which holds the digest of its requirements."""

    @classmethod
    def listed_as(cls) -> str:
        """The trainer's name."""
        return cls.home.name

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """Add the name of its environment, which holds the digest of its requirements."""
        fields = super().values(recipe)
        return None if fields is None else fields | {"environment": cls.home.folder.name}

    def missing(self, world: World) -> str:
        """The environment is made by `assetbuild smoke`, which may use the network."""
        return "" if self.home.python(world) is not None else self.absent()

    @classmethod
    def absent(cls) -> str:
        """How to get the environment."""
        other = f", or set {cls.home.variable} to your installation's Python"
        way = f"run `assetbuild smoke RECIPE --consumer {cls.home.name}` once"
        return f"{way}{other if cls.home.variable else ''}"

    def answer(self, program: str, job: dict[str, object]) -> tuple[dict[str, object] | None, str]:
        """What a program found, or why it found nothing. program: its path below this folder."""
        with tempfile.TemporaryDirectory(prefix=f"{self.home.name}-") as folder:
            path = Path(__file__).parent / program
            return self.home.ask(path, job, Path(folder).resolve(), self.limits.wall_s)
