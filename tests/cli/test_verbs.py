"""Small verbs: fast help, light check, schema, plan."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise

import networkx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from assetbuild.cli import VERBS
from assetbuild.pipeline.drawing import critical_path

from .conftest import Legs

HEAVY = ("mujoco", "pxr", "trimesh", "coacd", "scipy", "yourdfpy", "collada", "pinocchio")


def test_help_imports_nothing_heavy():
    """All verbs in one process: what one of them loads is there in the end."""
    code = (
        "import sys\nfrom assetbuild.cli import main\nfor verb in sys.argv[1:]:\n"
        "    try:\n        main([verb, '--help'])\n    except SystemExit:\n        pass\n"
        "sys.stderr.write(' '.join(sorted(m.split('.')[0] for m in sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code, *VERBS], capture_output=True, text=True)
    loaded = set(done.stderr.split())
    assert not loaded & {*HEAVY, "pydantic", "yaml", "numpy", "networkx"}


def test_check_runs_no_heavy_step(warm_legs: Legs):
    code = (
        "import sys\nfrom assetbuild.cli import main\ncode = main(['check', 'legs.yaml'])\n"
        "sys.stderr.write(' '.join(sorted(m.split('.')[0] for m in sys.modules)))\nsys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=warm_legs.folder,
        env=warm_legs.env(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert not set(done.stderr.split()) & set(HEAVY)


def test_the_null_build_imports_almost_nothing(warm_legs: Legs):
    warm_legs.build()
    code = (
        "import sys\nsys.argv = ['assetbuild', 'build', 'legs.yaml']\n"
        "from assetbuild.__main__ import main\ncode = main()\n"
        "sys.stderr.write(' '.join(sorted(m.split('.')[0] for m in sys.modules)))\nsys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=warm_legs.folder,
        env=warm_legs.env(),
        capture_output=True,
        text=True,
    )
    assert "0 ran" in done.stdout
    bare = [sys.executable, "-c", "import sys; print(*(m.split('.')[0] for m in sys.modules))"]
    always = set(subprocess.run(bare, capture_output=True, text=True).stdout.split())
    slow = {"pydantic", "yaml", "numpy", "networkx", "argparse", "json", "typing", "pathlib"}
    assert not (set(done.stderr.split()) - always) & {*HEAVY, *slow}


def test_the_schema_describes_every_key(warm_legs: Legs):
    schema = json.loads(warm_legs.run("schema").stdout)
    assert {"robot", "source", "actuators"} <= schema["properties"].keys()


def test_plan_prints_the_graph(warm_legs: Legs):
    graph = json.loads(warm_legs.run("plan", "legs.yaml", "--format", "json").stdout)
    labels = {node["label"] for node in graph["nodes"]}
    assert {"read_urdf", "merge_fixed_joints", "assemble", "control", "urdf"} <= labels
    assert warm_legs.run("plan", "legs.yaml", "--format", "dot").stdout.startswith("digraph")
    assert "<graphml" in warm_legs.run("plan", "legs.yaml", "--format", "graphml").stdout


def test_plan_names_what_a_change_reaches(warm_legs: Legs):
    urdf = str(warm_legs.urdf)
    for name in (urdf, "read_urdf"):
        told = warm_legs.run("plan", "legs.yaml", "--stale", name).stdout.splitlines()
        assert told[0].startswith(f"a change of `{name}` can reach ")
        assert {"read_urdf", "control", "urdf"} <= {line.split()[-1] for line in told}
    wrong = warm_legs.run("plan", "legs.yaml", "--stale", "controll")
    assert wrong.returncode == 2
    assert "did you mean `control`?" in wrong.stderr


@pytest.mark.parametrize("name", ["control", "actuators", "actuators.0.kp"])
def test_a_gain_reaches_the_targets_and_no_geometry(warm_legs: Legs, name: str):
    asked = ("plan", "legs.yaml", "--stale", name, "--format", "json")
    labels = {row["label"] for row in json.loads(warm_legs.run(*asked).stdout)}
    assert {"control", "urdf"} <= labels
    assert not labels & {"read_urdf", "merge_fixed_joints", "assemble"}


def test_a_key_without_another_value_is_told(warm_legs: Legs):
    done = warm_legs.run("plan", "legs.yaml", "--stale", "robot")
    assert done.returncode == 2
    assert "`robot` is a key of the recipe of which no value can be changed alone" in done.stderr


def test_plan_names_what_a_build_waits_for(warm_legs: Legs):
    asked = ("plan", "legs.yaml", "--format", "json")
    nodes = json.loads(warm_legs.run(*asked).stdout)["nodes"]
    reads = {
        node["label"]: {ref.rpartition(":")[0] for ref in node["inputs"].values()} for node in nodes
    }
    rows = json.loads(warm_legs.run(*asked, "--critical").stdout)
    path = [row["label"] for row in rows]
    assert len(path) > 3
    assert all(maker in reads[reader] for maker, reader in pairwise(path))
    told = warm_legs.run("plan", "legs.yaml", "--critical").stdout.splitlines()
    assert told[0].startswith(f"a build with enough cores waits for {len(path)} steps")
    assert all(line.endswith(f"  {label}") for line, label in zip(told[1:], path, strict=True))


@given(
    st.lists(st.tuples(st.sets(st.integers(0, 7)), st.integers(1, 50)), min_size=1, max_size=8),
)
def test_the_critical_path_is_the_longest(steps: list[tuple[set[int], int]]):
    net = networkx.MultiDiGraph()
    for index, (_, seconds) in enumerate(steps):
        net.add_node(index, kind="step", seconds=float(seconds))
    net.add_edges_from((m, i) for i, (makers, _) in enumerate(steps) for m in makers if m < i)
    ends: list[int] = []  # seconds until each step is done, with cores enough
    for index, (makers, seconds) in enumerate(steps):
        ends.append(seconds + max((ends[m] for m in makers if m < index), default=0))
    path = critical_path(net)
    assert sum(steps[index][1] for index in path) == max(ends)
    assert all(maker in steps[reader][0] for maker, reader in pairwise(path))
