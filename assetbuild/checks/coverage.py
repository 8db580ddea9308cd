"""Does what collides lie where the robot is seen? Visual against collision geometry, per body.

Collision methods measure what they make; this measures what will be simulated, whatever it came
from: a kept shape that moved by 3 cm is nobody's result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.kinds import Check, write_figures
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.primitives import Primitive, tessellate
from assetbuild.mesh.solids import Distance, distance_to
from assetbuild.recipe.models import Recipe
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Mesh, Shape, Shapes, Tree
from assetbuild.robot.pose import IDENTITY, Array

MOST_POINTS = 4000
"""Of a body's visual vertices, evenly spread over their list: enough for a percentile."""


@dataclass(frozen=True)
class Fit:
    """bare: 95 % of the visual vertices stick out of the collision less than this; over: how far
    collision sticks out of the visual hulls of its body and of the next ones; shift: both ends
    moved alike, by axis. m.
    """

    bare_m: float
    over_m: float
    shift_m: tuple[float, float, float]
    size_m: float


class Coverage(Check):
    """Finding `coverage.shift`; figures: a row for each body with both kinds of geometry."""

    version = "2"
    tools = ("numpy", "scipy")
    isolated = True
    preload = ("numpy", "scipy.spatial", "fast_simplification")
    reads = ("tree.json", "shapes.json", "meshes/")

    max_shift: float = 0.015
    """m."""
    max_shift_share: float = 0.08
    """Of the body's size: a shift below it is a simplification."""

    @classmethod
    def configure(cls, recipe: Recipe) -> Self:
        """The limits stand in `validate`."""
        wish = recipe.validate_
        return cls(max_shift=wish.max_shift, max_shift_share=wish.max_shift_share)

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads tree, shapes and meshes."""
        tree = decode(Tree, (files.inputs / "tree.json").read_bytes())
        shapes = decode(Shapes, (files.inputs / "shapes.json").read_bytes())
        clouds = {
            asset.name: read_triangles((files.inputs / "meshes" / asset.file).read_bytes()).vertices
            for asset in shapes.meshes
        }
        seen = {b.name: _points(tree, shapes, clouds, b.name, "visual") for b in tree.bodies}
        visual = {name: points for name, points in seen.items() if points is not None}
        hulls = {name: distance_to(points, IDENTITY) for name, points in visual.items()}
        fits = {}
        for body in visual:
            collision = _points(tree, shapes, clouds, body, "collision")
            if collision is not None:
                solids = _solids(tree, shapes, clouds, body)
                beyond = _beyond_robot(tree, hulls, body, collision)
                fits[body] = _fit(visual[body], collision, solids, beyond)
        rows = [
            {"body": name, "not_covered_mm": 1e3 * f.bare_m, "sticks_out_mm": 1e3 * f.over_m,
             "shift_mm": [1e3 * v for v in f.shift_m]}
            for name, f in fits.items()
        ]  # fmt: skip
        write_figures(files, {"bodies": rows})
        for name, fit in fits.items():
            largest = max(map(abs, fit.shift_m))
            limit = max(self.max_shift, self.max_shift_share * fit.size_m)
            if largest > limit and fit.over_m > 0.5 * largest:
                axis = "xyz"[int(np.argmax(np.abs(fit.shift_m)))]
                yield Finding(
                    "coverage.shift",
                    "warning",
                    f"link {name}",
                    f"its collision geometry lies {1e3 * largest:.3g} mm along {axis} from its "
                    "visual geometry",
                    hint="compare their `<origin>` in the source; look at the report's 3D view",
                    data={"shift_m": fit.shift_m, "limit_m": limit},
                )


def _fit(visual: Array, collision: Array, solids: Sequence[Distance], beyond_m: float) -> Fit:
    some = visual[:: -(-len(visual) // MOST_POINTS)]
    bare = np.min([distance(some) for distance in solids], axis=0)
    lower = collision.min(axis=0) - visual.min(axis=0)
    upper = collision.max(axis=0) - visual.max(axis=0)
    alike = np.where(lower * upper > 0.0, np.minimum(np.abs(lower), np.abs(upper)), 0.0)
    x, y, z = (float(v) for v in np.sign(lower) * alike)
    size = float(np.linalg.norm(visual.max(axis=0) - visual.min(axis=0)))
    return Fit(max(float(np.percentile(bare, 95)), 0.0), beyond_m, (x, y, z), size)


def _beyond_robot(tree: Tree, hulls: Mapping[str, Distance], body: str, collision: Array) -> float:
    """How far collision sticks out of the visual hulls of its body and of the next ones, m.

    A source may give a motor to one link to be seen and to its neighbour to be hit.
    """
    above = tree.joint_above.get(body)
    poses = {body: IDENTITY}
    if above is not None:
        poses[above.parent] = above.X_parent_joint.inverse()
    poses |= {j.child: j.X_parent_joint for j in tree.joints if j.parent == body}
    apart = [
        hulls[name](X_body_other.inverse().apply(collision))
        for name, X_body_other in poses.items()
        if name in hulls
    ]
    return max(float(np.min(apart, axis=0).max()), 0.0)


def _solids(tree: Tree, shapes: Shapes, clouds: Mapping[str, Array], body: str) -> list[Distance]:
    return [
        distance_to(_solid(shape, clouds), X_body_link @ shape.X_link_shape)
        for shape in shapes.of("collision")
        for owner, X_body_link in (tree.placement(shape.link),)
        if owner == body
    ]


def _solid(shape: Shape, clouds: Mapping[str, Array]) -> Primitive | Array:
    return clouds[shape.geometry.mesh] if isinstance(shape.geometry, Mesh) else shape.geometry


def _points(
    tree: Tree, shapes: Shapes, clouds: Mapping[str, Array], body: str, role: str
) -> Array | None:
    """(n, 3) of a body's shapes of one role, in its frame, m."""
    found = []
    for shape in shapes.shapes:
        owner, X_body_link = tree.placement(shape.link)
        if owner == body and shape.role == role:
            geometry = shape.geometry
            own = (
                clouds[geometry.mesh]
                if isinstance(geometry, Mesh)
                else tessellate(geometry).vertices
            )
            found.append((X_body_link @ shape.X_link_shape).apply(own))
    return np.concatenate(found) if found else None
