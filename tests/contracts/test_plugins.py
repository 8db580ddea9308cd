"""Every plug-in declares the keys that a recipe may have for it, and reads keys that exist."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Mapping
from typing import ClassVar

import pytest

from assetbuild import checks
from assetbuild.collision import CollisionMethod
from assetbuild.pipeline.recipes import whole_model
from assetbuild.plugin_types import Check, Edit, Target
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.recipe.schema import known_keys
from assetbuild.recipe_types import Positive

PLUGINS = [(kind, name) for kind in (Target, Check) for name in plugin_names(kind)]
KINDS = (Target, Check, Edit, CollisionMethod)


def test_what_each_is_told_are_keys_of_the_recipe():
    """And their sections stand at the top or below `validate`."""
    for kind, name in PLUGINS:
        plugin = load_plugin(kind, name)
        for field, path in plugin.recipe_fields.items():
            *above, key = path.split(".")
            assert field in plugin.model_fields, (name, field)
            assert key in known_keys(whole_model(), tuple(above)), (name, path)
        paths = [*plugin.sections, *([plugin.section] if plugin.keys() else [])]
        allowed = r"validate(\.\w+)?" if kind is Check else r"\w+"
        assert all(re.fullmatch(allowed, path) for path in paths), (name, paths)
        assert {*plugin.sections.values(), *plugin.derived} <= set(plugin.model_fields), name


def test_the_name_of_each_is_its_file_s():
    for kind, name in ((each, name) for each in KINDS for name in plugin_names(each)):
        plugin = load_plugin(kind, name)
        assert plugin.step_name() == name
        assert inspect.getdoc(plugin), name


def test_the_table_of_files_with_several_checks_names_every_one_of_them():
    """A class that `IN_FILE` forgets would never run, and nothing else would say so."""
    for file in set(checks.IN_FILE.values()):
        module = importlib.import_module(f"assetbuild.checks.{file}")
        classes = (value for value in vars(module).values() if inspect.isclass(value))
        ours = [own for own in classes if own.__module__ == module.__name__]
        named = {getattr(own, "own_name", "") for own in ours} - {""}
        assert named == {name for name, where in checks.IN_FILE.items() if where == file}


def test_old_names_of_what_plugins_import_and_state_work_for_one_version():
    with pytest.warns(FutureWarning, match="plugin_types"):
        from assetbuild.kinds import Check as OldCheck
    with pytest.warns(FutureWarning, match="recipe_types"):
        from assetbuild.quantities import Positive as OldPositive
    assert (OldCheck, OldPositive) == (Check, Positive)
    with pytest.warns(FutureWarning, match="`recipe_fields` now"):

        class Older(Check):
            """States a class constant by its name in version 0.1."""

            told: ClassVar[Mapping[str, str]] = {"feet": "feet.links"}

    assert Older.recipe_fields == {"feet": "feet.links"}
