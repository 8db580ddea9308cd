"""The command line as a user runs it: a child process, a store and a folder of its own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import commands
import pytest
from once import made_once

RECIPE = Path(__file__).parents[2] / "recipes" / "go1.yaml"
LEGS = Path(__file__).parents[1] / "robots" / "four_legs.urdf"
LEGS_RECIPE = """\
schema: assetbuild/v1
robot: legs
source: {path: robot, urdf: four_legs.urdf, license: MIT}
base: floating
collision: {default: {method: keep}}
actuators:
  - {joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}
targets: [urdf]
"""


def hear_ctrl_c() -> None:
    """In a new process: tests that run in the background of a shell are deaf to it themselves."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@dataclass
class Workplace:
    """A folder with `recipes/go1.yaml`, a copy of the robot, and a store."""

    folder: Path
    store: Path
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def recipe(self) -> Path:
        return self.folder / "recipes" / "go1.yaml"

    @property
    def bundle(self) -> Path:
        return self.folder / "build" / "go1"

    @property
    def robot(self) -> Path:
        return self.folder / "robot"

    @property
    def urdf(self) -> Path:
        return self.robot / "robots/go1_description/urdf/go1.urdf"

    def run(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return commands.run(words, self.folder, self.env(**environment), timeout=600)

    def command(self, *words: str) -> list[str]:
        return commands.command(*words)

    def env(self, **more: str) -> dict[str, str]:
        kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
        return kept | {"ASSETBUILD_CACHE": str(self.store)} | self.environment | more

    def build(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return self.run("build", "recipes/go1.yaml", *words, **environment)

    def ran(self) -> set[str]:
        """Labels of the steps that ran in the last build."""
        log = json.loads((self.folder / "build" / "go1.run.json").read_text())
        return {label for label, step in log["steps"].items() if step["status"] == "ran"}

    def edit_recipe(self, old: str, new: str) -> None:
        text = self.recipe.read_text()
        assert old in text
        self.recipe.write_text(text.replace(old, new))


def new_workplace(folder: Path, go1_root: Path, store: Path) -> Workplace:
    """Go1 as a `path` source: a copy that a test may edit."""
    place = Workplace(folder, store)
    source = go1_root / "robots/go1_description"
    shutil.copytree(source, folder / "robot/robots/go1_description")
    place.recipe.parent.mkdir(parents=True)
    place.recipe.write_text(from_path(RECIPE.read_text()))
    return place


def from_path(recipe: str) -> str:
    """A recipe of Go1 whose source is the copy in a workplace."""
    begin, end = recipe.index("  pypi:"), recipe.index("  urdf:")
    return f"{recipe[:begin]}  path: ../robot\n{recipe[end:]}"


@pytest.fixture(scope="session")
def built_store(tmp_path_factory: pytest.TempPathFactory, go1_root: Path) -> Path:
    """A store that holds a finished build of Go1, of all workers: tests work on copies."""

    def build(store: Path) -> None:
        done = new_workplace(tmp_path_factory.mktemp("first"), go1_root, store).build()
        assert done.returncode == 0, done.stdout + done.stderr

    return made_once("go1-store", build, tmp_path_factory)


@pytest.fixture
def place(tmp_path: Path, go1_root: Path, built_store: Path) -> Workplace:
    """A workplace whose store is warm."""
    return new_workplace(tmp_path, go1_root, shutil.copytree(built_store, tmp_path / "warm-store"))


@pytest.fixture
def cold_place(tmp_path: Path, go1_root: Path) -> Workplace:
    """A workplace with an empty store."""
    return new_workplace(tmp_path / "cold", go1_root, tmp_path / "store")


@dataclass
class Legs:
    """A folder with `legs.yaml`, a robot without meshes, and a store: built in a moment."""

    folder: Path
    store: Path

    @property
    def recipe(self) -> Path:
        return self.folder / "legs.yaml"

    @property
    def urdf(self) -> Path:
        return self.folder / "robot/four_legs.urdf"

    @property
    def bundle(self) -> Path:
        return self.folder / "build/legs"

    def command(self, *words: str) -> list[str]:
        return commands.command(*words)

    def env(self, **more: str) -> dict[str, str]:
        kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
        return kept | {"ASSETBUILD_CACHE": str(self.store)} | more

    def run(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return commands.run(words, self.folder, self.env(**environment))

    def build(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return self.run("build", "legs.yaml", *words, **environment)

    def steps(self) -> dict[str, str]:
        """Status of each step in the last build."""
        log = json.loads((self.folder / "build/legs.run.json").read_text())
        return {label: step["status"] for label, step in log["steps"].items()}

    def edit(self, old: str, new: str) -> None:
        text = self.recipe.read_text()
        assert old in text
        self.recipe.write_text(text.replace(old, new))


def new_legs(folder: Path, store: Path | None = None) -> Legs:
    (folder / "robot").mkdir(parents=True)
    shutil.copyfile(LEGS, folder / "robot/four_legs.urdf")
    (folder / "legs.yaml").write_text(LEGS_RECIPE)
    return Legs(folder, store or folder / "store")


@pytest.fixture
def legs(tmp_path: Path) -> Legs:
    return new_legs(tmp_path / "legs")


@pytest.fixture(scope="session")
def legs_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store that holds a finished build of the legs, of all workers: tests work on copies."""

    def build(store: Path) -> None:
        done = new_legs(tmp_path_factory.mktemp("first") / "legs", store).build()
        assert done.returncode == 0, done.stdout + done.stderr

    return made_once("legs-store", build, tmp_path_factory)


@pytest.fixture
def warm_legs(tmp_path: Path, legs_store: Path) -> Legs:
    """The four legs with a store in which every step is done."""
    return new_legs(tmp_path / "legs", shutil.copytree(legs_store, tmp_path / "warm-store"))
