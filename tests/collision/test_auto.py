"""The ladder: the fewest pieces that meet the tolerances, and what is said when none do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from solids import L_SHAPE, MESH, solid
from solids import fit as fitted

from assetbuild.collision import Likeness, Probe
from assetbuild.collision import auto as ladder
from assetbuild.collision.auto import Auto
from assetbuild.collision.coacd import CoAcd
from assetbuild.collision.hull import Hull
from assetbuild.collision.vhacd import VHacd
from assetbuild.mesh.arrays import read_meshes
from assetbuild.mesh.cut import cut_parts
from assetbuild.mesh.decomposition import Patience, VHacdOptions
from assetbuild.mesh.native import NativeError
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.shapes import Box

COARSE = VHacdOptions(resolution=30_000)
TIGHT = {"max_outside": 0.1, "max_missing": 0.02, "max_overcover": 0.05, "vhacd": COARSE}


GRIPPER = solid(
    ((1.0, 0.2, 0.2), (0, 0, 0)),
    ((0.2, 0.2, 0.8), (-0.4, 0, 0.4)),
    ((0.2, 0.2, 0.8), (0.4, 0, 0.4)),
)
GAP = Probe(start=(0, -1, 0.5), end=(0, 1, 0.5), radius=0.2)


def fit(tmp_path: Path, method, mesh: TriangleMesh, run: str = "out"):
    """(number of pieces, findings by rule)."""
    pieces, _, findings, _ = fitted(tmp_path, method, mesh, run=run)
    return len(pieces), findings


def test_a_convex_mesh_is_one_hull(tmp_path):
    count, findings = fit(tmp_path, Auto(sources=MESH, **TIGHT), tessellate(Box((1, 2, 3))))
    assert count == 1
    assert set(findings) == {"collision.gap"}
    assert findings["collision.gap"].data["iou"] == 1.0


def test_a_wide_tolerance_takes_the_hull_and_a_tight_one_two_pieces(tmp_path):
    wide = Auto(sources=MESH, max_outside=1.0, max_missing=0.05, max_overcover=0.2)
    assert fit(tmp_path, wide, L_SHAPE, "wide")[0] == 1
    count, findings = fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE, "tight")
    assert count == 2
    assert "collision.tolerance" not in findings
    assert findings["collision.gap"].data["method"] == "cuts"


def test_an_open_mesh_is_cut_as_well(tmp_path):
    nub = solid(((2, 1, 1), (1, 0.5, 0.5)), ((1, 2, 1), (0.5, 1, 0.5)), ((0.02,) * 3, (1, 0, 0.5)))
    smallest = int(np.argmin(nub.areas))
    hole = nub.select(np.arange(len(nub.faces)) != smallest)
    count, findings = fit(tmp_path, Auto(sources=MESH, **TIGHT), hole)
    assert count == 2
    assert findings["collision.gap"].data["method"] == "cuts"


@pytest.fixture
def uncut(monkeypatch):
    """Cuts find nothing, so the libraries have their turn."""
    monkeypatch.setattr(ladder, "cut_parts", lambda *_: [])


@pytest.mark.usefixtures("uncut")
def test_a_clean_manifold_goes_to_coacd_before_vhacd(tmp_path):
    count, findings = fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE)
    assert count == 2
    assert findings["collision.gap"].data["method"] == "CoACD"


def test_where_cuts_need_many_pieces_coacd_may_need_fewer(tmp_path, monkeypatch):
    """A row of four boxes, 5 cm apart in height; cuts are content with up to FEW pieces."""
    row = solid(*(((1.0, 1.0, 1.0 + 0.5 * k), (k, 0.0, 0.25 * k)) for k in range(4)))
    method = Auto(sources=MESH, max_outside=0.02, max_missing=0.02, max_overcover=0.02)
    count, findings = fit(tmp_path, method, row, "content")
    assert (count, findings["collision.gap"].data["method"]) == (4, "cuts")
    monkeypatch.setattr(ladder, "FEW", 3)
    tried = []
    monkeypatch.setattr(ladder, "coacd_parts", lambda *_, **__: tried.append(1) or [])
    assert fit(tmp_path, method, row, "doubtful")[0] == 4
    assert tried == [1]


def test_what_cuts_miss_by_far_is_left_to_no_library_in_a_dense_mesh_without_a_hole(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(ladder, "CLEAN_FACES", 0)
    monkeypatch.setattr(ladder, "vhacd_parts", lambda *_, **__: pytest.fail("V-HACD was started"))
    count, findings = fit(tmp_path, Auto(sources=MESH, max_hulls=1, **TIGHT), L_SHAPE)
    assert count == 1
    assert "collision.tolerance" in findings


def test_only_a_tilted_mesh_is_cut_along_its_own_axes_too(tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(
        ladder, "cut_parts", lambda mesh, *rest: seen.append(mesh) or cut_parts(mesh, *rest)
    )
    fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE)
    assert len(seen) == 1
    tilt = Pose(quat=quat_of_rpy(0.6, 0.5, 0.2))
    fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE.placed(tilt))
    assert len(seen) == 3
    edges = np.ptp(seen[2].vertices, axis=0)
    assert sorted(edges) == pytest.approx([1.0, 2.0, 2.0], rel=1e-6)  # upright again


def test_a_tolerance_that_cannot_be_met_says_by_how_much_and_what_to_change(tmp_path):
    method = Auto(sources=MESH, max_hulls=1, **TIGHT)
    count, findings = fit(tmp_path, method, L_SHAPE)
    assert count == 1
    said = findings["collision.tolerance"]
    assert said.data["max_overcover_found"] == pytest.approx(0.5 / 3.0, abs=1e-3)
    assert said.data["max_overcover_allowed"] == 0.05
    assert "`max_overcover` is 16.7 %, above the limit of 5 %" in said.message
    assert "max_hulls" in said.hint


@pytest.mark.parametrize(
    ("width", "severity"), [(0.03, "info"), (0.5, "warning")], ids=["a little", "by far"]
)
def test_a_preset_that_is_missed_by_far_is_a_warning(tmp_path, width, severity):
    """One hull over an L sticks out by half its width, the preset allows 5 mm."""
    preset = {**Auto.preset("manipulation"), "max_hulls": 1}
    mesh = L_SHAPE.scaled((width, width, width))
    _, findings = fit(tmp_path, Auto(sources=MESH, vhacd=COARSE, **preset), mesh)
    said = findings["collision.tolerance"]
    assert said.data["max_outside_allowed"] == 0.005
    assert said.severity == severity, said.message


def test_a_hull_closes_the_gripper_and_auto_keeps_it_open(tmp_path):
    _, closed = fit(tmp_path, Hull(sources=MESH, probes=(GAP,)), GRIPPER, "hull")
    assert closed["collision.closed"].severity == "error"
    # The tolerances alone would take the hull.
    method = Auto(sources=MESH, probes=(GAP,), vhacd=COARSE)
    count, left = fit(tmp_path, method, GRIPPER, "auto")
    assert count == 3
    assert "collision.closed" not in left


@pytest.mark.usefixtures("uncut")
@pytest.mark.parametrize("cause", ["crash", "time", "memory"])
def test_a_library_that_fails_leaves_a_finding_and_the_next_rung(tmp_path, monkeypatch, cause):
    def fails(*_, **__):
        raise NativeError(cause, "no result")

    monkeypatch.setattr(ladder, "coacd_parts", fails)
    count, findings = fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE, "one")
    assert count == 2
    said = findings["collision.library_failed"]
    assert said.data == {"library": "CoACD", "cause": cause, "instead": "vhacd"}
    monkeypatch.setattr(ladder, "vhacd_parts", fails)
    count, findings = fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE, "two")
    assert count == 1
    assert findings["collision.library_failed"].data["instead"] == "hull"
    assert "collision.tolerance" in findings


def log_of(waiting: list[int], faces: int) -> list[bytes]:
    """What CoACD says of a clean mesh when so many parts wait before each round."""
    start = [b"[i] Mesh Manifoldness: true", b"[i] # Points: 9", b"[i] # Triangles: %d" % faces]
    return [*start, *(b"[i] iter %d ---- waiting pool: %d" % row for row in enumerate(waiting))]


def test_coacd_is_given_up_by_the_parts_and_faces_that_its_log_tells():
    def heard(most: float, waiting: list[int], faces: int) -> int | None:
        patience = Patience(most)
        told = [patience(line) for line in log_of(waiting, faces)]
        return told.index(True) if True in told else None

    assert heard(100, [1, 2, 4, 8, 4], faces=800) is None  # 19 parts, 5 rounds of 800 faces
    assert heard(24, [1, 2, 4, 8, 4], faces=800) is None
    assert heard(23, [1, 2, 4, 8, 4], faces=800) == 3 + 4  # before the last round
    assert heard(100, [1, 2, 4], faces=80_000) == 3 + 0
    assert Patience(100)(b"[i] Mesh Manifoldness: false")


@pytest.mark.usefixtures("uncut")
def test_a_mesh_that_takes_coacd_too_much_work_is_left_to_vhacd(tmp_path, monkeypatch):
    monkeypatch.setattr(ladder, "COACD_LOOKS", 1)
    count, findings = fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE)
    assert count == 2
    assert findings["collision.gap"].data["method"] == "V-HACD"
    assert set(findings) == {"collision.gap"}


@pytest.mark.usefixtures("uncut")
def test_a_thin_walled_mesh_is_left_to_vhacd(tmp_path):
    # Two walls of 5 cm and a floor: 14 % of the hull; the tolerances want three pieces.
    wall, floor = (0.05, 1.0, 1.0), (1.0, 1.0, 0.05)
    tray = solid((wall, (-0.475, 0, 0.5)), (wall, (0.475, 0, 0.5)), (floor, (0, 0, 0.025)))
    method = Auto(sources=MESH, max_outside=0.05, max_missing=0.05, vhacd=COARSE)
    _, findings = fit(tmp_path, method, tray)
    assert findings["collision.gap"].data["method"] == "V-HACD"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [VHacd, CoAcd])
def test_a_library_over_its_time_falls_to_a_hull(tmp_path, kind):
    busy = {"vhacd": VHacdOptions(resolution=50_000_000)} if kind is VHacd else {}
    mesh = GRIPPER if kind is VHacd else tangle()
    method = kind(sources=MESH, cpu_limit=0.2, **busy)
    count, findings = fit(tmp_path, method, mesh)
    assert count >= 1
    assert findings["collision.library_failed"].data["cause"] in ("time", "memory")


def tangle() -> TriangleMesh:
    """100 triangles through one another: no solid, nothing a library likes."""
    rng = np.random.default_rng(0)
    return TriangleMesh(rng.random((300, 3)), rng.integers(0, 300, (100, 3)))


def test_a_mirrored_shape_takes_the_other_ones_pieces_mirrored(tmp_path):
    fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE, "in/like")
    mirrored = L_SHAPE.mapped(np.diag([-1.0, 1.0, 1.0]), (0.5, 0.0, 0.0))
    like = Likeness(signs=(-1, 1, 1), shift=(0.5, 0, 0))
    count, findings = fit(tmp_path, Auto(sources=MESH, like=like, **TIGHT), mirrored)
    assert count == 2
    assert findings["collision.gap"].data["method"] == "reused from an equal shape"
    hulls = read_meshes(tmp_path / "out/pieces.npz").values()
    assert max(h.vertices[:, 0].max() for h in hulls) == pytest.approx(0.5, abs=0.05)


def test_a_false_match_is_found_out_and_decomposed_on_its_own(tmp_path):
    fit(tmp_path, Auto(sources=MESH, **TIGHT), L_SHAPE, "in/like")
    like = Likeness(signs=(1, 1, 1), shift=(0, 0, 0))
    _, findings = fit(tmp_path, Auto(sources=MESH, like=like, **TIGHT), GRIPPER)
    assert findings["collision.gap"].data["method"] != "reused from an equal shape"
    assert findings["collision.gap"].data["iou"] > 0.9


def test_a_region_may_be_tighter_than_the_rest(tmp_path):
    region = replace(GAP, max_outside=0.01)
    _, findings = fit(tmp_path, Hull(sources=MESH, probes=(region,)), GRIPPER)
    assert findings["collision.region"].data["found_m"] == pytest.approx(0.3, abs=0.05)
