"""Motors of a shared file: below the recipe's own, with their lines, and part of what was read."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.engine.world import files_in
from assetbuild.errors import RecipeError
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe

HEAD = "schema: assetbuild/v1\nrobot: r\nsource: {path: p, urdf: r.urdf}\n"


def written(folder: Path, recipe: str, motors: str | None = None) -> LoadedRecipe:
    (folder / "recipes").mkdir()
    (folder / "recipes/r.yaml").write_text(HEAD + recipe)
    if motors is not None:
        (folder / "motors.yaml").write_text(motors)
    return load_recipe(folder / "recipes/r.yaml")


def test_the_recipe_s_own_motors_come_on_top(tmp_path: Path):
    loaded = written(
        tmp_path,
        "motor_file: ../motors.yaml\nmotors: {knee: {extends: hip, gear: 9}, hip: {effort: 2}}\n",
        "hip: {gear: 6, effort: 1}\nwheel: {effort: 3}\n",
    )
    motors = loaded.recipe.motors
    assert set(motors) == {"hip", "wheel", "knee"}
    assert (motors["hip"].effort, motors["hip"].gear) == (2, None)
    assert str(tmp_path / "motors.yaml") in files_in(loaded.world.record)


def test_an_error_in_the_file_names_its_line(tmp_path: Path):
    with pytest.raises(RecipeError) as caught:
        written(tmp_path, "motor_file: ../motors.yaml\n", "hip:\n  gear: 6\n  torque: 3\n")
    assert "motors.yaml:3:3" in str(caught.value)


@pytest.mark.parametrize("motors", [None, "- 1\n", "hip: [\n"])
def test_a_file_that_is_not_there_or_no_map(motors: str | None, tmp_path: Path):
    with pytest.raises(RecipeError, match=r"motors\.yaml"):
        written(tmp_path, "motor_file: ../motors.yaml\n", motors)
