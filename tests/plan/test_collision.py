"""From a recipe's rules to the steps of each link."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest

from assetbuild.collision.auto import Auto
from assetbuild.errors import RecipeError
from assetbuild.plan.collision import check_rule, collision_jobs
from assetbuild.recipe.loader import LoadedRecipe, load_recipe
from assetbuild.robot.model import Body, Box, Joint, Mesh, Shape, Shapes, Tree
from assetbuild.robot.pose import Pose, quat_of_rpy

TURNED = Pose((1.0, 0.0, 0.0), quat_of_rpy(0.0, 0.0, math.pi / 2.0))
LINKS = Tree(
    "r",
    "fixed",
    (Body("base"), Body("arm")),
    (Joint("j", "revolute", "base", "arm", Pose((0.0, 0.0, 0.3))),),
)
SHAPES = Shapes(
    (
        Shape("base_mesh", "base", "collision", Mesh("base.stl"), TURNED),
        Shape("base_box", "base", "collision", Box((1.0, 1.0, 1.0))),
        Shape("arm_mesh", "arm", "visual", Mesh("arm.stl")),
    )
)


def loaded(tmp_path: Path, collision: str) -> LoadedRecipe:
    text = "schema: assetbuild/v1\nrobot: r\nsource: {path: ., urdf: r.urdf}\ncollision:\n"
    (tmp_path / "r.yaml").write_text(text + collision)
    return load_recipe(tmp_path / "r.yaml")


def jobs(tmp_path: Path, collision: str):
    return collision_jobs(loaded(tmp_path, collision), LINKS, SimpleNamespace(shapes=SHAPES))


def test_the_preset_fills_what_a_rule_of_auto_leaves_open(tmp_path):
    text = "  preset: manipulation\n  links: {arm: {method: auto, max_outside: 1 mm}}\n"
    base, box, arm = jobs(tmp_path, text)
    assert box.method is None  # a primitive stays as it is
    assert base.step().max_outside == 0.005
    step = arm.step()
    assert isinstance(step, Auto)
    assert (step.max_outside, step.max_missing, step.max_hulls) == (0.001, 0.02, 32)


def test_a_rule_may_have_a_preset_of_its_own(tmp_path):
    _, _, arm = jobs(tmp_path, "  links: {arm: {preset: manipulation}}\n")
    assert arm.step().max_overcover == 0.2


def test_other_methods_are_judged_by_what_the_rule_states_alone(tmp_path):
    (base, _, arm) = jobs(tmp_path, "  links: {arm: {method: hull, max_missing: 3 %}}\n")
    step = arm.step()
    assert (step.max_outside, step.max_missing) == (None, 0.03)
    assert base.step().max_outside == 0.02


def test_a_probe_of_the_link_is_given_in_the_frame_of_the_shape(tmp_path):
    text = "  links: {base: {keep_open: [{from: [1, 2, 0], to: [1, 2, 1], radius: 4 mm}]}}\n"
    base, _, _ = jobs(tmp_path, text)
    (probe,) = base.step().probes
    # The shape stands at x = 1, turned by 90 degrees: the link's y is its x.
    assert probe.start == pytest.approx((2.0, 0.0, 0.0), abs=1e-12)
    assert probe.end == pytest.approx((2.0, 0.0, 1.0), abs=1e-12)
    assert (probe.radius, probe.max_outside) == (0.004, None)


def test_several_primitives_know_the_bones_of_their_link(tmp_path):
    text = "  default: {method: primitive, max_hulls: 3}\n"
    base, _ = jobs(tmp_path, text)
    assert base.step().bones == ((0.0, 0.0, 0.3),)
    one = jobs(tmp_path, "  default: {method: primitive}\n")[0]
    assert one.step().bones == ()


def test_explicit_pieces_need_no_geometry_in_the_source(tmp_path):
    rule = "{method: explicit, from: collision, pieces: [{type: sphere, radius: 1}]}"
    text = f"  links:\n    arm: {rule}\n"
    *_, arm = jobs(tmp_path, text)
    assert arm.step().pieces[0].radius == 1.0


@pytest.mark.parametrize(
    ("rule", "key"),
    [
        ("{method: keep, shape: box}", "shape"),
        ("{method: hull, max_hulls: 3}", "max_hulls"),
        ("{method: vhacd, coacd: {threshold: 0.1}}", "coacd"),
        ("{method: none, max_outside: 1 mm}", "max_outside"),
    ],
)
def test_a_key_that_a_method_does_not_have_is_refused_with_its_line(tmp_path, rule, key):
    recipe = loaded(tmp_path, f"  default: {rule}\n")
    with pytest.raises(RecipeError, match=f"has no key `{key}`") as caught:
        check_rule(recipe, recipe.recipe.collision.default, ("collision", "default"))
    assert caught.value.where.line == 5
