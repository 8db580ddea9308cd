"""All steps of the package, and what their keys hold of its code."""

from __future__ import annotations

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
"""Sections of the recipe that the readers of the tiny robots need."""


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
