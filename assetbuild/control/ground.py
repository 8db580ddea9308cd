"""Where the ground is under a robot: its lowest collision point.

A floating robot is put on it. A fixed one stays where it is, and the floor of its scenes lies below
whatever of it moves: see `robot.floor`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from assetbuild.findings import Finding, Rule
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.primitives import half_height
from assetbuild.robot import model
from assetbuild.robot.floor import BELOW_M, brings_floor, floor_of
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import ellipsoids
from assetbuild.robot.pose import Array, Pose, Quat
from assetbuild.robot.sections import Keyframe
from assetbuild.robot.shapes import Mesh, Shapes
from assetbuild.robot.tree import forward_kinematics

STANDS_M = 0.01
"""A fixed robot whose base ends so near to z = 0 is drawn to stand on a floor or a table there."""

NO_GROUND = Rule(
    "keyframe.no_ground",
    "warning",
    "`on_ground` needs collision geometry, and there is none",
    "give the links collision geometry, or the keyframe `base: [x, y, z]`",
)
FIXED_BASE = Rule(
    "keyframe.fixed_base",
    "warning",
    "a keyframe places the base of a fixed robot",
    "remove `base` from the keyframe, or make the robot `base: floating`",
)
REACHES_BELOW = Rule(
    "keyframe.reaches_below",
    ("warning", "info"),
    "a moving link of a fixed robot starts below z = 0, so the scenes' floor lies below it (a "
    "warning where its base stands on z = 0)",
    "turn the joints in the keyframe `home`, or mount the robot that much higher in a scene with a "
    "floor or a table at z = 0",
)


class Ground:
    """The lowest collision point of the robot; mesh files are read once, when first needed."""

    def __init__(
        self,
        tree: model.Tree,
        shapes: Shapes,
        mesh_dir: Path,
        mjcf_only: Iterable[model.MjcfOnly] = (),
    ) -> None:
        self._tree, self._shapes, self._mesh_dir = tree, shapes.of("collision"), mesh_dir
        self._ellipsoids = tuple(ellipsoids(mjcf_only))
        self._files = {asset.name: asset.file for asset in shapes.meshes}
        self._vertices: dict[str, Array] = {}

    def lowest(self, q: Mapping[str, float], quat_world_root: Quat) -> float | None:
        """z of the lowest point with the root in the origin, m; None without collision geometry."""
        X_world_root = Pose(quat=quat_world_root)
        return min(self.lowest_of_bodies(q, X_world_root).values(), default=None)

    def lowest_of_bodies(self, q: Mapping[str, float], X_world_root: Pose) -> dict[str, float]:
        """z in the world of the lowest point of each body that has collision geometry, m."""
        X_root_body = forward_kinematics(self._tree, q)
        bottoms: dict[str, float] = {}
        for shape in self._shapes:
            body, X_body_link = self._tree.placement(shape.link)
            X_root_shape = X_root_body[body] @ X_body_link @ shape.X_link_shape
            X_world_shape, geometry = X_world_root @ X_root_shape, shape.geometry
            if isinstance(geometry, Mesh):
                bottom = float(X_world_shape.apply(self._mesh(geometry.mesh))[:, 2].min())
            else:
                bottom = X_world_shape.xyz[2] - half_height(geometry, X_world_shape.rotation[2])
            bottoms[body] = min(bottom, bottoms.get(body, bottom))
        for link, X_link_ellipsoid, semi_axes_m in self._ellipsoids:
            body, X_body_link = self._tree.placement(link)
            X = X_world_root @ X_root_body[body] @ X_body_link @ X_link_ellipsoid
            bottom = X.xyz[2] - float(np.linalg.norm(X.rotation[2] * semi_axes_m))
            bottoms[body] = min(bottom, bottoms.get(body, bottom))
        return bottoms

    @property
    def base_stands_on_zero(self) -> bool:
        """Whether the base of a fixed robot is drawn to stand on z = 0."""
        moved = moved_bodies(self._tree)
        bottoms = self.lowest_of_bodies({}, self._tree.X_world_root)
        bottom = min((z for body, z in bottoms.items() if body not in moved), default=math.inf)
        return abs(bottom) <= STANDS_M

    def _mesh(self, name: str) -> Array:
        if name not in self._vertices:
            path = self._mesh_dir / self._files[name]
            mesh = read_triangles(path.read_bytes(), f"mesh {name}")
            self._vertices[name] = mesh.vertices[mesh.is_used]
        return self._vertices[name]


def moved_bodies(tree: model.Tree) -> set[str]:
    """Bodies that a joint moves against the root."""
    moved: set[str] = set()
    for joint in tree.joints:  # a parent before its children
        if joint.kind != "fixed" or joint.parent in moved:
            moved.add(joint.child)
    return moved


def placed_base(
    tree: model.Tree,
    name: str,
    keyframe: Keyframe,
    q: Mapping[str, float],
    ground: Ground,
    turn: Quat,
) -> tuple[Pose | None, list[Finding]]:
    """X_world_root; None for a fixed base. turn: how the source's world holds a floating root."""
    if tree.base == "fixed":
        if keyframe.base == "on_ground":
            return None, []
        return None, [
            FIXED_BASE(
                "robot",
                f"keyframe `{name}`: its `base` is not used, the robot's base is fixed",
                data={"keyframe": name},
            )
        ]
    if keyframe.base != "on_ground":
        return Pose(keyframe.base, turn), []
    lowest = ground.lowest(q, turn)
    if lowest is not None:
        return Pose((0.0, 0.0, 0.0 - lowest), turn), []
    return Pose(quat=turn), [
        NO_GROUND(
            "robot",
            f"keyframe `{name}`: no collision geometry to put on the ground; z = 0",
            data={"keyframe": name},
        )
    ]


def with_reach(
    tree: model.Tree, control: model.Control, ground: Ground
) -> tuple[model.Control, list[Finding]]:
    """The control with how far a fixed robot's moving shapes reach below z = 0 where it starts."""
    if tree.base != "fixed" or brings_floor(tree, control):
        return control, []
    start = dict(initial_pose(tree, control).joints)
    bottoms = ground.lowest_of_bodies(start, tree.X_world_root)
    low = {b: z for b, z in bottoms.items() if b in moved_bodies(tree) and z < -BELOW_M}
    if not low:
        return control, []
    reaching = replace(control, reach_m=-min(low.values()))
    floor_m, stands = floor_of(tree, reaching).height_m, ground.base_stands_on_zero
    body = min(low, key=lambda name: low[name])
    others = f", and {len(low) - 1} more by less" if len(low) > 1 else ""
    where = "the plane that its base stands on" if stands else "z = 0"
    finding = REACHES_BELOW(
        f"link {body}",
        f"starts {-1e3 * low[body]:.3g} mm below {where}{others}: the scenes' floor lies at "
        f"z = {floor_m:g} m",
        severity="warning" if stands else "info",
        data={"below_m": -low[body], "floor_m": floor_m},
    )
    return reaching, [finding]
