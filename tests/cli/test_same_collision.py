"""Decomposed meshes are the same bytes in every run, with one process and two, in two checkouts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from urdfs import inertial, joint, link, mesh, robot, shape

from assetbuild.mesh.cover import union_of
from assetbuild.mesh.obj import obj_bytes
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box

RECIPE = """\
schema: assetbuild/v1
robot: two
source: {path: robot, urdf: two.urdf, license: MIT}
base: fixed
collision:
  preset: manipulation
  default: {method: auto, vhacd: {resolution: 20000}}
targets: [mjcf]
validate: {free_fall: null}
"""
BUILD = (sys.executable, "-m", "assetbuild", "build", "two.yaml", "--fail-on", "never")
JOINT = joint("j", "clean", "open", "fixed", "", axis=None)


def t_bar() -> TriangleMesh:
    """A T of two boxes, a manifold: CoACD's part."""
    boxes = [
        ConvexPiece(Box((0.4, 0.1, 0.1)), Pose((0.0, 0.0, 0.2))),
        ConvexPiece(Box((0.1, 0.1, 0.3))),
    ]
    return union_of(boxes)[1]


def checkout(folder: Path) -> Path:
    """A project with a robot of two meshes; the second has a hole, which is V-HACD's part."""
    (folder / "robot").mkdir(parents=True)
    whole = t_bar()
    meshes = {"clean": whole, "open": whole.select(np.arange(1, len(whole.faces)))}
    for name, solid in meshes.items():
        (folder / f"robot/{name}.obj").write_bytes(obj_bytes(solid))
    links = (link(n, inertial(), shape("collision", mesh(f"{n}.obj"))) for n in meshes)
    (folder / "robot/two.urdf").write_text(robot(*links, JOINT, name="two"))
    (folder / "two.yaml").write_text(RECIPE)
    return folder


def manifest(folder: Path, store: Path, jobs: int) -> bytes:
    done = subprocess.run(
        [*BUILD, "-j", str(jobs)],
        cwd=folder,
        env=os.environ | {"ASSETBUILD_CACHE": str(store)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    return (folder / "build/two/manifest.json").read_bytes()


@pytest.fixture(scope="module")
def gold(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    place = tmp_path_factory.mktemp("gold")
    data = manifest(checkout(place / "first"), place / "store", jobs=1)
    assert data.count(b"mjcf/assets/") > 3  # several pieces, not two hulls
    return data


@pytest.mark.slow  # three cold builds with CoACD
@pytest.mark.parametrize(("folder", "jobs"), [("first", 2), ("a longer path/second", 1)])
def test_a_cold_build_makes_the_same_bytes(tmp_path: Path, gold: bytes, folder: str, jobs: int):
    assert manifest(checkout(tmp_path / folder), tmp_path / "store", jobs) == gold
