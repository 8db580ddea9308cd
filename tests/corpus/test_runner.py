"""The runner of the corpus: its outcomes, its rules, and a run that was stopped."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from urdfs import box, inertial, joint, link, robot, shape

from tests.corpus.__main__ import in_a_child, rows_in
from tests.corpus.lists import Robot, wide
from tests.corpus.one import one
from tests.corpus.rules import broken

ROOT = Path(__file__).parents[2]

GOOD = robot(
    link("base", inertial(2.0), shape("visual", box(0.2))),
    link("arm", inertial(xyz="0 0 0.1"), shape("visual", box(0.1), "0 0 0.1")),
    joint("elbow", "base", "arm", xyz="0 0 0.1"),
)
BROKEN = GOOD.replace('<child link="arm"/>', '<child link="nowhere"/>')
LIST = """
sources:
  - github: someone/robots
    commit: 0123456789abcdef
    license: MIT
    robots: [good.urdf, broken.urdf, absent.urdf]
"""


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    folder = tmp_path / "sources/someone+robots"
    folder.mkdir(parents=True)
    (folder / "good.urdf").write_text(GOOD)
    (folder / "broken.urdf").write_text(BROKEN)
    (tmp_path / "list.yaml").write_text(LIST)
    return folder.parent


def test_a_list_is_split_by_the_names(sources: Path):
    whole = wide(sources, sources.parent / "list.yaml")
    halves = [wide(sources, sources.parent / "list.yaml", half) for half in "ab"]
    assert sorted(r.name for half in halves for r in half) == sorted(r.name for r in whole)
    assert {r.half for r in halves[0]} <= {"a"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "rule"),
    [
        ('<child link="arm"/>', '<child link="nowhere"/>', "tree"),
        ('<link name="base">', '<link name="other"/><link name="base">', "tree"),
        ("</joint>", '<mimic joint="none"/></joint>', "mimic"),
        ('lower="-1"', 'lower="2"', "limits"),
        ('value="2.0"', 'value="-2"', "mass"),
        ('value="2.0"', 'value="20000"', "absurd"),
        ('<mass value="', '<mass value="0" was="', "massless"),
        ('value="2.0"', 'value="nan"', "number"),
        ('ixx="0.01"', 'ixx="-0.01"', "tensor"),
        (GOOD, "<robot name=", "readers"),
    ],
)  # fmt: skip
def test_a_broken_source_is_known_by_its_rule(old: str, new: str, rule: str, tmp_path: Path):
    file = tmp_path / "robot.urdf"
    file.write_text(GOOD)
    assert broken(file) == ""
    file.write_text(GOOD.replace(old, new))
    assert broken(file).partition(":")[0] == rule


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on(sources: Path, tmp_path: Path):
    table, lines = tmp_path / "table.md", tmp_path / "table.jsonl"
    done = {"robot": "someone/robots/absent.urdf", "result": "refused", "note": "", "seconds": 0}
    lines.write_text(json.dumps(done) + '\n{"robot": "someone/ro')  # killed while it wrote
    program = [sys.executable, "-m", "tests.corpus", "-o", str(table), "--jobs", "2"]
    words = ["--list", str(tmp_path / "list.yaml"), "--sources", str(sources)]
    subprocess.run([*program, *words], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    rows = rows_in(lines)
    assert rows["someone/robots/absent.urdf"]["result"] == "refused"  # it did not run again
    good, bad = (rows[f"someone/robots/{name}.urdf"] for name in ("good", "broken"))
    assert (good["result"], good["judge"], good["actuators"]) == ("ready", "equal", 1)
    assert (bad["result"], bad["cause"]) == ("left out", "tree")
    assert "| someone/robots/good | ready |" in table.read_text()


def test_a_robot_whose_file_is_not_there_is_left_out(tmp_path: Path):
    row = in_a_child(Robot("r", tmp_path / "r.urdf", tmp_path), tmp_path, 1.0)
    assert (row["result"], row["cause"]) == ("left out", "file")


@pytest.mark.slow
def test_a_build_that_does_not_end_is_an_outcome(sources: Path, tmp_path: Path):
    folder = sources / "someone+robots"
    row = in_a_child(Robot("r", folder / "good.urdf", folder), tmp_path, 0.01)
    assert (row["result"], row["cause"]) == ("failed", "init: time")


@pytest.mark.slow
def test_a_child_that_dies_is_an_outcome(sources: Path, tmp_path: Path):
    folder = sources / "someone+robots"
    (tmp_path / "r").write_text("a file where the robot's folder should be")
    row = in_a_child(Robot("r", folder / "good.urdf", folder), tmp_path, 60.0)
    assert row["result"] == "failed"
    assert str(row["cause"]).startswith("runner: exit code")


REAL = {
    "quadruped_description/urdf/quadruped.urdf": "locked knees, meshes beside the URDF",
    "hector_description/robots/quadrotor_base.urdf": "nothing moves but its base",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_a_real_robot_is_ready_and_equal_to_its_source(
    name: str, go1_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    if not (go1_root / "robots" / name).is_file():
        pytest.skip(f"no {name} in {go1_root}: name the unpacked package in ASSETBUILD_TEST_DATA")
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))
    row = one(Robot(name, go1_root / "robots" / name, go1_root), tmp_path)
    assert (row["result"], row["judge"], row["lost"]) == ("ready", "equal", []), row["note"]
