"""Several recipes as one graph, and `--rebuild-check`."""

from __future__ import annotations

import json

from .conftest import Legs


def test_two_recipes_are_one_graph_and_share_their_steps(warm_legs: Legs):
    other = warm_legs.folder / "other.yaml"
    other.write_text(warm_legs.recipe.read_text().replace("robot: legs", "robot: other", 1))
    done = warm_legs.build("other.yaml", "-j2")
    assert done.returncode == 0, done.stdout + done.stderr
    bundles = [warm_legs.folder / "build" / name for name in ("legs", "other")]
    for bundle in bundles:
        steps = json.loads(bundle.with_name(f"{bundle.name}.run.json").read_text())["steps"]
        assert steps["read_urdf"]["status"] == "cached"
        assert (bundle / "manifest.json").is_file()
    assert "0 ran" in warm_legs.build().stdout

    before = [bundle.stat().st_ino for bundle in bundles]
    other.write_text(other.read_text() + "# a word\n")
    assert warm_legs.build("other.yaml", "-j2").returncode == 0
    after = [bundle.stat().st_ino for bundle in bundles]
    assert after[0] == before[0]
    assert after[1] != before[1]  # its provenance names the recipe's digest


def test_two_recipes_of_one_robot_are_refused(legs: Legs):
    (legs.folder / "again.yaml").write_text(legs.recipe.read_text())
    done = legs.build("again.yaml")
    assert done.returncode == 2
    assert "two of the recipes build `legs`" in done.stderr


def test_every_step_gives_the_same_bytes_twice(warm_legs: Legs):
    done = warm_legs.build("--rebuild-check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "legs: reproducible: every step gave the same bytes twice" in done.stdout
    assert not (warm_legs.folder / "build/legs.rebuild-check").exists()
