"""What a trainer answered is judged; the child itself runs where its environment is named."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest
from tiny import run_step, tiny_quadruped, write_robot_ports

import assetbuild
from assetbuild.checks.smoke_mjlab import SmokeMjlab, _shown, judged
from assetbuild.cli import main
from assetbuild.engine.world import World
from assetbuild.pipeline.recipes import whole_model
from assetbuild.pipeline.smoking import environments_to_make
from assetbuild.recipe.models import Recipe
from assetbuild.robot.ranges import Randomize
from assetbuild.simulators.children import ask
from assetbuild.simulators.consumers import MADE, Environment, SmokeBounds
from assetbuild.targets.mjlab import Mjlab

BOUNDS = SmokeBounds.model_validate({})
GOOD: dict[str, Any] = {
    "envs": 8,
    "fell": 0,
    "finite": True,
    "walks": True,
    "gpu": False,
    "iterations": 2,
    "weights_finite": True,
    "weights_moved": 0.01,
    "height_m": 0.28,
    "start_m": 0.3,
    "effort_share": 1.0,
    "inconsistent": 0,
    "drawn": 104,
    "mass_ratio": [0.9, 1.1],
}
BAD = {
    "smoke.finite": {"finite": False},
    "smoke.fell": {"fell": 3},
    "smoke.height": {"height_m": 0.2},
    "smoke.effort": {"effort_share": 1.1},
    "smoke.weights": {"weights_moved": 0.0},
    "smoke.inertia": {"inconsistent": 1},
}


def test_a_good_answer_says_nothing() -> None:
    assert list(judged(GOOD, BOUNDS)) == []
    assert list(judged({**GOOD, "effort_share": 1.09}, BOUNDS, effort_factor=1.1)) == []


def test_the_verdict_quotes_what_mjlab_saw() -> None:
    assert _shown(GOOD)["summary"] == (
        "0 of 8 robots fell under zero actions, the root went from 0.300 m to 0.280 m; "
        "then trained for 2 iterations on a CPU"
    )


@pytest.mark.parametrize("rule", BAD)
def test_each_fault_has_its_rule(rule: str) -> None:
    assert [finding.rule for finding in judged({**GOOD, **BAD[rule]}, BOUNDS)] == [rule]


def recipe(**keys: Any) -> Recipe:
    source = {"path": ".", "urdf": "r.urdf"}
    base = {"schema": "assetbuild/v1", "robot": "r", "source": source}
    return whole_model().model_validate(base | keys)


def test_nobody_is_asked_whom_the_recipe_does_not_name() -> None:
    assert SmokeMjlab.configure(recipe()) is None
    ranges = {"joints": {".*": {"effort": [0.9, 1.2]}}}
    step = SmokeMjlab.configure(recipe(validate={"smoke": ["mjlab"]}, randomize=ranges))
    assert step is not None
    assert step.effort_factor == 1.2


def test_an_environment_is_named_by_its_pins_and_counts_when_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path))
    one, other = Environment("t", ("a==1",)), Environment("t", ("a==2",))
    assert one.folder != other.folder
    assert one.folder.is_relative_to(tmp_path)
    (one.folder / "bin").mkdir(parents=True)
    (one.folder / "bin/python").touch()
    assert one.python(World()) is None, "half made"
    (one.folder / MADE).touch()
    assert one.python(World()) is not None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("import sys; sys.exit('no such joint')", "no such joint"),
        ("import os; os.kill(os.getpid(), 9)", "crashed with signal 9"),
        ("import time; time.sleep(60)", "took more than 1 s"),
    ],
)
def test_a_consumer_that_fails_says_why(tmp_path: Path, text: str, why: str) -> None:
    import sys

    program = tmp_path / "child.py"
    program.write_text(text)
    seconds = 1.0 if "sleep" in text else 30.0
    answer, failure = ask(Path(sys.executable), program, {}, tmp_path, seconds)
    assert answer is None
    assert why in failure


def test_mjlab_takes_the_tiny_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Minutes: torch, warp and mjlab are imported, kernels are compiled once."""
    python = os.environ.get("ASSETBUILD_MJLAB_PYTHON")
    if not python:
        pytest.skip("no mjlab here: set ASSETBUILD_MJLAB_PYTHON to the Python of its environment")
    monkeypatch.setattr(Environment, "python", property(lambda self: Path(python)))
    ranges = {
        "links": {".*": {"density": [0.8, 1.2], "com": 0.01}},
        "joints": {".*": {"kp": [0.9, 1.1], "friction": [0.5, 2], "delay": [0, 2]}},
        "friction": [0.4, 1.2],
    }
    target = Mjlab(
        robot="tiny", feet=".*_foot", imu="imu", randomize=Randomize.model_validate(ranges)
    )
    inputs = write_robot_ports(tmp_path / "in", tiny_quadruped())
    run_step(target, inputs, inputs)
    check = SmokeMjlab(robot="tiny", environment="test", envs=4, stand_steps=10, rollout=4)
    assert [f for f in run_step(check, inputs, tmp_path / "out") if f.severity == "error"] == []


def test_every_program_that_a_check_asks_is_there():
    package = Path(assetbuild.__file__).parent
    texts = [path.read_text() for path in (package / "checks").glob("*.py")]
    asked = {name for text in texts for name in re.findall(r'\.answer\("([^"]+)"', text)}
    assert {"mjlab_child.py", "isaaclab_child.py"} <= asked
    assert [name for name in asked if not (package / "simulators" / name).is_file()] == []


def test_a_mistyped_recipe_is_found_before_anything_is_downloaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def download(self: Environment, say: object) -> None:
        raise AssertionError("pip was called")

    monkeypatch.setattr(Environment, "make", download)
    assert main(["smoke", str(tmp_path / "none.yaml"), "--consumer", "mjlab"]) == 2
    assert "there is no such file" in capsys.readouterr().err


def test_what_is_downloaded_is_named_with_its_size_and_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path))
    (line,) = environments_to_make(["mjlab"])
    assert "3.4 GB to download" in line and str(tmp_path) in line
