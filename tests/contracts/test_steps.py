"""No step knows the recipe: a new key of a recipe makes no step run again that does not read it."""

from __future__ import annotations

import inspect

import grimp
import pytest

from assetbuild.engine.step import Step
from assetbuild.pipeline.reference import package_modules


@pytest.fixture(scope="module")
def imports() -> grimp.ImportGraph:
    return grimp.build_graph("assetbuild")


def steps() -> list[str]:
    """Modules that define a step."""
    found = set()
    for module in package_modules():
        for value in vars(module).values():
            if inspect.isclass(value) and issubclass(value, Step):
                found.add(value.__module__)
    return sorted(found - {Step.__module__})


@pytest.mark.parametrize("module", steps())
def test_what_a_step_imports_reaches_no_recipe(module: str, imports: grimp.ImportGraph):
    reached = imports.find_upstream_modules(module)
    assert [name for name in sorted(reached) if name.startswith("assetbuild.recipe")] == []
