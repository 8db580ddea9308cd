"""Does what collides lie where the robot is seen? Visual against collision geometry, per body.

Collision methods measure what they make; this measures what will be simulated, whatever it came
from: a kept shape that moved by 3 cm is nobody's result.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.hulls import common_hull, hulls_by_body, read_meshes
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.rays import Hole, holes
from assetbuild.mesh.solid import Distance, beyond_hull, distance_to
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.plugin_types import Check, write_figures
from assetbuild.recipe_types import Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import IDENTITY, Array, Pose
from assetbuild.robot.shapes import Mesh, Role, Shape

LEFT = 0.1
"""A hole of which less than this is left is filled."""

SHIFT = Rule(
    "coverage.shift",
    "warning",
    "collision geometry is beside the visual geometry of its body",
    "compare their origins",
)
HOLE = Rule(
    "coverage.hole",
    "info",
    "the visual geometry of a body has an opening that its collision closes (a mesh counts as "
    "its hull)",
    "more pieces, and `keep_open` where something must pass",
)


@dataclass(frozen=True)
class Fit:
    """over_m: how far collision sticks out of the visual hulls of its body and of the next ones;
    shift_m: both ends of the body moved alike, by axis.
    """

    over_m: float
    shift_m: tuple[float, float, float]
    size_m: float

    @property
    def largest_m(self) -> float:
        """Along the axis of the largest shift."""
        return max(map(abs, self.shift_m))


class Coverage(Check):
    """Findings `coverage.*`; figures: a row for each body with both kinds of geometry."""

    usual_s = 2.0
    isolated = True
    preload = MESH_MODULES
    reads = ("tree.json", "shapes.json", "triangles.npz", "hulls.npz")

    section = "validate"

    max_shift: Positive = Field(
        0.015, description="m: collision geometry beside the visual geometry of its body, warning"
    )
    max_shift_share: Positive = Field(
        0.08, description="the same as a share of the body's size; the larger of the two counts"
    )

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads tree, shapes, meshes and their hulls."""
        parts = Parts(RobotFiles(files.inputs))
        names = [body.name for body in parts.tree.bodies]
        fits = {b: _fit(parts, b) for b in names if parts.seen(b) and parts.solid(b)}
        rows = [
            {"body": name, "sticks_out_mm": 1e3 * fit.over_m,
             "shift_mm": [1e3 * v for v in fit.shift_m]}
            for name, fit in fits.items()
        ]  # fmt: skip
        limits = dict.fromkeys(("sticks_out_mm", "shift_mm"), 1e3 * self.max_shift)
        write_figures(files, {"bodies": rows}, limits)
        yield from self._shifts({name: fit for name, fit in fits.items() if self._is_beside(fit)})
        for name in fits:
            yield from _filled(parts, name)

    def _limit(self, fit: Fit) -> float:
        return max(self.max_shift, self.max_shift_share * fit.size_m)

    def _is_beside(self, fit: Fit) -> bool:
        return fit.largest_m > self._limit(fit) and fit.over_m > 0.5 * fit.largest_m

    def _shifts(self, beside: Mapping[str, Fit]) -> Iterator[Finding]:
        """One finding for all bodies with an equal shift: four legs share a mistake, or a plan."""
        alike: dict[str, list[str]] = {}
        for name, fit in beside.items():
            axis = "xyz"[int(np.argmax(np.abs(fit.shift_m)))]
            shift = f"{_length(fit.largest_m)} along {axis}"
            alike.setdefault(shift, []).append(name)
        for shift, (name, *others) in alike.items():
            fit = beside[name]
            same = f"; the same holds for {', '.join(others)}" if others else ""
            yield SHIFT(
                f"link {name}",
                f"its collision geometry lies {shift} from its visual geometry{same}",
                hint="compare their `<origin>` in the source; look at the report's 3D view",
                data={"shift_m": fit.shift_m, "limit_m": self._limit(fit)},
            )


Shaped = tuple[Shape, TriangleMesh]
"""A shape, and its surface in the frame of its body, m."""


