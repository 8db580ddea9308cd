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
from robot_files import edit

from .conftest import PACKAGE

ROBOTS = Path(__file__).parents[1] / "robots"
LEGS = """\
schema: assetbuild/v1
robot: four_legs
source: {path: ., urdf: four_legs.urdf, license: MIT}
collision: {default: {method: keep}}
targets: [urdf, mjcf]
"""


def build(folder: Path) -> dict[str, str]:
    """Label -> why it ran, of the steps that ran."""
    words = ("build", "legs.yaml", "-o", "out", "--log-json", "log", "--fail-on=never")
    environment = {"PYTHONPATH": str(folder / "package"), "ASSETBUILD_CACHE": str(folder / "c")}
    done = subprocess.run(
        [sys.executable, "-P", "-m", "assetbuild", *words],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in (folder / "log").read_text().splitlines()]
    return {e["step"]: e["reason"] for e in events if e.get("status") == "ran"}


@pytest.mark.slow
def test_a_build_runs_the_steps_whose_code_was_edited_and_no_others(tmp_path: Path):
    """That these are all steps whose code reaches the edited module: `test_code`."""
    package = tmp_path / "package/assetbuild"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROBOTS / "four_legs.urdf", tmp_path)
    (tmp_path / "legs.yaml").write_text(LEGS)
    first = build(tmp_path)
    assert {"read_urdf", "merge_fixed_joints", "urdf", "mjcf"} <= first.keys()
    mass = mass_of(tmp_path / "out")

    edit(package / "robot/inertia.py", ("mass = math.fsum(", "mass = 2.0 * math.fsum("))
    reasons = build(tmp_path)
    assert reasons["merge_fixed_joints"] == "code assetbuild.robot.inertia changed"
    # A calf of 0.2 kg and its foot of 0.05 kg are combined, on each leg.
    assert mass_of(tmp_path / "out") - mass == pytest.approx(4 * 0.25)
    assert reasons.keys() < first.keys()
    edited_or_after = ("code assetbuild.robot.inertia changed", "input")
    assert all(why.startswith(edited_or_after) for why in reasons.values())

    # A docstring and the recipe's models are no code of a step.
    edit(package / "robot/inertia.py", ('"""One rigid body made', '"""A rigid body made'))
    edit(package / "recipe/models.py", ("class Recipe(", "ADDED = 1\n\n\nclass Recipe("))
    edit(package / "mesh/hull.py", ("import numpy as np\n", "import numpy as np\n\nADDED = 1\n"))
    assert set(build(tmp_path).values()) == {"code assetbuild.mesh.hull changed"}


def mass_of(bundle: Path) -> float:
    model = mujoco.MjModel.from_xml_path(str(bundle / "mjcf/four_legs.xml"))
    return float(model.body_mass.sum())
