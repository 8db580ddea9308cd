"""The command line as a user runs it: a child process, a store and a folder of its own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from dataclasses import dataclass
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
class Place:
    """A folder with a recipe and its robot, and a store. name: the recipe's path in the folder."""

    folder: Path
    store: Path
    name: str = "legs.yaml"

    @property
    def recipe(self) -> Path:
        return self.folder / self.name

    @property
    def robot(self) -> Path:
        return self.folder / "robot"

    @property
    def urdf(self) -> Path:
        """The URDF of the robot with four legs."""
        return self.robot / "four_legs.urdf"

    @property
    def bundle(self) -> Path:
        return self.folder / "build" / self.recipe.stem

    def manifest(self) -> bytes:
        return (self.bundle / "manifest.json").read_bytes()

    def command(self, *words: str) -> list[str]:
        return commands.command(*words)

    def env(self, **more: str) -> dict[str, str]:
        kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
        return kept | {"ASSETBUILD_CACHE": str(self.store)} | more

    def run(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return commands.run(words, self.folder, self.env(**environment), timeout=600)

    def build(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return self.run("build", self.name, *words, **environment)

    def refused(self, *words: str, code: int = 2, **environment: str) -> str:
        """Standard error of a command that the user has to mend: one error, and no traceback."""
        done = self.run(*words, **environment)
        assert done.returncode == code, done.stdout + done.stderr
        assert "Traceback" not in done.stdout + done.stderr
        assert done.stderr.count("error: ") == 1, done.stderr
        return done.stderr

    def steps(self) -> dict[str, str]:
        """Status of each step in the last build."""
        log = json.loads(self.bundle.with_name(f"{self.bundle.name}.run.json").read_text())
        return {label: step["status"] for label, step in log["steps"].items()}

    def ran(self) -> set[str]:
        """Build; labels of the steps that ran."""
        done = self.build()
        assert done.returncode == 0, done.stdout + done.stderr
        return {label for label, status in self.steps().items() if status == "ran"}

    def edit(self, old: str, new: str) -> None:
        """Change the recipe."""
        text = self.recipe.read_text()
        assert old in text
        self.recipe.write_text(text.replace(old, new))


def new_go1(folder: Path, go1_root: Path, store: Path) -> Place:
    """Go1 as a `path` source: a copy that a test may edit."""
    place = Place(folder, store, "recipes/go1.yaml")
    shutil.copytree(go1_root / "robots/go1_description", place.robot / "robots/go1_description")
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
        new_go1(tmp_path_factory.mktemp("first"), go1_root, store).ran()

    return made_once("go1-store", build, tmp_path_factory)


@pytest.fixture
def place(tmp_path: Path, go1_root: Path, built_store: Path) -> Place:
    """Go1 with a store in which every step is done."""
    return new_go1(tmp_path, go1_root, shutil.copytree(built_store, tmp_path / "warm-store"))


def new_legs(folder: Path, store: Path | None = None) -> Place:
    """A robot without meshes: built in a moment."""
    place = Place(folder, store or folder / "store")
    place.robot.mkdir(parents=True)
    shutil.copyfile(LEGS, place.urdf)
    place.recipe.write_text(LEGS_RECIPE)
    return place


@pytest.fixture
def legs(tmp_path: Path) -> Place:
    return new_legs(tmp_path / "legs")


@pytest.fixture(scope="session")
def legs_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store that holds a finished build of the legs, of all workers: tests work on copies."""

    def build(store: Path) -> None:
        new_legs(tmp_path_factory.mktemp("first") / "legs", store).ran()

    return made_once("legs-store", build, tmp_path_factory)


@pytest.fixture
def warm_legs(tmp_path: Path, legs_store: Path) -> Place:
    """The four legs with a store in which every step is done."""
    return new_legs(tmp_path / "legs", shutil.copytree(legs_store, tmp_path / "warm-store"))


@pytest.fixture(scope="module")
def built_legs(tmp_path_factory: pytest.TempPathFactory, legs_store: Path) -> Place:
    """The four legs with their bundle, of all tests of a module: put right what you change."""
    folder = tmp_path_factory.mktemp("built")
    legs = new_legs(folder / "legs", shutil.copytree(legs_store, folder / "store"))
    assert legs.build().returncode == 0
    return legs
