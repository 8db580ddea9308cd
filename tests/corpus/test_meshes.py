"""A second reader of meshes agrees with ours, and would notice what ours once misread."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import numpy as np
import pytest
from daes import CUBE, dae

from corpus.assimp import measured, polygons_measured
from corpus.meshes import compared

try:
    files("cmeel-assimp")
except PackageNotFoundError:
    pytest.skip("pinocchio brings assimp", allow_module_level=True)

ARROW = """v 0 2 0\nv 0 0 0\nv 2 0 0\nv 0.2 0.2 0\nv 1 1 2
f 1 2 3 4\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n"""
"""A pyramid on a quad that is not convex."""


def test_a_pyramid_on_an_arrow_is_the_same_to_both(tmp_path: Path):
    path = tmp_path / "arrow.obj"
    path.write_text(ARROW)
    assert compared(path) == ("same", "")
    theirs = measured(path)
    assert theirs.polygons == 1
    assert "area" in theirs.unlike(replace(theirs, area=1.19 * theirs.area))
    assert "bounds" in theirs.unlike(replace(theirs, upper=theirs.upper + 0.1))


@pytest.mark.parametrize("up", ["Z_UP", "Y_UP"])
def test_nodes_mirrors_polygons_and_units_are_the_same_to_both(tmp_path: Path, up):
    path = tmp_path / "cubes.dae"
    path.write_bytes(dae(CUBE, unit="0.01", up=up))
    assert compared(path) == ("same", "")
    assert measured(path).volume == pytest.approx(2e-6, rel=1e-6)


def test_what_one_of_them_refuses_is_said(tmp_path: Path):
    path = tmp_path / "cut.stl"
    path.write_bytes(b"short")
    assert compared(path) == ("both refuse", "cut.stl: 5 bytes are too few for an STL file")


def test_area_and_volume_of_a_box_of_quads_are_those_of_the_formula():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    box = polygons_measured(corners[np.concatenate(quads)] + 9.0, np.full(6, 4))
    assert (box.area, box.volume) == pytest.approx((22.0, 6.0))
