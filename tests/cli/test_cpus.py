"""One recipe, another machine, the same manifest: kernels, folder, time zone, seed, locale, jobs.

A robot with every collision method and every target, meshes in OBJ and COLLADA. No step computes
with what a library chooses: users set BLAS, numpy and libm otherwise.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from daes import CUBE, dae
from urdfs import inertial, joint, link, mesh, robot, shape, tensor

from assetbuild.mesh.cover import union_of
from assetbuild.mesh.obj import obj_bytes
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Cylinder

METHODS = {
    "hull": "{method: hull}",
    "fitted": "{method: primitive}",
    "boxed": "{method: primitive, shape: box}",
    "balls": "{method: spheres}",
    "coarse": "{method: vhacd, vhacd: {resolution: 10000}}",
    "fine": "{method: coacd, coacd: {threshold: 0.2}}",
    "chosen": "{method: auto, vhacd: {resolution: 10000}}",
}
RECIPE = f"""\
schema: assetbuild/v1
robot: arm
source: {{path: robot, urdf: arm.urdf, license: MIT}}
base: fixed
visual: {{max_faces: 100}}
collision:
  preset: manipulation
  default: {{method: none}}
  links: {{{", ".join(f"{name}: {how}" for name, how in METHODS.items())}}}
  exclude: {{adjacent: true, sampled: 200}}
actuators:
  - {{joints: ".*", model: pd, kp: 40, kd: 2, effort: 60, velocity: 5, armature: 0.013}}
keyframes: {{home: {{joints: {{".*": 0.3}}}}}}
randomize: {{links: {{".*": {{density: [0.9, 1.1], com: 0.003, source: guess}}}}}}
targets: [urdf, mjcf, mjx, usd, mjlab, isaaclab]
"""
USER = {
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL",
    "OPENBLAS_NUM_THREADS": "2",
    "PYTHONHASHSEED": "7",
    "TZ": "Asia/Kathmandu",
    "LANG": "tr_TR.UTF-8",
}
KERNELS = {*USER, "OPENBLAS_L2_SIZE"}


def body() -> TriangleMesh:
    """A T with a round head, turned: no number in it is round."""
    boxes = [
        ConvexPiece(Box((0.4, 0.1, 0.1)), Pose((0.0, 0.0, 0.2))),
        ConvexPiece(Box((0.1, 0.1, 0.3))),
        ConvexPiece(tessellate(Cylinder(0.07, 0.2)), Pose((0.13, 0.01, 0.27))),
    ]
    whole = union_of(boxes)[1]
    turn = Pose((0.011, -0.007, 0.031), tuple(np.array([9.0, 1.0, 2.0, 3.0]) / 95**0.5))
    return TriangleMesh(np.round(turn.apply(whole.vertices), 6), whole.faces)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("project")
    (folder / "robot").mkdir()
    (folder / "robot/body.obj").write_bytes(obj_bytes(body()))
    spread = inertial(1.3, tensor(0.0121, 0.0137, 0.0149), "0.013 -0.007 0.021")
    (folder / "robot/cubes.dae").write_bytes(dae(CUBE))
    drawn = [shape(role, mesh("body.obj")) for role in ("visual", "collision")]
    drawn.append(shape("visual", mesh("cubes.dae")))
    links = [link(name, spread, *drawn) for name in METHODS]
    names = list(METHODS)
    joints = [joint(f"j_{b}", a, b, xyz="0.1 0.07 0.5") for a, b in itertools.pairwise(names)]
    (folder / "robot/arm.urdf").write_text(robot(*links, *joints, name="arm"))
    (folder / "arm.yaml").write_text(RECIPE)
    return folder


def manifest(project: Path, place: Path, environment: dict[str, str], jobs: int) -> dict[str, str]:
    """Path -> digest, of a cold build without pictures."""
    words = ["build", "arm.yaml", "-o", str(place / "bundle"), "--fail-on", "never"]
    kept = {name: value for name, value in os.environ.items() if name not in KERNELS}
    own = {"ASSETBUILD_CACHE": str(place / "store"), "MUJOCO_GL": "disable"}
    done = subprocess.run(
        [sys.executable, "-m", "assetbuild", *words, "-j", str(jobs)],
        cwd=project,
        env=kept | own | environment,
        capture_output=True,
        text=True,
        timeout=3000,
    )
    assert done.returncode == 0, done.stderr
    files = json.loads((place / "bundle/manifest.json").read_bytes())["files"]
    return {row["path"]: row["sha256"] for row in files}


@pytest.mark.slow  # two cold builds with every collision method
def test_another_machine_gives_the_same_manifest(project: Path, tmp_path: Path):
    gold = manifest(project, tmp_path / "gold", {}, 1)
    assert len(gold) > 40
    other = shutil.copytree(project, tmp_path / "a longer path" / "project")
    assert manifest(other, tmp_path / "other", USER, 2) == gold
