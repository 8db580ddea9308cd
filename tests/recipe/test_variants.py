"""A variant is a patch: maps merged, all else replaced, and its lines are the variant's."""

from __future__ import annotations

import pytest

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


@pytest.mark.parametrize(
    ("old", "new", "variant", "place", "said", "hint"),
    [
        ("", "", "trian", "", "no variant named `trian`", "did you mean `train`?"),
        (BASE[BASE.index("variants:") :], "", "train", "", "", "no `variants`"),
        ("    targets: [mjcf]", "    variants: {}", None, "17:5", "cannot change `variants`", ""),
        ("timestep: 0.002", "timestpe: 0.002", None, "16:18", "", "did you mean `timestep`?"),
    ],
    ids=["unknown", "none at all", "variants in a variant", "a mistake though nobody asked"],
)
def test_a_wrong_variant_is_one_error(refused, old, new, variant, place, said, hint):
    error = refused(BASE.replace(old, new) if old else BASE, variant)
    assert str(error.where).endswith(place)
    assert said in error.message and hint in error.hint


def test_many_variants_of_a_large_recipe_are_refused_before_they_cost_time(refused):
    rows = "\n".join(f'  - {{joints: "j{i}", kp: 1}}' for i in range(5000))
    text = BASE.replace('  - {joints: ".*", kp: 80}', rows)
    text += "".join(f"  v{i}: {{}}\n" for i in range(60))
    assert "too large" in refused(text).message
