"""Every collision method on shapes whose answer is known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from robot_files import run_step
from solids import L_SHAPE, MESH, UNIT, converted, fit

from assetbuild.collision import CollisionMethod, PlacedSource
from assetbuild.collision.coacd import CoAcd
from assetbuild.collision.explicit import Explicit, ExplicitPiece
from assetbuild.collision.hull import Hull
from assetbuild.collision.primitive import FitPrimitive
from assetbuild.collision.spheres import Spheres
from assetbuild.collision.vhacd import VHacd
from assetbuild.errors import StepError
from assetbuild.mesh.cover import union_of
from assetbuild.mesh.hull import capped
from assetbuild.mesh.primitives import signed_distance, tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, merged, signed_volume
from assetbuild.plugin_types import Pieces
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.robot.codec import decode
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Sphere

TURNED = Pose((0.3, -0.2, 0.5), quat_of_rpy(0.4, -0.7, 1.1))


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in plugin_names(CollisionMethod) if n != "explicit"])
def test_every_method_makes_the_same_pieces_of_an_l_twice(tmp_path, name):
    method = load_plugin(CollisionMethod, name)(sources=MESH)
    runs = [fit(tmp_path / run, method, L_SHAPE) for run in ("a", "b/c")]
    assert runs[0][0]
    assert runs[0][3] == runs[1][3]


def test_the_hull_of_an_l_is_one_prism_and_the_gap_is_its_notch(tmp_path):
    pieces, (hull,), findings, _ = fit(tmp_path, Hull(sources=MESH), L_SHAPE)
    assert len(pieces) == 1
    assert len(hull.vertices) == 10
    assert signed_volume(hull) == pytest.approx(3.5)
    data = findings["collision.gap"].data
    assert data["max_outside_mm"] == pytest.approx(500.0, abs=30.0)
    assert data["over"] == pytest.approx(0.5 / 3.0, abs=0.02)
    assert data["max_missing"] < 0.01
    assert data["max_polygons"] == 7
    assert data["closed"] is True


def test_sources_are_placed_and_joined_in_the_output_frame(tmp_path):
    sources = (
        PlacedSource("shapes/0", pose=Pose((10.0, 0.0, 0.0))),
        PlacedSource.of_primitive(Box((1.0, 1.0, 1.0)), Pose((0.0, 0.0, 0.0))),
    )
    _, (hull,), _, _ = fit(tmp_path, Hull(sources=sources), UNIT)
    assert hull.bounds[0] == pytest.approx([-0.5, -0.5, -0.5])
    assert hull.bounds[1] == pytest.approx([10.5, 0.5, 0.5])


def test_an_open_mesh_is_said_to_be_open(tmp_path):
    _, _, findings, _ = fit(tmp_path, Hull(sources=MESH), UNIT.select(np.arange(11)))
    assert findings["collision.gap"].data["closed"] is False
    assert "not watertight" in findings["collision.gap"].message


@pytest.mark.parametrize("method", [VHacd(sources=MESH, max_hulls=4), CoAcd(sources=MESH)])
def test_decomposition_opens_the_notch_of_an_l(tmp_path, method):
    _, hulls, findings, _ = fit(tmp_path, method, L_SHAPE)
    assert 2 <= len(hulls) <= 4
    assert all(h.is_closed and signed_volume(h) > 0.0 for h in hulls)
    assert sum(map(signed_volume, hulls)) == pytest.approx(3.0, rel=0.06)
    data = findings["collision.gap"].data
    assert data["over"] < 0.06
    assert data["max_missing"] < 0.06


def test_coacd_keeps_its_vertex_cap_and_tells_when_disjoint_parts_exceed_the_hulls(tmp_path):
    ball = capped(tessellate(Sphere(0.1)), 48)
    balls = [ball.mapped(np.eye(3), (x, 0.0, 0.0)) for x in (0.0, 1.0, 2.0)]
    method = CoAcd(sources=MESH, max_hulls=1, max_vertices=32)
    _, hulls, findings, _ = fit(tmp_path, method, merged(balls))
    assert max(len(h.vertices) for h in hulls) <= 32
    assert len(hulls) == 3
    assert findings["collision.more_hulls"].data == {"pieces": 3, "max_hulls": 1}


@pytest.mark.parametrize(
    "solid",
    [
        Box((0.3, 0.2, 0.1)),
        *(
            pytest.param(solid, marks=pytest.mark.slow)
            for solid in (Sphere(0.1), Capsule(0.05, 0.3), Cylinder(0.08, 0.25))
        ),
    ],
    ids=lambda s: type(s).__name__,
)
def test_a_primitive_is_recovered_from_its_own_turned_mesh(tmp_path, solid):
    mesh = tessellate(solid).placed(TURNED)
    (piece,), _, findings, _ = fit(tmp_path, FitPrimitive(sources=MESH), mesh)
    assert type(piece.geometry) is type(solid)
    pose = piece.X_frame_piece
    # The same body, whatever names its axes have: equal distances at points all around.
    points = np.random.default_rng(0).uniform(-0.3, 0.3, size=(200, 3)) + TURNED.xyz
    truth = signed_distance(solid, TURNED.inverse().apply(points))
    found = signed_distance(piece.geometry, pose.inverse().apply(points))
    assert found == pytest.approx(truth, abs=2e-3)
    assert findings["collision.gap"].data["iou"] > 0.97


@pytest.mark.parametrize("shape", ["sphere", None])
def test_a_source_that_is_the_primitive_stays_exactly_as_it_is(tmp_path, shape):
    source = PlacedSource.of_primitive(Sphere(0.0213), TURNED)
    (piece,), _, findings, files = fit(tmp_path, FitPrimitive(sources=(source,), shape=shape))
    assert (piece.geometry, piece.X_frame_piece) == (Sphere(0.0213), TURNED)
    assert findings == {}
    assert sorted(files) == ["pieces.json", "pieces.npz", "quality.json"]


def test_a_cylinder_asked_to_be_a_capsule_becomes_one(tmp_path):
    source = PlacedSource.of_primitive(Cylinder(0.05, 0.4), TURNED)
    method = FitPrimitive(sources=(source,), shape="capsule")
    (piece,), _, _, _ = fit(tmp_path, method)
    assert isinstance(piece.geometry, Capsule)
    assert piece.geometry.radius == pytest.approx(0.05, rel=0.15)
    along = piece.X_frame_piece.rotation[:, 2] @ TURNED.rotation[:, 2]
    assert abs(along) == pytest.approx(1.0, abs=1e-2)


def test_the_volume_of_a_ball_fitted_by_a_box_is_not_the_enclosing_box(tmp_path):
    # Two-sided: the enclosing box has over 6/pi - 1 = 0.91; a smaller one misses corners of air.
    ball = tessellate(Sphere(0.5))
    (piece,), _, findings, _ = fit(tmp_path, FitPrimitive(sources=MESH, shape="box"), ball)
    assert math.prod(piece.geometry.size) <= 1.0 + 1e-6
    assert findings["collision.gap"].data["iou"] >= math.pi / 6 - 0.02


@pytest.mark.slow
def test_a_shin_is_a_capsule_and_its_foot_a_sphere(tmp_path):
    foot = ConvexPiece(Sphere(0.023), Pose((0.0, 0.0, -0.21)))
    shin = ConvexPiece(Capsule(0.012, 0.2), Pose((0.0, 0.0, -0.1)))
    method = FitPrimitive(sources=MESH, max_hulls=2, shape=("sphere", "capsule"))
    pieces, _, findings, _ = fit(tmp_path, method, union_of([foot, shin])[1])
    found = {type(piece.geometry): piece for piece in pieces}
    assert set(found) == {Capsule, Sphere}
    assert found[Sphere].geometry.radius == pytest.approx(0.023, rel=0.05)
    assert found[Sphere].X_frame_piece.xyz == pytest.approx((0.0, 0.0, -0.21), abs=2e-3)
    assert findings["collision.gap"].data["iou"] > 0.9


def test_spheres_fill_a_bar_without_sticking_out_far(tmp_path):
    bar = tessellate(Capsule(0.1, 0.8))
    method = Spheres(sources=MESH, max_hulls=12, max_outside=0.02)
    pieces, _, findings, _ = fit(tmp_path, method, bar)
    assert all(isinstance(piece.geometry, Sphere) for piece in pieces)
    assert 4 <= len(pieces) <= 12
    data = findings["collision.gap"].data
    assert data["max_outside_mm"] <= 20.5
    assert data["max_missing"] < 0.15


def test_a_box_becomes_spheres_and_a_sphere_stays(tmp_path):
    """Planners take nothing else; other methods leave a primitive as it is."""
    box = (PlacedSource.of_primitive(Box((0.1, 0.1, 0.4)), Pose((0.0, 0.0, 0.2))),)
    pieces, _, findings, _ = fit(tmp_path / "box", Spheres(sources=box, max_hulls=8), UNIT)
    assert len(pieces) == 8
    assert {type(piece.geometry) for piece in pieces} == {Sphere}
    assert findings["collision.gap"].data["max_missing"] < 0.3
    ball = (PlacedSource.of_primitive(Sphere(0.1), Pose()),)
    (piece,), _, _, _ = fit(tmp_path / "ball", Spheres(sources=ball), UNIT)
    assert piece.geometry == Sphere(0.1)
    (piece,), _, _, _ = fit(tmp_path / "hull", Hull(sources=box), UNIT)
    assert piece.geometry == Box((0.1, 0.1, 0.4))


def test_explicit_pieces_are_measured_and_left_as_they_are(tmp_path):
    half = ExplicitPiece(type="box", size=(0.5, 1.0, 1.0), xyz=(-0.25, 0.0, 0.0))
    (piece,), _, findings, _ = fit(tmp_path, Explicit(sources=MESH, pieces=(half,)), UNIT)
    assert piece.geometry == Box((0.5, 1.0, 1.0))
    assert findings["collision.gap"].data["max_missing"] == pytest.approx(0.5, abs=1e-6)


def test_a_link_without_geometry_may_have_explicit_pieces(tmp_path):
    (tmp_path / "in").mkdir()
    ball = ExplicitPiece(type="sphere", radius=0.1, xyz=(0.0, 0.0, 1.0))
    assert run_step(Explicit(pieces=(ball,)), tmp_path / "in", tmp_path / "out") == []
    record = decode(Pieces, (tmp_path / "out/pieces.json").read_bytes())
    assert record.pieces[0].X_frame_piece.xyz == (0.0, 0.0, 1.0)
    with pytest.raises(ValidationError, match="a box has size"):
        ExplicitPiece(type="box", radius=0.1)


def own_mesh(tmp_path: Path, mesh: TriangleMesh, **more):
    """(pieces, hulls, findings by rule) of one explicit mesh in a link with the unit box."""
    converted(tmp_path / "in/own/0", mesh)
    piece = ExplicitPiece(type="mesh", file="own/0", **more)
    return fit(tmp_path, Explicit(sources=MESH, pieces=(piece,)), UNIT)[:3]


def test_a_convex_mesh_of_the_users_is_taken_as_it_is(tmp_path):
    pieces, (hull,), findings = own_mesh(tmp_path, UNIT, xyz=(0.5, 0.0, 0.0))
    assert len(pieces) == 1
    assert signed_volume(hull) == pytest.approx(1.0)
    assert hull.bounds[0] == pytest.approx((0.0, -0.5, -0.5))
    # Half of the box is covered, and as much lies outside: a third of the union is common.
    assert findings["collision.gap"].data["iou"] == pytest.approx(1.0 / 3.0, abs=1e-3)
    assert "collision.not_convex" not in findings


@pytest.mark.parametrize(
    ("mesh", "share", "volume"),
    [(L_SHAPE, 3.0 / 3.5, 3.5), (UNIT.select(np.arange(10)), 0.0, 1.0)],
    ids=["not convex", "open"],
)
def test_a_mesh_of_the_users_that_is_not_its_hull_is_told(tmp_path, mesh, share, volume):
    _, (hull,), findings = own_mesh(tmp_path, mesh)
    found = findings["collision.not_convex"].data["share_of_hull"]
    assert found == pytest.approx(share, abs=1e-3)
    assert signed_volume(hull) == pytest.approx(volume)


def test_a_flat_mesh_of_the_users_is_refused(tmp_path):
    with pytest.raises(StepError, match="piece 1: flat"):
        own_mesh(tmp_path, UNIT.select(np.flatnonzero((UNIT.corners[:, :, 2] > 0.0).all(axis=1))))


def test_a_capped_hull_has_exactly_the_asked_vertices(tmp_path):
    ball = tessellate(Sphere(0.5))
    _, (hull,), _, _ = fit(tmp_path, Hull(sources=MESH, max_vertices=20), ball)
    assert len(hull.vertices) == 20
    assert hull.is_closed
