"""Does what collides lie where the robot is seen? Visual against collision geometry, per body.

Collision methods measure what they make; this measures what will be simulated, whatever it came
from: a kept shape that moved by 3 cm is nobody's result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.kinds import Check, write_figures
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.primitives import Primitive, tessellate
from assetbuild.mesh.solids import distance_to
from assetbuild.recipe.models import Recipe
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Mesh, Shape, Shapes, Tree
from assetbuild.robot.pose import IDENTITY, Array

MOST_POINTS = 4000
"""Of a body's visual vertices, evenly spread over their list: enough for a percentile."""
SHARE = 0.08
"""Of the body's size: a shift below it is a simplification."""


@dataclass(frozen=True)
class Fit:
    """bare: 95 % of the visual vertices stick out of the collision less than this; over: how far
    collision sticks out of the visual hull; shift: both ends moved alike, by axis. m."""

    bare_m: float
    over_m: float
    shift_m: tuple[float, float, float]
    size_m: float


class Coverage(Check):
    """Finding `coverage.shift`; figures: a row for each body with both kinds of geometry."""

    tools = ("numpy", "scipy")
    isolated = True
    preload = ("numpy", "scipy.spatial", "fast_simplification")
    reads = ("tree.json", "shapes.json", "meshes/")

    max_shift: float = 0.015
    """m."""

    @classmethod
    def configure(cls, recipe: Recipe) -> Self:
        """The limit stands in `validate.max_shift`."""
        return cls(max_shift=recipe.validate_.max_shift)

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads tree, shapes and meshes."""
        tree = decode(Tree, (files.inputs / "tree.json").read_bytes())
        shapes = decode(Shapes, (files.inputs / "shapes.json").read_bytes())
        clouds = {
            asset.name: read_triangles((files.inputs / "meshes" / asset.file).read_bytes()).vertices
            for asset in shapes.meshes
        }
        fits = {}
        for body in tree.bodies:
            fit = _fit(tree, shapes, clouds, body.name)
            if fit is not None:
                fits[body.name] = fit
        rows = [
            {"body": name, "not_covered_mm": 1e3 * f.bare_m, "sticks_out_mm": 1e3 * f.over_m,
             "shift_mm": [1e3 * v for v in f.shift_m]}
            for name, f in fits.items()
        ]  # fmt: skip
        write_figures(files, {"bodies": rows})
        for name, fit in fits.items():
            largest = max(map(abs, fit.shift_m))
            if largest > max(self.max_shift, SHARE * fit.size_m):
                axis = "xyz"[int(np.argmax(np.abs(fit.shift_m)))]
                yield Finding(
                    "coverage.shift",
                    "warning",
                    f"link {name}",
                    f"its collision geometry lies {1e3 * largest:.3g} mm along {axis} from its "
                    "visual geometry",
                    hint="compare their `<origin>` in the source; look at the report's 3D view",
                    data={"shift_m": fit.shift_m, "limit_m": self.max_shift},
                )


def _fit(tree: Tree, shapes: Shapes, clouds: Mapping[str, Array], body: str) -> Fit | None:
    """None for a body without one of the two, or without volume."""
    visual = _points(tree, shapes, clouds, body, "visual")
    collision = _points(tree, shapes, clouds, body, "collision")
    if visual is None or collision is None:
        return None
    try:
        convex_hull(visual)
    except StepError:
        return None
    solids = [
        distance_to(_solid(shape, clouds), X_body_link @ shape.X_link_shape)
        for shape in shapes.of("collision")
        for owner, X_body_link in (tree.placement(shape.link),)
        if owner == body
    ]
    some = visual[:: -(-len(visual) // MOST_POINTS)]
    bare = np.min([distance(some) for distance in solids], axis=0)
    over = distance_to(visual, IDENTITY)(collision)
    lower = collision.min(axis=0) - visual.min(axis=0)
    upper = collision.max(axis=0) - visual.max(axis=0)
    alike = np.where(lower * upper > 0.0, np.minimum(np.abs(lower), np.abs(upper)), 0.0)
    x, y, z = (float(v) for v in np.sign(lower) * alike)
    return Fit(
        max(float(np.percentile(bare, 95)), 0.0),
        max(float(over.max()), 0.0),
        (x, y, z),
        float(np.linalg.norm(visual.max(axis=0) - visual.min(axis=0))),
    )


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
