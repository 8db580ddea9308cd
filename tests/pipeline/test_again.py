"""A bundle is written again from its own robot: only what was edited differs."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tiny import box_obj

from assetbuild.engine.digest import digest_bytes
from assetbuild.facts.again.written import read_signed, sign
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import measure
from assetbuild.findings import Finding
from assetbuild.mesh.obj import read_triangles
from assetbuild.pipeline.again import edited_rows, held_meshes, prove_again
from tests.mutations.conftest import legs

__all__ = ["legs"]
ROBOT = "report/robot.json"


@pytest.fixture
def bundle(legs: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(legs, tmp_path / "bundle"))


def proved(bundle: Path) -> list[Finding]:
    return list(prove_again(bundle, "legs", Reference.of_bundle(bundle)))


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def resigned(bundle: Path, **parts: Any) -> None:
    """`robot.json` with other parts, and a digest that fits them."""
    signed = read_signed(bundle)
    assert signed is not None
    robot = json.loads((bundle / ROBOT).read_bytes())
    robot.pop("written")
    written = parts.pop("written", signed[0])
    (bundle / ROBOT).write_text(sign(json.dumps(robot | parts), written))


def test_an_untouched_bundle_says_what_its_writers_write(bundle: Path):
    assert proved(bundle) == []


EDITED = {
    "mjcf/legs.xml": ('kp="20"', 'kp="22"', "equal.mjcf.kp", (20.0, 22.0)),
    "mjcf/scene.xml": ('friction="1', 'friction="2', "equal.mjcf.friction", None),
    "urdf/legs.urdf": ('effort="10.0"', 'effort="11"', "equal.urdf.effort", (10.0, 11.0)),
    "python/legs_mjlab.py": (
        "stiffness=20.0", "stiffness=2.0", "equal.mjlab.stiffness", (20.0, 2.0)),
    "usd/payloads/physics.usda": (
        "physics:mass = ", "physics:mass = 1", "equal.usd.mass", None),
    "dr.yaml": ("22.0]", "23.0]", "equal.dr.range", ((18.0, 22.0), (18.0, 23.0))),
}  # fmt: skip


def test_each_edited_value_is_named(bundle: Path):
    for file, (old, new, _, _) in EDITED.items():
        edit(bundle / file, old, new)
    found = {finding.where.rpartition(":")[0]: finding for finding in proved(bundle)}
    assert {file: one.rule for file, one in found.items()} == {
        file: rule for file, (_, _, rule, _) in EDITED.items()
    }
    for file, (_, _, _, values) in EDITED.items():
        assert found[file].severity == "error"
        data = found[file].data
        assert values in (None, (data.get("expected"), data.get("found")))


def test_another_name_of_a_model_is_named(bundle: Path):
    edit(bundle / "mjcf/scene.xml", '<mujoco model="', '<mujoco model="my ')
    assert [finding.rule for finding in proved(bundle)] == ["equal.mjcf.model"]


def test_a_layer_that_somebody_added_is_compared_with_what_refers_to_it(bundle: Path):
    layer = '#usda 1.0\nover "legs"\n{\n    token visibility = "invisible"\n}\n'
    (bundle / "usd/mine.usda").write_text(layer)
    edit(bundle / "usd/legs.usda", "(\n", "(\n    subLayers = [@./mine.usda@]\n")
    (found,) = proved(bundle)
    assert (found.rule, found.subject) == ("equal.usd.extra", "prim /legs")


def test_a_comment_is_information(bundle: Path):
    edit(bundle / "urdf/legs.urdf", "</robot>", "<!-- mine --></robot>")
    (found,) = proved(bundle)
    assert (found.rule, found.severity) == ("again.otherwise", "info")


def test_a_file_that_does_not_parse_is_named_with_its_line(bundle: Path):
    edit(bundle / "python/legs_mjlab.py", "XML = Path(", "XML = Path)")
    (found,) = proved(bundle)
    assert (found.rule, found.subject) == ("equal.mjlab.statement", "file python/legs_mjlab.py")
    assert int(found.where.rpartition(":")[2]) > 1


def test_an_edited_robot_is_one_finding(bundle: Path):
    edit(bundle / ROBOT, '"kp":20.0', '"kp":22.0')
    assert [finding.rule for finding in proved(bundle)] == ["equal.robot.digest"]


def test_the_order_of_the_robots_parts_means_nothing(bundle: Path):
    robot = json.loads((bundle / ROBOT).read_bytes())
    (bundle / ROBOT).write_text(json.dumps(dict(reversed(robot.items())), indent=1))
    assert proved(bundle) == []


def test_a_bundle_of_an_earlier_version_is_not_written_again(bundle: Path):
    robot = json.loads((bundle / ROBOT).read_bytes())
    robot.pop("written")
    (bundle / ROBOT).write_text(json.dumps(robot))
    edit(bundle / "mjcf/legs.xml", 'kp="20"', 'kp="22"')
    assert [(f.rule, f.severity) for f in proved(bundle)] == [("again.unproven", "info")]


def test_files_of_other_code_are_left_to_their_readers(bundle: Path):
    signed = read_signed(bundle)
    assert signed is not None
    writers = dict(signed[0].writers) | {"mjcf": "0"}
    resigned(bundle, written=replace(signed[0], writers=writers))
    edit(bundle / "mjcf/legs.xml", 'kp="20"', 'kp="22"')
    assert [(f.rule, f.subject) for f in proved(bundle)] == [("again.unproven", "target mjcf")]


def test_a_robot_that_no_target_takes_is_refused(bundle: Path):
    options = json.loads((bundle / ROBOT).read_bytes())["options"]
    options["mjcf"]["solver"] = "magic"
    resigned(bundle, options=options)
    assert [(f.rule, f.subject) for f in proved(bundle)] == [("again.refused", "target mjcf")]


def test_of_several_copies_of_a_mesh_the_unedited_one_counts(tmp_path: Path):
    mesh, edited = box_obj((1, 1, 1)), box_obj((2, 1, 1))
    for folder, data in (("mjcf", edited), ("urdf", b"mtllib box.mtl\n" + mesh)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "box.obj").write_bytes(data)
    held = held_meshes(tmp_path, {"box.obj": digest_bytes(mesh)})["box.obj"]
    assert (held.data, held.edited) == (mesh, False)
    assert held_meshes(tmp_path, {"box.obj": "0"})["box.obj"].edited


def test_a_mesh_that_was_edited_everywhere_is_measured():
    mesh = read_triangles(box_obj((1, 1, 1)))
    assets = Assets(surfaces=(("box", measure(mesh.corners, mesh.uv)),))
    rows = {row.attribute: row for row in edited_rows("box.obj", box_obj((2, 1, 1)), assets)}
    assert rows["area"].subject == "mesh box"
    assert (rows["area"].expected, rows["area"].found) == ((6.0,), pytest.approx((10.0,)))
