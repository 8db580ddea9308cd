"""A second reader of meshes agrees with ours, and would notice what ours once misread."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import numpy as np
import pytest
from daes import dae

from assetbuild.mesh.read import read_mesh
from tests.corpus.assimp import polygons, polygons_measured

try:
    files("cmeel-assimp")
except PackageNotFoundError:
    pytest.skip("pinocchio brings assimp", allow_module_level=True)

ARROW = b"""v 0 2 0\nv 0 0 0\nv 2 0 0\nv 0.2 0.2 0\nv 1 1 2
f 1 2 3 4\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n"""
"""A pyramid on a quad that is not convex."""


@pytest.mark.parametrize(
    ("format", "data"), [("obj", ARROW), ("dae", dae()), ("dae", dae(up="Y_UP"))]
)
def test_polygons_nodes_mirrors_and_units_are_the_same_to_both(
    format: str, data: bytes, tmp_path: Path
):
    (tmp_path / f"a.{format}").write_bytes(data)
    theirs = polygons_measured(*polygons(tmp_path / f"a.{format}"))
    parts = read_mesh(data, format).parts
    corners = np.concatenate([part.mesh.corners.reshape(-1, 3) for part in parts])
    ours = polygons_measured(corners, np.full(len(corners) // 3, 3))
    for name, theirs_is in vars(theirs).items():
        assert getattr(ours, name) == pytest.approx(theirs_is, rel=1e-6), name


def test_what_assimp_cannot_read_is_an_error(tmp_path: Path):
    (tmp_path / "cut.stl").write_bytes(b"short")
    with pytest.raises(ValueError, match="too small"):
        polygons(tmp_path / "cut.stl")


def test_area_and_volume_of_a_box_of_quads_are_those_of_the_formula():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    box = polygons_measured(corners[np.concatenate(quads)] + 9.0, np.full(6, 4))
    assert (box.area, box.volume) == pytest.approx((22.0, 6.0))
