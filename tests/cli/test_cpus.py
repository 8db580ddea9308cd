"""One recipe, other CPU kernels, the same manifest: no step computes with what a library chooses.

A robot with every collision method and every target is built under what users set for BLAS, numpy
and libm, and with children on emulated CPUs of another maker.
"""

from __future__ import annotations

import itertools
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from urdfs import inertial, joint, link, mesh, robot, shape, tensor

from assetbuild.engine.cpu import cpu_class
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
USERS = (
    {"OPENBLAS_CORETYPE": "SkylakeX", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL"},
    {"OPENBLAS_CORETYPE": "Sandybridge", "OPENBLAS_NUM_THREADS": "2"},
    {"OPENBLAS_CORETYPE": "Prescott", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
)
KERNELS = {name for each in USERS for name in each} | {"OPENBLAS_L2_SIZE"}
EMULATED = ("Haswell", "EPYC-Rome")


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


def emulator_version() -> tuple[int, ...]:
    """Of qemu-x86_64; 7.2 crashes in numpy's sorting. Empty: there is none."""
    if shutil.which("qemu-x86_64") is None:
        return ()
    said = subprocess.run(["qemu-x86_64", "--version"], capture_output=True, text=True).stdout
    return tuple(int(part) for part in re.findall(r"\d+", said)[:2])


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("project")
    (folder / "robot").mkdir()
    (folder / "robot/body.obj").write_bytes(obj_bytes(body()))
    spread = inertial(1.3, tensor(0.0121, 0.0137, 0.0149), "0.013 -0.007 0.021")
    drawn = [shape(role, mesh("body.obj")) for role in ("visual", "collision")]
    links = [link(name, spread, *drawn) for name in METHODS]
    names = list(METHODS)
    joints = [joint(f"j_{b}", a, b, xyz="0.1 0.07 0.5") for a, b in itertools.pairwise(names)]
    (folder / "robot/arm.urdf").write_text(robot(*links, *joints, name="arm"))
    (folder / "arm.yaml").write_text(RECIPE)
    return folder


def manifest(project: Path, place: Path, environment: dict[str, str], emulator: str = "") -> dict:
    """Path -> digest, of a cold build without pictures. emulator: what starts children's Python."""
    program = "import sys; from assetbuild.cli import main; sys.exit(main(sys.argv[1:]))"
    if emulator:
        place.mkdir()
        wrapper = place / "python"
        lines = ("#!/bin/sh", f"echo >> {place}/emulated", f'exec {emulator} {sys.executable} "$@"')
        wrapper.write_text("\n".join(lines))
        wrapper.chmod(0o755)
        program = f"import sys; sys.executable = {str(wrapper)!r}; {program}"
    words = ["build", "arm.yaml", "-o", str(place / "bundle"), "--fail-on", "never"]
    kept = {name: value for name, value in os.environ.items() if name not in KERNELS}
    own = {"ASSETBUILD_CACHE": str(place / "store"), "MUJOCO_GL": "disable"}
    done = subprocess.run(
        [sys.executable, "-c", program, *words],
        cwd=project,
        env=kept | own | environment,
        capture_output=True,
        text=True,
        timeout=3000,
    )
    assert done.returncode == 0, done.stderr
    files = json.loads((place / "bundle/manifest.json").read_bytes())["files"]
    return {row["path"]: row["sha256"] for row in files}


@pytest.fixture(scope="module")
def gold(project: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    found = manifest(project, tmp_path_factory.mktemp("gold"), {})
    assert len(found) > 40
    return found


@pytest.mark.slow  # a cold build with every collision method
@pytest.mark.parametrize("environment", USERS, ids=lambda e: " ".join(map("=".join, e.items())))
def test_whatever_users_ask_of_libraries_the_manifest_is_the_same(
    project, gold, tmp_path, environment
):
    assert manifest(project, tmp_path, environment) == gold


@pytest.mark.slow  # emulated
@pytest.mark.skipif(platform.machine() != "x86_64", reason="emulates other x86 CPUs")
@pytest.mark.skipif(cpu_class().name != "v3", reason="this CPU lacks AVX2 or FMA")
@pytest.mark.skipif(emulator_version() < (8, 0), reason="needs qemu-x86_64 8 or newer (qemu-user)")
@pytest.mark.parametrize("model", EMULATED)
def test_on_an_emulated_cpu_of_another_maker_the_manifest_is_the_same(
    project, gold, tmp_path, model
):
    """Neither has AVX-512, and of approximate instructions such as RCPPS each has its own."""
    emulated = manifest(project, tmp_path / "place", {}, f"qemu-x86_64 -cpu {model}")
    assert emulated == gold
    assert (tmp_path / "place/emulated").stat().st_size >= 4  # so many workers
