"""Go1 in primitives of ours against the hand-made ones: shape, number, speed, in one run.

    ASSETBUILD_TEST_DATA=.../share ASSETBUILD_SHARED=... python tests/benchmarks/go1_primitives.py

Builds the robot with `method: primitive` from its visual meshes; the hand-made model's collision
geoms come from $ASSETBUILD_SHARED/gold/unitree_go1.json and replace ours in the same MJCF. Hip and
thigh are scored as one, because the hand-made model puts the thigh's motor on the hip. A quarter
of their surface is walls inside of the solid, which nothing can touch: the mean distance is given
over all faces, and over the outer ones.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any  # mujoco has no types

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from links import load_link, robots_root

from assetbuild.mesh.cover import Reference, measure, union_of
from assetbuild.mesh.quality import NearestSurface, surface_samples
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import face_normals, merged
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Sphere

RECIPE = """\
schema: assetbuild/v1
robot: go1
source:
  path: {root}
  urdf: robots/go1_description/urdf/go1.urdf
  packages: {{example-robot-data: .}}
base: floating
collision:
  default: {{method: none}}
  links:
    trunk: {{method: primitive, max_hulls: 2, from: visual}}
    ".*_hip": {{method: primitive, max_hulls: 2, from: visual}}
    ".*_thigh": {{method: primitive, shape: capsule, max_hulls: 3, from: visual}}
    # The calf's mesh ends in the foot, which is a sphere and touches in one point.
    ".*_calf": {{method: primitive, shape: [capsule, sphere], max_hulls: 2, from: visual}}
targets: [mjcf]
validate: {{free_fall: null}}
"""
X_HIP_MESH = Pose(quat=(0.0, 0.0, 1.0, 0.0))
X_HIP_THIGH = Pose((0.0, 0.08, 0.0), quat_of_rpy(0.0, 0.9, 0.0))
BEYOND = 3e-3
"""Of the diagonal: a wall with the solid on both sides, so far from it, is inside."""
STEPS, STARTS, ROUNDS = 1000, 8, 5


# --- the two robots -------------------------------------------------------------------------


def built(place: Path) -> mujoco.MjSpec:
    """Ours, as the recipe makes it."""
    recipe = place / "go1.yaml"
    recipe.write_text(RECIPE.format(root=robots_root().parent.resolve()), encoding="utf-8")
    command = [sys.executable, "-m", "assetbuild", "build", str(recipe), "-o", str(place / "go1")]
    subprocess.run([*command, "--fail-on", "never"], check=True, stdout=sys.stderr)
    return mujoco.MjSpec.from_file(str(place / "go1/mjcf/scene.xml"))


def with_hand_made(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """The same robot and scene with the hand-made collision geoms."""
    for geom in list(spec.geoms):
        if _collides(geom) and geom.parent.name != "world":
            spec.delete(geom)
    for row in _gold():
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{_kind(row).upper()}")
        spec.body(row["body"]).add_geom(
            type=kind, size=row["size"], pos=row["pos"], quat=row["quat"]
        )
    return spec


def _collides(geom: Any) -> bool:
    return bool(geom.contype or geom.conaffinity)


def _gold() -> list[dict[str, Any]]:
    path = Path(os.environ["ASSETBUILD_SHARED"]) / "gold/unitree_go1.json"
    rows: list[dict[str, Any]] = json.loads(path.read_text())["collision_geoms"]
    return rows


def _kind(row: dict[str, Any]) -> str:
    return str(row["type"]).lower().removeprefix("mjgeom_")


# --- shape ----------------------------------------------------------------------------------


def pieces_of(model: mujoco.MjModel, body: str) -> list[ConvexPiece]:
    """The collision geoms of a body, in its frame."""
    found = []
    for number in np.flatnonzero(model.geom_bodyid == model.body(body).id):
        geom = model.geom(int(number))
        if not (geom.contype[0] or geom.conaffinity[0]):
            continue
        size = [float(s) for s in geom.size]
        solid = {
            mujoco.mjtGeom.mjGEOM_BOX: lambda s: Box((2 * s[0], 2 * s[1], 2 * s[2])),
            mujoco.mjtGeom.mjGEOM_SPHERE: lambda s: Sphere(s[0]),
            mujoco.mjtGeom.mjGEOM_CAPSULE: lambda s: Capsule(s[0], 2 * s[1]),
            mujoco.mjtGeom.mjGEOM_CYLINDER: lambda s: Cylinder(s[0], 2 * s[1]),
        }[mujoco.mjtGeom(int(geom.type[0]))](size)
        pose = Pose(tuple(geom.pos.tolist()), tuple(geom.quat.tolist()))
        found.append(ConvexPiece(solid, pose))
    return found


def placed(pieces: Sequence[ConvexPiece], pose: Pose) -> list[ConvexPiece]:
    """The pieces in the frame that `pose` is given in."""
    return [replace(p, X_frame_piece=pose @ p.X_frame_piece) for p in pieces]


def outer_mean(reference: Reference, pieces: Sequence[ConvexPiece]) -> float:
    """Two-sided mean distance without the mesh's inner walls, m."""
    mesh = reference.mesh
    points, faces = surface_samples(mesh, 4000, 0)
    normals = BEYOND * reference.diagonal * face_normals(mesh)[faces]
    both = [reference.solid.contains(points + side * normals) for side in (1.0, -1.0)]
    _, skin = union_of(pieces)
    to_skin = NearestSurface(skin).distance(points[~(both[0] & both[1])])
    to_mesh = reference.surface.distance(surface_samples(skin, 4000, 1)[0])
    return float(to_skin.mean() + to_mesh.mean()) / 2.0


