"""Every step knows no recipe, and computes nothing in the process that builds."""

from __future__ import annotations

import inspect

import grimp

from assetbuild.engine.code import Code
from assetbuild.engine.step import Step
from assetbuild.simulators.consumers import ConsumerCheck
from docs.site.pages.rules import package_modules

NUMERIC = {"coacd", "fast-simplification", "manifold3d", "mujoco", "networkx", "numpy"}
NUMERIC |= {"pillow", "pin", "pycollada", "scipy", "trimesh", "usd-core", "vhacdx", "yourdfpy"}


def classes() -> set[type[Step]]:
    """All steps of the package."""
    values = (value for module in package_modules() for value in vars(module).values())
    return {v for v in values if inspect.isclass(v) and issubclass(v, Step)} - {Step}


def test_what_a_step_imports_reaches_no_recipe():
    imports = grimp.build_graph("assetbuild")
    recipe = {name for name in imports.modules if name.startswith("assetbuild.recipe.")}
    steps = {step.__module__ for step in classes()}
    assert {step for step in steps if imports.find_upstream_modules(step) & recipe} == set()


def test_a_step_that_computes_runs_in_a_child_with_pinned_kernels():
    """A trainer's figures come from a process of its own, mostly of a GPU."""
    code = Code()
    here = {step for step in classes() if step.in_parent and not issubclass(step, ConsumerCheck)}
    assert here  # at least those that fetch
    assert {s.__name__: sorted(NUMERIC & code.of(s).libraries.keys()) for s in here} == {
        step.__name__: [] for step in here
    }
