"""A variant is a patch: maps merged, all else replaced, and its lines are the variant's."""

from __future__ import annotations

import pytest

from assetbuild.errors import RecipeError
from assetbuild.pipeline.recipes import load_recipe

BASE = """\
schema: assetbuild/v1
robot: tiny
source: {path: tiny, urdf: tiny.urdf}
collision:
  links:
    ".*": {method: hull, max_vertices: 32}
    foot: {method: primitive, shape: sphere}
actuators:
  - {joints: ".*", kp: 80}
keyframes:
  home: {joints: {hip: 0.5, knee: 1}}
  crouch: {}
targets: [urdf, mjcf]
variants:
  train:
    simulation: {timestep: 0.002}
    targets: [mjcf]
    collision:
      links:
        trunk: {method: none}
        foot: {shape: capsule}
  soft:
    actuators: [{joints: ".*", kp: 5}]
    keyframes: {crouch: {joints: {knee: 2}}}
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def load_text(text: str, variant: str | None = None):
        (tmp_path / "r.yaml").write_text(text, encoding="utf-8")
        return load_recipe("r.yaml", variant)

    return load_text


def test_without_a_variant_the_base_is_untouched(load):
    recipe = load(BASE).recipe
    assert recipe.targets == ("urdf", "mjcf")
    assert recipe.simulation.timestep == 0.005


def test_maps_are_merged_and_lists_replaced(load):
    recipe = load(BASE, "train").recipe
    assert recipe.simulation.timestep == 0.002
    assert recipe.simulation.decimation == 4
    assert recipe.targets == ("mjcf",)
    foot = recipe.collision.links["foot"]
    assert (foot.method, foot.shape) == ("primitive", "capsule")


def test_a_variant_s_new_link_patterns_win_over_the_base_s(load):
    links = list(load(BASE, "train").recipe.collision.links)
    assert links == ["trunk", "foot", ".*"]


def test_the_first_keyframe_stays_first(load):
    keyframes = load(BASE, "soft").recipe.keyframes
    assert list(keyframes) == ["home", "crouch"]
    assert keyframes["crouch"].joints == {"knee": 2.0}
    assert keyframes["home"].joints == {"hip": 0.5, "knee": 1.0}


def test_a_patched_value_stands_in_the_variant_and_the_rest_in_the_base(load):
    lines = BASE.splitlines()
    loaded = load(BASE, "soft")
    assert "kp: 5" in lines[loaded.where(("actuators", 0)).line - 1]
    assert "shape: sphere" in lines[loaded.where(("collision", "links", "foot")).line - 1]


def test_a_mistake_in_a_variant_points_into_the_variant_even_when_nobody_asked(load):
    with pytest.raises(RecipeError) as caught:
        load(BASE.replace("timestep: 0.002", "timestpe: 0.002"))
    assert str(caught.value.where) == "r.yaml:16:18"
    assert caught.value.hint == "did you mean `timestep`?"


def test_an_unknown_variant_is_named_with_the_nearest(load):
    with pytest.raises(RecipeError) as caught:
        load(BASE, "trian")
    assert caught.value.message == "no variant named `trian`"
    assert caught.value.hint == "did you mean `train`?"


def test_a_recipe_without_variants_says_so(load):
    with pytest.raises(RecipeError) as caught:
        load(BASE[: BASE.index("variants:")], "train")
    assert "no `variants`" in caught.value.hint


def test_a_variant_cannot_hold_variants(load):
    with pytest.raises(RecipeError) as caught:
        load(BASE.replace("    targets: [mjcf]", "    variants: {}"))
    assert "cannot change `variants`" in caught.value.message
    assert caught.value.where.line == 17


def test_many_variants_of_a_large_recipe_are_refused_before_they_cost_time(load):
    rows = "\n".join(f'  - {{joints: "j{i}", kp: 1}}' for i in range(5000))
    text = BASE.replace('  - {joints: ".*", kp: 80}', rows)
    text += "".join(f"  v{i}: {{}}\n" for i in range(60))
    with pytest.raises(RecipeError) as caught:
        load(text)
    assert "too large" in caught.value.message
