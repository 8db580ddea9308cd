"""Meshes lose triangles and keep their shape; equal shapes are found, mirrored ones too."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from robot_files import run_step

from assetbuild.geometry.convert_mesh import write_converted
from assetbuild.geometry.decimate_mesh import DecimateMesh
from assetbuild.geometry.match_shapes import MatchShapes
from assetbuild.mesh.arrays import PARTS, read_meshes
from assetbuild.mesh.cover import union_of
from assetbuild.mesh.material import ConvertedMesh, MaterialPart, SurfaceMaterial
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, merged, signed_volume
from assetbuild.robot.codec import decode
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Sphere

BALL = tessellate(Sphere(0.1))


def decimate(tmp_path: Path, parts: list[MaterialPart], goal: int, run: str = "a"):
    inputs, outputs = tmp_path / "in", tmp_path / run
    inputs.mkdir(exist_ok=True)
    outputs.mkdir()
    write_converted(inputs, parts)
    findings = {f.rule: f for f in run_step(DecimateMesh(max_faces=goal), inputs, outputs)}
    record = decode(ConvertedMesh, (outputs / "mesh.json").read_bytes())
    files = {str(p.relative_to(outputs)): p.read_bytes() for p in outputs.rglob("*.*")}
    return record, findings, files


def part(mesh: TriangleMesh, name: str = "paint") -> MaterialPart:
    return MaterialPart(SurfaceMaterial(name, (1.0, 0.5, 0.0, 1.0)), mesh)


def test_a_ball_of_four_thousand_faces_stays_a_ball_at_one_thousand(tmp_path):
    record, findings, _ = decimate(tmp_path, [part(BALL)], 1000)
    assert 900 <= record.faces <= 1000
    assert set(findings) == {"visual.decimated"}
    data = findings["visual.decimated"].data
    assert (data["from"], data["to"]) == (len(BALL.faces), record.faces)
    assert data["max_mm"] < 2.0
    volume = signed_volume(read_meshes(tmp_path / "a" / PARTS)["0"])
    assert volume == pytest.approx(signed_volume(BALL), rel=0.01)
    assert record.materials[0].name == "paint"
    assert record.materials[0].rgba == (1.0, 0.5, 0.0, 1.0)


def test_a_mesh_within_the_goal_stays_as_it_is(tmp_path):
    _, findings, files = decimate(tmp_path, [part(BALL)], len(BALL.faces))
    assert findings == {}
    assert files.keys() == {PARTS, "mesh.json"}
    assert files[PARTS] == (tmp_path / "in" / PARTS).read_bytes()


def test_the_goal_is_doubled_until_the_shape_is_kept(tmp_path):
    record, findings, _ = decimate(tmp_path, [part(BALL)], 8)
    assert record.faces > 8
    stopped = findings["visual.budget"]
    assert stopped.severity == "info"
    assert (stopped.data["goal"], stopped.data["to"]) == (8, record.faces)
    assert findings["visual.decimated"].data["area_ratio"] > 0.98


def test_a_small_part_that_sticks_out_is_not_lost(tmp_path):
    """A thin sheet of a ten thousandth of the surface, 5 mm outside of a ball of 200 mm."""
    corners = np.array([[0.099, -0.001, 0.0], [0.099, 0.001, 0.0], [0.105, -0.001, 0.0]])
    sheet = TriangleMesh(corners, np.array([[0, 1, 2]]))
    _, findings, _ = decimate(tmp_path, [part(merged([BALL, sheet]))], 1000)
    assert read_meshes(tmp_path / "a" / PARTS)["0"].bounds[1][0] == pytest.approx(0.105, abs=0.002)
    assert "visual.budget" in findings


def test_a_shape_that_cannot_lose_a_face_is_kept(tmp_path):
    boxes = merged([tessellate(Box((0.1, 0.1, 0.1))).mapped(np.eye(3), (x, 0, 0)) for x in (0, 1)])
    record, findings, _ = decimate(tmp_path, [part(boxes)], 6)
    assert record.faces == 24
    assert set(findings) == {"visual.budget"}


def test_parts_share_the_goal_by_their_faces(tmp_path):
    small = tessellate(Box((0.1, 0.1, 0.1))).mapped(np.eye(3), (1, 0, 0))
    shifted = BALL.mapped(np.eye(3), (0.0, 0.5, 0.0))
    parts = [part(BALL, "a"), part(shifted, "b"), part(small, "c")]
    decimate(tmp_path, parts, 2000)
    a, b, c = (len(mesh.faces) for mesh in read_meshes(tmp_path / "a" / PARTS).values())
    assert a == pytest.approx(b, rel=0.1)
    assert 4 <= c <= 12
    assert a + b + c <= 2010


def test_a_textured_part_is_left_alone_and_named(tmp_path):
    uv = np.random.default_rng(0).random((len(BALL.faces), 3, 2))
    textured = TriangleMesh(np.add(BALL.vertices, (1.0, 0.0, 0.0)), BALL.faces, uv)
    _, findings, _ = decimate(tmp_path, [part(textured, "a"), part(BALL, "b")], 5000)
    left, thinned = read_meshes(tmp_path / "a" / PARTS, surface=True).values()
    assert len(thinned.faces) < len(BALL.faces) / 3
    assert np.array_equal(left.corners, textured.corners)
    assert np.array_equal(left.uv, uv)
    assert findings["visual.textured"].data["parts"] == 1


def bracket(sign: float) -> TriangleMesh:
    """Three boxes that are no mirror image of themselves; sign -1 mirrors x.

    Built from the mirrored boxes, so that the triangles are not the mirrored ones.
    """
    boxes = [((1, 0.2, 0.2), (0.5, 0, 0)), ((0.2, 0.8, 0.2), (0.1, 0.4, 0)), ((0.2, 0.2, 0.5), (0.9, 0, 0.25))]  # fmt: skip # noqa: E501 # a table
    return union_of([ConvexPiece(Box(s), Pose((sign * x, y, z))) for s, (x, y, z) in boxes])[1]


def matches(tmp_path: Path, *meshes: TriangleMesh):
    for number, mesh in enumerate(meshes):
        folder = tmp_path / f"in/shapes/{number}"
        folder.mkdir(parents=True)
        write_converted(folder, [MaterialPart(SurfaceMaterial(), mesh)])
    step = MatchShapes(folders=tuple(f"shapes/{n}" for n in range(len(meshes))))
    run_step(step, tmp_path / "in", tmp_path / "out")
    return json.loads((tmp_path / "out/matches.json").read_text())


def test_a_mirrored_bracket_is_found_with_its_mirror_and_shift(tmp_path):
    other = bracket(-1.0).mapped(np.eye(3), (0.0, 0.0, 3.0))
    found = matches(tmp_path, bracket(1.0), other, tessellate(Sphere(0.5)))
    assert set(found) == {"shapes/1"}
    assert found["shapes/1"]["like"] == "shapes/0"
    assert found["shapes/1"]["signs"] == [-1.0, 1.0, 1.0]
    assert found["shapes/1"]["shift"] == pytest.approx([0.0, 0.0, 3.0], abs=1e-9)


def test_another_size_is_another_shape(tmp_path):
    assert matches(tmp_path, bracket(1.0), bracket(1.0).scaled((1.05,) * 3)) == {}