class Parts:
    """The shapes of a robot in the frames of their bodies; each is worked out once."""

    def __init__(self, robot: RobotFiles) -> None:
        self.tree, self.hulls = robot.tree, hulls_by_body(robot)
        meshes = read_meshes(robot.triangles, robot.shapes)
        self._surfaces: dict[tuple[str, Role], list[Shaped]] = {}
        self._first: dict[tuple[object, ...], str] = {}
        for shape in robot.shapes.shapes:
            body, X_body_shape = self.tree.shape_placement(shape)
            geometry = shape.geometry
            mesh = meshes[geometry.mesh] if isinstance(geometry, Mesh) else tessellate(geometry)
            placed = shape, mesh.placed(X_body_shape)
            self._surfaces.setdefault((body, shape.role), []).append(placed)

    def seen(self, body: str) -> list[Shaped]:
        """What is seen of a body."""
        return self._surfaces.get((body, "visual"), [])

    def solid(self, body: str) -> list[Shaped]:
        """What collides."""
        return self._surfaces.get((body, "collision"), [])

    @functools.cache  # noqa: B019 # lives as long as the step
    def outside(self, body: str) -> Distance:
        """Distance from the hull of all that is seen of a body."""
        hulls = self.hulls[body, "visual"]
        try:
            return beyond_hull(common_hull(hulls))
        except StepError:  # flat
            return distance_to(np.concatenate([hull.vertices for hull in hulls]), IDENTITY)

    @functools.cache  # noqa: B019 # as above
    def beyond_itself(self, body: str) -> Array:
        """(n,) how far each vertex of its collision hulls lies outside of what is seen of it, m."""
        return self.outside(body)(self.corners(body))

    def corners(self, body: str) -> Array:
        """(n, 3) vertices of the hulls that collide: a mesh collides as its hull."""
        return np.concatenate([hull.vertices for hull in self.hulls[body, "collision"]])

    @functools.cache  # noqa: B019 # as above
    def holes(self, body: str) -> list[Hole]:
        """Holes that one sees through the body, and what collides as hulls leaves of them."""
        both = zip(self.hulls[body, "collision"], self.solid(body), strict=True)
        solid = [hull if len(hull.faces) else surface for hull, (_, surface) in both]
        return holes(merged([surface for _, surface in self.seen(body)]), merged(solid))

    def alike(self, body: str) -> str:
        """The first body with the same shapes in the same places: one of four legs stands for
        all."""
        shapes = (shape for shape, _ in (*self.seen(body), *self.solid(body)))
        key = tuple((s.role, s.geometry, self.tree.shape_placement(s)[1]) for s in shapes)
        return self._first.setdefault(key, body)


def _length(metres: float) -> str:
    """Three figures in the unit of its size: `27.4 mm`, `2.03 m`, `1350 m`; never an exponent."""
    value, unit = (metres, "m") if metres >= 1.0 else (1e3 * metres, "mm")
    return f"{value:.0f} {unit}" if value >= 100.0 else f"{value:.3g} {unit}"


def _filled(parts: Parts, body: str) -> Iterator[Finding]:
    """The largest hole that one sees through the body, and nothing gets through in a simulator."""
    largest = next((hole for hole in parts.holes(parts.alike(body)) if hole.open < LEFT), None)
    if largest is not None:
        x, y, z = (1e3 * v for v in largest.middle_m)
        u, v, w = largest.direction
        yield HOLE(
            f"link {body}",
            f"collision fills a hole of {1e4 * largest.area_m2:.3g} cm² at ({x:.3g}, {y:.3g}, "
            f"{z:.3g}) mm, seen along ({u:.3g}, {v:.3g}, {w:.3g})",
            hint="if something must pass through, ask for `method: auto` and `keep_open` there",
            data={
                "area_m2": largest.area_m2,
                "middle_m": largest.middle_m,
                "direction": largest.direction,
                "open": largest.open,
            },
        )


def _fit(parts: Parts, body: str) -> Fit:
    visual, collision = (
        np.concatenate([surface.vertices for _, surface in shapes])
        for shapes in (parts.seen(body), parts.solid(body))
    )
    lower = collision.min(axis=0) - visual.min(axis=0)
    upper = collision.max(axis=0) - visual.max(axis=0)
    alike = np.where(lower * upper > 0.0, np.minimum(np.abs(lower), np.abs(upper)), 0.0)
    x, y, z = (float(v) for v in np.sign(lower) * alike)
    size = float(np.linalg.norm(visual.max(axis=0) - visual.min(axis=0)))
    return Fit(_beyond_robot(parts, body), (x, y, z), size)


def _beyond_robot(parts: Parts, body: str) -> float:
    """How far collision sticks out of the visual hulls of its body and of the next ones, m.

    A source may give a motor to one link to be seen and to its neighbour to be hit.
    """
    apart = parts.beyond_itself(parts.alike(body))
    left, apart = parts.corners(body)[apart > 0.0], apart[apart > 0.0]
    for name, X_body_other in _neighbours(parts.tree, body).items():
        if parts.seen(name) and len(left):
            beyond = parts.outside(name)(X_body_other.inverse().apply(left))
            apart = np.minimum(apart, beyond)
            left, apart = left[apart > 0.0], apart[apart > 0.0]
    return float(apart.max(initial=0.0))


def _neighbours(tree: Tree, body: str) -> dict[str, Pose]:
    """X_body_other of the bodies that a joint connects to it, joints at 0."""
    above = tree.joint_above.get(body)
    parent = {} if above is None else {above.parent: above.X_parent_joint.inverse()}
    return parent | {j.child: j.X_parent_joint for j in tree.joints if j.parent == body}
