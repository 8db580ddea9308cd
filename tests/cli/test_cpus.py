"""One recipe, another machine, the same manifest: kernels, folder, time zone, seed, locale, jobs.

A robot with every collision method and every target, meshes in OBJ and COLLADA. No step computes
with what a library chooses: users set BLAS, numpy and libm otherwise.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from daes import CUBE, dae
from solids import solid
from urdfs import inertial, joint, link, mesh, robot, shape, tensor

from assetbuild.mesh.obj import obj_bytes
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Pose

from .conftest import Place

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


def body() -> TriangleMesh:
    """A T, turned: no number in it is round."""
    whole = solid(((0.4, 0.1, 0.1), (0.0, 0.0, 0.2)), ((0.1, 0.1, 0.3), (0.0, 0.0, 0.0)))
    turn = Pose((0.011, -0.007, 0.031), tuple(np.array([9.0, 1.0, 2.0, 3.0]) / 95**0.5))
    return TriangleMesh(np.round(turn.apply(whole.vertices), 6), whole.faces)


def laid_out(folder: Path) -> Place:
    place = Place(folder, folder / "store", "arm.yaml")
    place.robot.mkdir(parents=True)
    (place.robot / "body.obj").write_bytes(obj_bytes(body()))
    (place.robot / "cubes.dae").write_bytes(dae(CUBE))
    spread = inertial(1.3, tensor(0.0121, 0.0137, 0.0149), "0.013 -0.007 0.021")
    drawn = [shape(role, mesh("body.obj")) for role in ("visual", "collision")]
    drawn.append(shape("visual", mesh("cubes.dae")))
    links = [link(name, spread, *drawn) for name in METHODS]
    pairs = itertools.pairwise(METHODS)
    joints = [joint(f"j_{b}", a, b, xyz="0.1 0.07 0.5") for a, b in pairs]
    (place.robot / "arm.urdf").write_text(robot(*links, *joints, name="arm"))
    place.recipe.write_text(RECIPE)
    return place


@pytest.mark.slow  # two cold builds with every collision method
def test_another_machine_gives_the_same_manifest(tmp_path: Path):
    here, there = laid_out(tmp_path / "gold"), laid_out(tmp_path / "a longer path/project")
    for place, jobs, environment in ((here, "-j1", {}), (there, "-j2", USER)):
        done = place.build(jobs, "--fail-on", "never", **environment)
        assert done.returncode == 0, done.stderr
    assert here.manifest().count(b"sha256") > 40
    assert here.manifest() == there.manifest()
