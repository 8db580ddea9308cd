"""After an edit of the package a build runs the steps that the edited code reaches."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from .conftest import PACKAGE

ROBOTS = Path(__file__).parents[1] / "robots"
LEGS = """\
schema: assetbuild/v1
robot: four_legs
source: {path: ., urdf: four_legs.urdf, license: MIT}
collision: {default: {method: keep}}
targets: [urdf, mjcf]
"""


class Edited:
    """A robot, and a copy of the package that builds it."""

    def __init__(self, folder: Path, package: Path) -> None:
        self.folder, self.package = folder, package
        shutil.copyfile(ROBOTS / "four_legs.urdf", folder / "four_legs.urdf")
        (folder / "legs.yaml").write_text(LEGS)

    def edit(self, module: str, old: str, new: str) -> None:
        path = self.package / "assetbuild" / module
        text = path.read_text()
        assert text.count(old) == 1
        path.write_text(text.replace(old, new))

    def build(self) -> dict[str, str]:
        """Label -> why it ran, of the steps that ran."""
        words = ("build", "legs.yaml", "-o", "out", "--log-json", "log", "--fail-on=never")
        environment = {"PYTHONPATH": str(self.package), "ASSETBUILD_CACHE": str(self.folder / "c")}
        done = subprocess.run(
            [sys.executable, "-P", "-m", "assetbuild", *words],
            cwd=self.folder,
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            timeout=600,
        )
        assert done.returncode == 0, done.stderr
        events = [json.loads(line) for line in (self.folder / "log").read_text().splitlines()]
        return {e["step"]: e["reason"] for e in events if e.get("status") == "ran"}


@pytest.fixture
def edited(tmp_path: Path) -> Edited:
    package, caches = tmp_path / "package", shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE, package / "assetbuild", ignore=caches)
    return Edited(tmp_path, package)


@pytest.mark.slow
def test_a_build_runs_the_steps_whose_code_was_edited_and_no_others(edited: Edited):
    """That these are all steps whose code reaches the edited module: `test_code`."""
    first = edited.build()
    assert {"read_urdf", "merge_fixed_joints", "urdf", "mjcf"} <= first.keys()
    mass = mass_of(edited.folder / "out")

    edited.edit("robot/inertia.py", "mass = math.fsum(", "mass = 2.0 * math.fsum(")
    reasons = edited.build()
    assert reasons["merge_fixed_joints"] == "code assetbuild.robot.inertia changed"
    # A calf of 0.2 kg and its foot of 0.05 kg are combined, on each leg.
    assert mass_of(edited.folder / "out") - mass == pytest.approx(4 * 0.25)
    assert reasons.keys() < first.keys()
    edited_or_after = ("code assetbuild.robot.inertia changed", "input")
    assert all(why.startswith(edited_or_after) for why in reasons.values())

    # A docstring and the recipe's models are no code of a step.
    edited.edit("robot/inertia.py", '"""One rigid body made', '"""A rigid body made')
    edited.edit("recipe/models.py", "class Recipe(", "ADDED = 1\n\n\nclass Recipe(")
    edited.edit("mesh/hull.py", "import numpy as np\n", "import numpy as np\n\nADDED = 1\n")
    assert set(edited.build().values()) == {"code assetbuild.mesh.hull changed"}


def mass_of(bundle: Path) -> float:
    model = mujoco.MjModel.from_xml_path(str(bundle / "mjcf/four_legs.xml"))
    return float(model.body_mass.sum())
