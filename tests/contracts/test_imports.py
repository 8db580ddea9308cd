"""No imports in circles; a step knows no recipe, and its worker loads no more than it needs.

import-linter's contract speaks of packages and modules side by side; this one also sees a package's
own `__init__`, late imports and those for types alone.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import grimp
import networkx
import pytest
from workers import kind_of

from assetbuild.engine.code import Code
from assetbuild.engine.doors import SHARED, environment
from assetbuild.simulators.consumers import ConsumerCheck

from .conftest import step_classes


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("assetbuild", cache_dir=None)


def test_no_modules_import_one_another_in_a_circle(graph: grimp.ImportGraph):
    imports = networkx.DiGraph(
        (module, found)
        for module in graph.modules
        for found in graph.find_modules_directly_imported_by(module)
    )
    circles = networkx.strongly_connected_components(imports)
    assert [sorted(circle) for circle in circles if len(circle) > 1] == []


NUMERIC = {"coacd", "fast-simplification", "manifold3d", "mujoco", "networkx", "numpy"}
NUMERIC |= {"pillow", "pin", "pycollada", "scipy", "trimesh", "usd-core", "vhacdx", "yourdfpy"}


def test_what_a_step_imports_reaches_no_recipe(graph: grimp.ImportGraph):
    recipe = {name for name in graph.modules if name.startswith("assetbuild.recipe.")}
    steps = {step.__module__ for step in step_classes()}
    assert {step for step in steps if graph.find_upstream_modules(step) & recipe} == set()


def test_a_step_that_computes_runs_in_a_child_with_pinned_kernels(code: Code):
    """A trainer's figures come from a process of its own, mostly of a GPU."""
    here = [s for s in step_classes() if s.in_parent and not issubclass(s, ConsumerCheck)]
    assert here  # at least those that fetch
    assert {s.__name__ for s in here if NUMERIC & code.of(s).libraries.keys()} == set()


HEAVY = {"mujoco", "pxr", "trimesh", "scipy", "coacd", "vhacdx", "manifold3d", "yourdfpy", "glfw",
         "pinocchio", "networkx", "OpenGL", "PIL", "collada", "jinja2", "rich", "yaml",
         "fast_simplification", "torch", "matplotlib"}  # fmt: skip
LOADED = (
    "import importlib, json, sys\n"
    "[importlib.import_module(name) for name in sys.argv[1:]]\n"
    "print(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))\n"
)


def test_a_worker_has_no_heavy_library_that_its_steps_do_not_name(tmp_path: Path):
    steps = [step for step in step_classes() if not step.in_parent]
    for kind in dict.fromkeys(kind_of(step) for step in steps):
        own = {step.__module__ for step in steps if kind_of(step) == kind}
        made = subprocess.run(
            [sys.executable, "-c", LOADED, *SHARED, *kind.preload, *sorted(own)],
            env=environment(kind, tmp_path) | {"PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            check=True,
        )
        named = {module.partition(".")[0] for module in kind.preload}
        assert HEAVY & set(json.loads(made.stdout)) <= named, (kind, own)
