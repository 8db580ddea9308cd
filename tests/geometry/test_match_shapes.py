"""Equal and mirrored meshes are found although each is cut into triangles in its own way."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tiny import run_step

from assetbuild.geometry.convert_mesh import write_converted
from assetbuild.geometry.match_shapes import MatchShapes
from assetbuild.mesh.cover import union_of
from assetbuild.mesh.material import MaterialPart, SurfaceMaterial
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Sphere


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


def test_the_same_bracket_elsewhere_is_not_mirrored(tmp_path):
    found = matches(tmp_path, bracket(1.0), bracket(1.0).mapped(np.eye(3), (1.0, 2.0, 3.0)))
    assert found["shapes/1"]["signs"] == [1.0, 1.0, 1.0]
    assert found["shapes/1"]["shift"] == pytest.approx([1.0, 2.0, 3.0], abs=1e-9)


def test_another_size_is_another_shape(tmp_path):
    assert matches(tmp_path, bracket(1.0), bracket(1.0).scaled((1.05,) * 3)) == {}
