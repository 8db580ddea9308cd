"""All steps of the package, what their keys hold of its code, and a copy of it to edit."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import assetbuild
from assetbuild.engine.code import Code
from assetbuild.engine.step import Step
from assetbuild.facts.reader import Reader
from assetbuild.plugins import load_plugin, plugin_names
from docs.site.pages.rules import package_modules

PACKAGE = Path(assetbuild.__file__).parent
READERS = {name: load_plugin(Reader, name) for name in plugin_names(Reader)}
OPTIONS = {"feet": {"links": ".*_foot"}, "imu": {"link": "trunk"}, "xrdf": {"max_spheres": 1}}
"""Of the tiny robots' formats."""


def step_classes() -> list[type[Step]]:
    """All that can run."""
    found = {
        value
        for module in package_modules()
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Step) and value.run is not Step.run
    }
    bases = {base for each in found for base in each.__mro__[1:]}
    return sorted(found - bases, key=lambda each: f"{each.__module__}:{each.__qualname__}")


@pytest.fixture(scope="module")
def code() -> Code:
    return Code()


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the package, for one test at a time to edit."""
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(PACKAGE, folder / "assetbuild", ignore=shutil.ignore_patterns("__pycache__"))
    return folder
