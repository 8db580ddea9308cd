"""Several recipes as one graph, and `--rebuild-check`, on the real Go1."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from .conftest import Workplace


@pytest.mark.slow
def test_two_recipes_are_one_graph_and_share_their_steps(place: Workplace):
    text = place.recipe.read_text()
    other = place.folder / "recipes/other.yaml"
    other.write_text(text.replace("robot: go1", "robot: other", 1))
    done = place.run("build", "recipes/go1.yaml", "recipes/other.yaml", "-j2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "go1: ready" in done.stdout
    assert "other: ready" in done.stdout
    logs = [
        json.loads((place.folder / f"build/{n}.run.json").read_text()) for n in ("go1", "other")
    ]
    assert {step["status"] for step in logs[0]["steps"].values()} <= {"cached", "ran"}
    assert "read_urdf" in logs[1]["steps"]
    assert (place.folder / "build/other/manifest.json").is_file()
    alone = place.build()
    assert "0 ran" in alone.stdout
    _an_edit_of_one_leaves_the_bundle_of_the_other(place, other)


def _an_edit_of_one_leaves_the_bundle_of_the_other(place: Workplace, other: Path):
    bundles = [place.folder / "build" / name for name in ("go1", "other")]
    before = [bundle.stat().st_ino for bundle in bundles]
    other.write_text(other.read_text() + "# a word\n")
    done = place.run("build", "recipes/go1.yaml", "recipes/other.yaml", "-j2")
    assert done.returncode == 0, done.stdout + done.stderr
    after = [bundle.stat().st_ino for bundle in bundles]
    assert after[0] == before[0]
    assert after[1] != before[1]  # its provenance names the recipe's digest


def test_two_recipes_of_one_robot_are_refused(place: Workplace):
    (place.folder / "recipes/again.yaml").write_text(place.recipe.read_text())
    done = place.run("build", "recipes/go1.yaml", "recipes/again.yaml")
    assert done.returncode == 2
    assert "two of the recipes build `go1`" in done.stderr


@pytest.mark.slow
def test_the_real_robot_is_reproducible(place: Workplace):
    done = place.build("--rebuild-check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "go1: reproducible: every step gave the same bytes twice" in done.stdout
    assert not (place.folder / "build/go1.rebuild-check").exists()
