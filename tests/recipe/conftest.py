"""A recipe as text, loaded from a file below the working folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from assetbuild.errors import RecipeError
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe

Load = Callable[..., LoadedRecipe]
Refuse = Callable[..., RecipeError]


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Write text as `recipes/r.yaml` and load it."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "recipes/r.yaml"
    path.parent.mkdir()

    def load_text(text: str, variant: str | None = None) -> LoadedRecipe:
        path.write_text(text, encoding="utf-8")
        return load_recipe(path, variant)

    return load_text


@pytest.fixture
def refused(load: Load) -> Refuse:
    """The error of a text that is no recipe."""

    def refuse(text: str, variant: str | None = None) -> RecipeError:
        with pytest.raises(RecipeError) as caught:
            load(text, variant)
        return caught.value

    return refuse
