"""Pairs of bodies that touch in every pose, or in none: found by sampling the joints.

Every body floats freely in MuJoCo and is put where forward kinematics has it, so only collision
detection is asked. Poses are seeded, uniform within the limits; joints that mimic others follow.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Geometry, Mesh, Shapes, Sphere
from assetbuild.robot.tree import forward_kinematics, sample_positions

SEED = 0

SAMPLED = Rule(
    "exclude.sampled",
    "info",
    "pairs of bodies touch in every sampled pose or in none, and are excluded",
    "more `sampled` poses, or `0`",
)


class SamplePairs(Step):
    """`sampled_pairs.json`: {"always": pairs, "never": pairs}, of body names, each sorted.

    Reads `tree.json`, `shapes.json` and the collision files of `meshes/`. The pose in which all
    joints are 0 counts as one of the samples. Bodies without collision are in no pair.
    """

    outputs = ("sampled_pairs.json",)
    isolated = True
    limits = Limits(wall_s=3600.0, memory_mb=4096)

    samples: int = Field(ge=1)

    def run(self, files: Files) -> Iterator[Finding]:
        """Counts contacts of each pair over all poses."""
        robot = RobotFiles(files.inputs)
        solid = sorted({robot.tree.placement(s.link)[0] for s in robot.shapes.of("collision")})
        counts = _counts(robot.tree, robot.shapes, robot.mesh_dir, self.samples)
        jointed = {tuple(sorted((j.parent, j.child))) for j in robot.tree.joints}
        pairs = [pair for pair in combinations(solid, 2) if pair not in jointed]
        always = [pair for pair in pairs if counts.get(pair, 0) == self.samples]
        never = [pair for pair in pairs if counts.get(pair, 0) == 0]
        files.write_json("sampled_pairs.json", {"always": always, "never": never})
        yield SAMPLED(
            "recipe collision.exclude.sampled",
            f"of {len(pairs)} pairs, {len(always)} touch in all and {len(never)} in none "
            f"of {self.samples} poses: they are excluded",
            hint="more poses find rarer contacts" if never else "",
            data={"pairs": len(pairs), "always": len(always), "never": len(never)},
        )


def _counts(
    tree: Tree, shapes: Shapes, meshes: Path, samples: int
) -> Mapping[tuple[str, str], int]:
    """Poses in which each pair of bodies touches."""
    import mujoco

    model = _floating(tree, shapes, meshes)
    data = mujoco.MjData(model)
    names = [body.name for body in tree.bodies]
    counts: dict[tuple[str, str], int] = {}
    poses: list[dict[str, float]] = [{}, *sample_positions(tree, samples - 1, SEED)]
    for positions in poses:
        placed = forward_kinematics(tree, with_mimics(tree, positions))
        data.qpos[:] = np.concatenate([(*placed[n].xyz, *placed[n].quat) for n in names])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for pair in _touching(model, data, names):
            counts[pair] = counts.get(pair, 0) + 1
    return counts


def _touching(model: Any, data: Any, names: list[str]) -> set[tuple[str, str]]:
    """Pairs in contact. Any: mujoco.MjModel and MjData, which have no types."""
    geoms: Array = np.asarray(data.contact.geom).reshape(-1, 2)
    bodies = np.sort(model.geom_bodyid[geoms] - 1, axis=1)
    pairs = ((names[a], names[b]) for a, b in np.unique(bodies, axis=0))
    return {(a, b) if a < b else (b, a) for a, b in pairs}


def _floating(tree: Tree, shapes: Shapes, meshes: Path) -> Any:  # Any: as above
    """The collision geometry, each body with a free joint of its own."""
    import mujoco

    spec, solid = mujoco.MjSpec(), shapes.of("collision")
    spec.meshdir = str(meshes)
    used = {shape.geometry.mesh for shape in solid if isinstance(shape.geometry, Mesh)}
    for asset in shapes.meshes:
        if asset.name in used:
            shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            spec.add_mesh(name=asset.name, file=asset.file, inertia=shell)
    for body in tree.bodies:
        made = spec.worldbody.add_body(mass=1.0, inertia=(1.0, 1.0, 1.0), explicitinertial=True)
        made.add_freejoint()
        for shape in solid:
            carrier, pose = tree.shape_placement(shape)
            if carrier == body.name:
                made.add_geom(**_geom(shape.geometry), pos=pose.xyz, quat=pose.quat)
    return spec.compile()


def _geom(geometry: Geometry) -> dict[str, Any]:  # Any: what MuJoCo takes
    from mujoco import mjtGeom

    match geometry:
        case Box(size):
            return {"type": mjtGeom.mjGEOM_BOX, "size": [edge / 2 for edge in size]}
        case Sphere(radius):
            return {"type": mjtGeom.mjGEOM_SPHERE, "size": (radius, 0.0, 0.0)}
        case Cylinder(radius, length):
            return {"type": mjtGeom.mjGEOM_CYLINDER, "size": (radius, length / 2, 0.0)}
        case Capsule(radius, length):
            return {"type": mjtGeom.mjGEOM_CAPSULE, "size": (radius, length / 2, 0.0)}
        case Mesh(name):
            return {"type": mjtGeom.mjGEOM_MESH, "meshname": name}
