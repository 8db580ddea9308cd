"""What `auto` keeps open: bores, slots and channels, upright and tilted."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from assetbuild.collision.auto import PRESETS, Auto
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Pose, quat_of_rpy
from tests.collision.test_auto import MESH, fit, solid


def drilled(body: manifold3d.Manifold, *bores: tuple[float, float, float]) -> TriangleMesh:
    """The body without cylinders along z; bores: (x, y, radius) in m."""
    for x, y, radius in bores:
        body -= manifold3d.Manifold.cylinder(1.0, radius, radius, 48, True).translate((x, y, 0))
    mesh = body.to_mesh64()
    return TriangleMesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, int))


def disc(radius: float, height: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.cylinder(height, radius, radius, 48, True)


PLATE = manifold3d.Manifold.cube((0.1, 0.08, 0.01), True)
# (mesh, bores that stay open, volume in m3 by the area of a polygon of 48 corners, most pieces).
POLYGON = 24.0 * np.sin(2.0 * np.pi / 48)
BORED = {
    "ring": (drilled(disc(0.05, 0.02), (0, 0, 0.03)), [(0, 0, 0.03)],
             POLYGON * (0.05**2 - 0.03**2) * 0.02, 16),
    "pipe with a thin wall": (drilled(disc(0.05, 0.2), (0, 0, 0.045)), [(0, 0, 0.045)],
             POLYGON * (0.05**2 - 0.045**2) * 0.2, 32),
    "washer, bored off its axis": (drilled(disc(0.04, 0.006), (0.018, 0.007, 0.012)),
             [(0.018, 0.007, 0.012)], POLYGON * (0.04**2 - 0.012**2) * 0.006, 8),
    "plate with small holes": (drilled(PLATE, (0.04, 0.03, 0.002), (-0.04, 0.03, 0.002)), [],
             0.1 * 0.08 * 0.01 - 2 * POLYGON * 0.002**2 * 0.01, 1),
}  # fmt: skip


MANIPULATION = Auto.model_validate({"sources": MESH, **PRESETS["manipulation"]})
UPRIGHT, TILTED = Pose(), Pose(quat=quat_of_rpy(0.6, 0.5, 0.2))


def covered(folder: Path, points: np.ndarray) -> np.ndarray:
    """(n,) which of points (n, 3) the hulls hold, by their half-spaces."""
    planes = [
        ConvexHull(read_triangles(file.read_bytes()).vertices).equations
        for file in (folder / "pieces").iterdir()
    ]
    return np.any([(points @ p[:, :3].T + p[:, 3] <= 1e-9).all(axis=1) for p in planes], axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("name", BORED)
def test_a_bore_wider_than_the_tolerance_stays_open(tmp_path, name):
    """Judged without the code's own metric: half-spaces of the hulls, a formula for the volume."""
    mesh, bores, volume, most = BORED[name]
    tilt = UPRIGHT if name == "ring" else TILTED
    count, findings = fit(tmp_path, MANIPULATION, mesh.placed(tilt))
    assert count <= most
    assert "collision.tolerance" not in findings

    def held(points: np.ndarray) -> np.ndarray:
        return covered(tmp_path / "out", tilt.apply(points))

    lower, upper = mesh.bounds
    cloud = np.random.default_rng(5).uniform(1.1 * lower, 1.1 * upper, (40_000, 3))
    union = held(cloud).mean() * np.prod(1.1 * (upper - lower))
    assert 0.96 < union / volume < 1.22  # 2 % may miss and 20 % be too much, and 3 sigma
    turn = np.linspace(0.0, 2.0 * np.pi, 24)
    for x, y, radius in bores:  # 5 mm, the tolerance, off its wall
        free = radius - 0.0051
        for z in np.linspace(lower[2], upper[2], 9):
            ring = [x + free * np.cos(turn), y + free * np.sin(turn), np.full(24, z)]
            assert not held(np.stack(ring, axis=1)).any()
            assert not held(np.array([[x, y, z]])).any()


# Boxes (size, centre) in m that share no volume, and one that must stay free between them.
OPEN = {
    "U channel": ([((0.2, 0.06, 0.014), (0, 0, 0.007)), ((0.2, 0.008, 0.046), (0, 0.026, 0.037)),
                   ((0.2, 0.008, 0.046), (0, -0.026, 0.037))], ((0.19, 0.034, 0.04), (0, 0, 0.04))),
    "frame": ([((0.12, 0.015, 0.015), (0, 0.0425, 0)), ((0.12, 0.015, 0.015), (0, -0.0425, 0)),
               ((0.015, 0.07, 0.015), (0.0525, 0, 0)), ((0.015, 0.07, 0.015), (-0.0525, 0, 0))],
              ((0.08, 0.06, 0.015), (0, 0, 0))),
}  # fmt: skip


@pytest.mark.parametrize(("boxes", "free"), OPEN.values(), ids=list(OPEN))
def test_a_tilted_part_comes_apart_like_an_upright_one(tmp_path, boxes, free):
    rng = np.random.default_rng(5)
    counts = []
    for name, tilt in (("upright", UPRIGHT), ("tilted", TILTED)):
        count, findings = fit(tmp_path, MANIPULATION, solid(*boxes).placed(tilt), name)
        assert "collision.tolerance" not in findings
        counts.append(count)
        for size, centre in boxes:
            points = centre + 0.98 * np.asarray(size) * (rng.random((2_000, 3)) - 0.5)
            assert covered(tmp_path / name, tilt.apply(points)).mean() > 0.95
        size, centre = free
        points = centre + np.asarray(size) * (rng.random((5_000, 3)) - 0.5)
        assert covered(tmp_path / name, tilt.apply(points)).mean() < 0.1
    assert abs(counts[0] - counts[1]) <= 2
