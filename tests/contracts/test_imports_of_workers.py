"""A worker imports what its steps use, and no heavy library besides."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from assetbuild.collision import CollisionMethod
from assetbuild.engine.children import SHARED, Kind, environment
from assetbuild.engine.step import Step
from assetbuild.facts.reader import Reader
from assetbuild.plugin_types import Check, Target
from assetbuild.plugins import load_plugin, own_names

HEAVY = {"mujoco", "pxr", "trimesh", "scipy", "coacd", "vhacdx", "manifold3d", "yourdfpy", "glfw",
         "pinocchio", "networkx", "OpenGL", "PIL", "collada", "jinja2", "rich", "yaml",
         "fast_simplification", "torch", "matplotlib"}  # fmt: skip
LOADED = (
    "import importlib, json, sys\n"
    "[importlib.import_module(name) for name in sys.argv[1:]]\n"
    "print(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))\n"
)


def kinds() -> list[tuple[Kind, list[type[Step]]]]:
    """Each kind of worker with the plug-ins that ask for it."""
    found: dict[Kind, list[type[Step]]] = {}
    for group in (Check, Reader, Target, CollisionMethod):
        for name in own_names(group):
            step = load_plugin(group, name)
            kind = Kind(step.preload, max(1, step.limits.cpus), step.network)
            found.setdefault(kind, []).append(step)
    return list(found.items())


@pytest.mark.parametrize(("kind", "steps"), kinds(), ids=lambda each: str(each)[:40])
def test_a_worker_has_no_heavy_library_that_its_steps_do_not_name(
    kind: Kind, steps: list[type[Step]], tmp_path: Path
):
    modules = [*SHARED, *kind.preload, *sorted({step.__module__ for step in steps})]
    made = subprocess.run(
        [sys.executable, "-c", LOADED, *modules],
        env=environment(kind, tmp_path) | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
    )
    named = {module.partition(".")[0] for module in kind.preload}
    assert HEAVY & set(json.loads(made.stdout)) <= named
