"""Small verbs: fast help, light check, schema, plan."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from assetbuild.cli import VERBS

from .conftest import Place

HEAVY = {"mujoco", "pxr", "trimesh", "coacd", "scipy", "yourdfpy", "collada", "pinocchio"}
SLOW = {"pydantic", "yaml", "numpy", "networkx"}
MODULES = "print(*{name.split('.')[0] for name in sys.modules}, file=sys.stderr)"
HELP = """\
for verb in sys.argv[1:]:
    try:
        main([verb, "--help"])
    except SystemExit:
        pass
"""


def loaded(code: str, *words: str, place: Place | None = None) -> tuple[str, set[str]]:
    """The output of `code` in a Python of its own, and the modules that are there in the end."""
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{code}\n{MODULES}", *words],
        cwd=place.folder if place else Path.cwd(),
        env=place.env() if place else os.environ,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout, set(done.stderr.split())


def test_help_imports_nothing_heavy():
    """All verbs in one process: what one of them loads is there in the end."""
    told, modules = loaded(f"from assetbuild.cli import main\n{HELP}", *VERBS)
    assert "usage: assetbuild build" in told
    assert not modules & (HEAVY | SLOW)


def test_check_runs_no_heavy_step(warm_legs: Place):
    code = "from assetbuild.cli import main\nassert main(['check', 'legs.yaml']) == 0"
    assert not loaded(code, place=warm_legs)[1] & HEAVY


def test_the_null_build_imports_almost_nothing(warm_legs: Place):
    warm_legs.build()
    code = "from assetbuild.__main__ import main\nassert main() == 0"
    told, modules = loaded(code, "build", "legs.yaml", place=warm_legs)
    assert "0 ran" in told
    _, always = loaded("")
    assert not (modules - always) & (HEAVY | SLOW | {"argparse", "json", "typing", "pathlib"})


def test_the_schema_describes_every_key(warm_legs: Place):
    schema = json.loads(warm_legs.run("schema").stdout)
    assert {"robot", "source", "actuators"} <= schema["properties"].keys()


def test_plan_prints_the_graph(warm_legs: Place):
    graph = json.loads(warm_legs.run("plan", "legs.yaml", "--format", "json").stdout)
    labels = {node["label"] for node in graph["nodes"]}
    assert {"read_urdf", "merge_fixed_joints", "assemble", "control", "urdf"} <= labels
    assert warm_legs.run("plan", "legs.yaml", "--format", "dot").stdout.startswith("digraph")
