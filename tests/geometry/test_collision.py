"""From a recipe's rules to the steps of each link."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from assetbuild.collision.auto import Auto
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.step import Step
from assetbuild.errors import RecipeError
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.geometry.jobs import check_files, collision_jobs, equal_shapes
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.robot.model import Body, Joint, Tree
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.shapes import Box, MeshFile, SourceShape, SourceShapes

TURNED = Pose((1.0, 0.0, 0.0), quat_of_rpy(0.0, 0.0, math.pi / 2.0))
LINKS = Tree(
    "r",
    "fixed",
    (Body("base"), Body("arm")),
    (Joint("j", "revolute", "base", "arm", Pose((0.0, 0.0, 0.3))),),
)
SHAPES = SourceShapes(
    (
        SourceShape("base_mesh", "base", "collision", MeshFile("base.stl"), TURNED),
        SourceShape("base_box", "base", "collision", Box((1.0, 1.0, 1.0))),
        SourceShape("arm_mesh", "arm", "visual", MeshFile("arm.stl")),
    )
)


def loaded(tmp_path: Path, collision: str) -> LoadedRecipe:
    text = "schema: assetbuild/v1\nrobot: r\nsource: {path: ., urdf: r.urdf}\ncollision:\n"
    (tmp_path / "r.yaml").write_text(text + collision)
    return load_recipe(tmp_path / "r.yaml")


def jobs(tmp_path: Path, collision: str):
    recipe = loaded(tmp_path, collision).recipe
    return collision_jobs(recipe, tmp_path, LINKS, SHAPES)


def test_the_preset_fills_what_a_rule_of_auto_leaves_open(tmp_path):
    text = "  preset: manipulation\n  links: {arm: {method: auto, max_outside: 1 mm}}\n"
    base, box, arm = jobs(tmp_path, text)
    assert box.method is None  # a primitive stays as it is
    assert base.step().max_outside == 0.005
    step = arm.step()
    assert isinstance(step, Auto)
    assert (step.max_outside, step.max_missing, step.max_hulls) == (0.001, 0.02, 32)


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


def test_a_file_of_the_users_is_an_input_whose_name_is_not_in_the_key(tmp_path):
    (tmp_path / "pad.stl").write_bytes(b"")
    piece = "{type: mesh, file: pad.stl, scale: [1, 1, 2]}"
    rule = f"{{method: explicit, pieces: [{piece}, {piece}]}}"
    *_, arm = jobs(tmp_path, f"  links:\n    arm: {rule}\n")
    assert arm.own == (MeshFile(str(tmp_path / "pad.stl"), (1.0, 1.0, 2.0)),)
    assert [piece.file for piece in arm.step().pieces] == ["own/0", "own/0"]


@pytest.mark.parametrize(
    ("file", "said"),
    [("missing.stl", "no file `missing.stl`"), ("pad.step", "no mesh by its name")],
)
def test_a_piece_without_its_file_is_refused_with_its_line(tmp_path, file, said):
    (tmp_path / "pad.step").write_bytes(b"")
    piece = f"{{type: mesh, file: {file}}}"
    recipe = loaded(tmp_path, f"  default: {{method: explicit, pieces: [{piece}]}}\n")
    rule, key = recipe.recipe.collision.default, ("collision", "default")
    with pytest.raises(RecipeError, match=said) as caught, recipe.placing():
        check_files(rule, key, tmp_path, recipe.world)
    assert caught.value.where.line == 5


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
    with pytest.raises(RecipeError, match=f"has no key `{key}`") as caught:
        loaded(tmp_path, f"  default: {rule}\n")
    assert caught.value.where.line == 5


class Answers:
    """A planner that knows `matches.json`, and meshes that are converted by their names."""

    def __init__(self, matches: dict[str, object] | None) -> None:
        self.matches, self.shapes, self.inputs = matches, SHAPES, {}

    def converted(self, mesh: MeshFile) -> Node:
        return Node(f"convert_mesh {mesh.path}", ConvertMesh(format="stl"), {})

    def add(self, label: str, step: Step, inputs: dict[str, Ref]) -> Node:
        self.inputs = inputs
        return Node(label, step, inputs)

    def ask(self, ref: Ref) -> bytes | None:
        return None if self.matches is None else json.dumps(self.matches).encode()


MIRRORED = {"shapes/1": {"like": "shapes/0", "signs": [-1, 1, 1], "shift": [0, 0, 0]}}


def test_a_mirrored_mesh_takes_the_result_of_the_other_link(tmp_path):
    all_jobs = jobs(tmp_path, "  preset: locomotion\n")
    base, _, arm = all_jobs
    known = Answers(MIRRORED)
    twins = equal_shapes(all_jobs, known.converted, known)
    assert set(twins) == {arm}
    assert twins[arm][0] is base
    assert sorted(known.inputs)[0] == "shapes/0/parts/"
    assert equal_shapes(all_jobs, known.converted, Answers(None)) is None  # not compared yet


def test_other_tolerances_share_no_result(tmp_path):
    all_jobs = jobs(tmp_path, "  links: {arm: {preset: manipulation}}\n")
    assert equal_shapes(all_jobs, Answers(MIRRORED).converted, Answers(MIRRORED)) == {}


def test_a_primitive_of_one_mesh_is_shared_by_all_links_that_turn_it(tmp_path):
    recipe = loaded(tmp_path, "  default: {method: primitive, max_hulls: 2}\n")
    turned = Pose((0.1, 0.0, 0.0), quat_of_rpy(math.pi, 0.0, 0.0))
    tree = Tree("r", "fixed", (Body("left"), Body("right")), ())
    shapes = SourceShapes(
        (
            SourceShape("l", "left", "collision", MeshFile("hip.stl")),
            SourceShape("r", "right", "collision", MeshFile("hip.stl"), turned),
        )
    )
    left, right = collision_jobs(recipe.recipe, tmp_path, tree, shapes)
    assert left.step() == right.step()
    assert (left.label, right.label) == ("primitive left", "primitive right")
    assert not left.per_link


def test_a_rule_may_have_a_preset_of_its_own(tmp_path):
    _, _, arm = jobs(tmp_path, "  links: {arm: {preset: manipulation}}\n")
    assert arm.step().max_overcover == 0.2


def test_explicit_pieces_need_no_geometry_in_the_source(tmp_path):
    rule = "{method: explicit, from: collision, pieces: [{type: sphere, radius: 1}]}"
    text = f"  links:\n    arm: {rule}\n"
    *_, arm = jobs(tmp_path, text)
    assert arm.step().pieces[0].radius == 1.0


def test_a_place_to_keep_open_is_searched_on_its_own(tmp_path):
    text = "  links: {arm: {keep_open: [{from: [0, 0, 0], radius: 1 mm}]}}\n"
    all_jobs = jobs(tmp_path, text)
    assert equal_shapes(all_jobs, Answers(MIRRORED).converted, Answers(MIRRORED)) == {}