def shapes(models: dict[str, mujoco.MjModel]) -> None:
    """The table of hip and thigh at home, rear left."""
    whole = [load_link("go1_hip").placed(X_HIP_MESH), load_link("go1_thigh").placed(X_HIP_THIGH)]
    reference = Reference(cleaned(merged(whole)))
    print("| hip + thigh | IoU | over | missing | mean % | outer faces % | outside mm | geoms |")
    print("|---|---|---|---|---|---|---|---|")
    for name, model in models.items():
        pieces = pieces_of(model, "RL_hip") + placed(pieces_of(model, "RL_thigh"), X_HIP_THIGH)
        q = measure(reference, pieces)
        mean, outer = (
            100 * m / reference.diagonal for m in (q.mean_m, outer_mean(reference, pieces))
        )
        print(
            f"| {name} | {q.iou:.3f} | {q.over:.2f} | {q.missing:.2f} | {mean:.2f} | {outer:.2f} "
            f"| {1e3 * q.max_outside_m:.1f} | {q.pieces} |"
        )


# --- speed ----------------------------------------------------------------------------------


def alike(model: mujoco.MjModel) -> None:
    """One scene for both: surfaces, options and filters are the same; no drives."""
    model.opt.timestep = 0.002
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.impratio = 1.0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.geom_friction[:] = (0.6, 0.005, 0.0001)
    model.geom_condim[:] = 3
    model.geom_priority[:] = 0
    model.geom_margin[:] = 0.0
    model.geom_solref[:] = (0.02, 1.0)
    model.geom_solimp[:] = (0.9, 0.95, 0.001, 0.5, 2.0)
    model.dof_armature[6:] = 0.01
    model.dof_frictionloss[6:] = 0.2


def dropped(model: mujoco.MjModel) -> tuple[float, float, float]:
    """(steps per CPU second, contacts per step, mean height of the trunk at the end in m).

    One drop is chaos: how the robot comes to lie decides the contacts. So it is dropped from
    several seeded attitudes, up to about 45 degrees from level.
    """
    tilts = np.random.default_rng(0).normal(0.0, 0.25, (STARTS, 3))
    touching, heights, seconds = 0, 0.0, 0.0
    for tilt in tilts:
        data = mujoco.MjData(model)
        data.qpos[:3] = (0.0, 0.0, 0.35)
        data.qpos[3:7] = (1.0, *tilt)
        data.qpos[7:] = np.tile((0.0, 0.9, -1.8), 4)
        mujoco.mj_normalizeQuat(model, data.qpos)
        began = time.process_time()
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
            touching += data.ncon
        seconds += time.process_time() - began
        heights += float(data.qpos[2])
    steps = STARTS * STEPS
    return steps / seconds, touching / steps, heights / STARTS


def speeds(models: dict[str, mujoco.MjModel]) -> None:
    """Both are dropped in turn, so that what else the machine does hits both."""
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in models}
    for model in models.values():
        alike(model)
        dropped(model)
    for _ in range(ROUNDS):
        for name, model in models.items():
            found[name].append(dropped(model))
    print("\n| whole robot, dropped | geoms | steps/s | ratio | contacts/step | final z m |")
    print("|---|---|---|---|---|---|")
    first = statistics.median(row[0] for row in found["by hand"])
    for name, model in models.items():
        rate = statistics.median(row[0] for row in found[name])
        solid = (model.geom_contype != 0) & (model.geom_bodyid != 0)
        _, contacts, height = found[name][0]
        print(
            f"| {name} | {int(solid.sum())} | {rate:,.0f} | {rate / first:.2f} | {contacts:.1f} "
            f"| {height:.3f} |"
        )


def main() -> None:
    """Print both tables."""
    with tempfile.TemporaryDirectory() as folder:
        spec = built(Path(folder))
        models = {"ours": spec.compile(), "by hand": with_hand_made(spec).compile()}
    shapes(models)
    speeds(models)


if __name__ == "__main__":
    main()
