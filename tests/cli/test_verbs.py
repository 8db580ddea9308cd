"""Small verbs: fast help, light check, schema, plan."""

from __future__ import annotations

import json
import subprocess
import sys

from assetbuild.cli import VERBS

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
