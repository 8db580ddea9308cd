"""Meshes and hulls that one step stores are what the others read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from assetbuild.errors import StepError
from assetbuild.mesh.hulls import common_hull, hull_or_points, read_meshes, write_meshes
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.mesh.volume import solid_moments
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, MeshAsset, Shapes, Sphere

SQUARE = TriangleMesh(
    np.array([(0.0, 0.0, 0.1), (1.0, 0.0, 0.1), (1.0, 1.0, 0.1), (0.0, 1.0, 0.1)]),
    np.array([(0, 1, 2), (0, 2, 3)]),
)


def stored(file: Path, meshes: list[TriangleMesh]) -> dict[str, TriangleMesh]:
    write_meshes(file, meshes)
    assets = tuple(MeshAsset(f"m{i}", f"m{i}.obj", 0, 0) for i in range(len(meshes)))
    return dict(read_meshes(file, Shapes((), (), assets)))


@pytest.mark.parametrize("count", [0, 1, 3])
def test_meshes_are_read_as_they_were_written(count: int, tmp_path: Path) -> None:
    meshes = [tessellate(Box((1.0, 2.0, 3.0))), SQUARE, tessellate(Sphere(0.1))][:count]
    found = stored(tmp_path / "triangles.npz", meshes)
    assert list(found) == [f"m{i}" for i in range(count)]
    for mesh, read in zip(meshes, found.values(), strict=True):
        assert np.array_equal(mesh.vertices, read.vertices)
        assert np.array_equal(mesh.faces, read.faces)
        assert read.faces.dtype == np.int64


def test_the_same_meshes_give_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        write_meshes(tmp_path / name, [SQUARE])
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_flat_mesh_has_points_and_no_hull() -> None:
    flat = hull_or_points(SQUARE)
    assert len(flat.vertices) == 4
    assert not len(flat.faces)
    with pytest.raises(StepError):
        common_hull([flat])


def test_the_hull_of_two_apart_holds_what_is_between() -> None:
    cube = tessellate(Box((1.0, 1.0, 1.0)))
    both = common_hull([cube, cube.placed(Pose((2.0, 0.0, 0.0)))])
    assert solid_moments(both)[0] == pytest.approx(3.0)
    assert common_hull([cube]) is cube
