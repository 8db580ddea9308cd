"""Does what collides lie where the robot is seen? Visual against collision geometry, per body.

Collision methods measure what they make; this measures what will be simulated, whatever it came
from: a kept shape that moved by 3 cm is nobody's result.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.mesh.holes import holes
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.quality import surface_samples
from assetbuild.mesh.register import Move, Target
from assetbuild.mesh.solid import Distance, distance_to
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.quantities import Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import IDENTITY, Array, Pose
from assetbuild.robot.shapes import Mesh, Primitive, Shape, Shapes

MOST_POINTS = 4000
"""Of a body's visual vertices, evenly spread over their list: enough for a percentile."""
SURFACE_POINTS, SHAPE_POINTS = 15_000, 300
"""Samples of a body's visual surface, and of one collision shape."""
BETTER = 0.7
"""A shape is beside its place when its distance from the visual surface would be less than this
share of what it is. Simplified shapes are as far from it wherever they go."""
LEFT = 0.1
"""A hole of which less than this is left is filled."""

SHIFT = Rule(
    "coverage.shift",
    "warning",
    "collision geometry is beside the visual geometry of its body",
    "compare their origins",
)
SHAPE_SHIFT = Rule(
    "coverage.shape_shift",
    "warning",
    "a collision shape would fit the visual geometry much better beside its place",
    "compare its origin with that of the visual geometry; a shape that stands there on purpose "
    "needs a line in `rules`",
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
    """bare: 95 % of the visual vertices stick out of the collision less than this; over: how far
    collision sticks out of the visual hulls of its body and of the next ones; shift: both ends
    moved alike, by axis. m.
    """

    bare_m: float
    over_m: float
    shift_m: tuple[float, float, float]
    size_m: float


class Coverage(Check):
    """Findings `coverage.*`; figures: a row for each body with both kinds of geometry."""

    isolated = True
    preload = ("numpy", "scipy.spatial", "fast_simplification")
    reads = ("tree.json", "shapes.json", "meshes/")

    section = "validate"

    max_shift: Positive = Field(
        0.015, description="m: collision geometry beside the visual geometry of its body, warning"
    )
    max_shift_share: Positive = Field(
        0.08, description="the same as a share of the body's size; the larger of the two counts"
    )

    max_shape_shift: Positive = Field(
        0.02,
        description="m: a single collision shape beside the visual geometry that it stands for, "
        "warning",
    )

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads tree, shapes and meshes."""
        robot = RobotFiles(files.inputs)
        tree, shapes = robot.tree, robot.shapes
        meshes = {
            asset.name: read_triangles((robot.mesh_dir / asset.file).read_bytes())
            for asset in shapes.meshes
        }
        seen = {b.name: _points(tree, shapes, meshes, b.name, "visual") for b in tree.bodies}
        visual = {name: points for name, points in seen.items() if points is not None}
        hulls = {name: distance_to(points, IDENTITY) for name, points in visual.items()}
        fits = {}
        for body in visual:
            collision = _points(tree, shapes, meshes, body, "collision")
            if collision is not None:
                solids = _solids(tree, shapes, meshes, body)
                beyond = _beyond_robot(tree, hulls, body, collision)
                fits[body] = _fit(visual[body], collision, solids, beyond)
        rows = [
            {"body": name, "not_covered_mm": 1e3 * f.bare_m, "sticks_out_mm": 1e3 * f.over_m,
             "shift_mm": [1e3 * v for v in f.shift_m]}
            for name, f in fits.items()
        ]  # fmt: skip
        moves = _moves(tree, shapes, meshes, fits)
        moved = [
            {"shape": name, "shift_mm": [round(1e3 * v, 1) for v in m.shift_m],
             "distance_mm": round(1e3 * m.before_m, 1),
             "distance_after_mm": round(1e3 * m.after_m, 1)}
            for name, (_, m) in moves.items()
        ]  # fmt: skip
        write_figures(files, {"bodies": rows, "shapes": moved})
        beside = set()
        for name, fit in fits.items():
            largest = max(map(abs, fit.shift_m))
            limit = max(self.max_shift, self.max_shift_share * fit.size_m)
            if largest > limit and fit.over_m > 0.5 * largest:
                beside.add(name)
                axis = "xyz"[int(np.argmax(np.abs(fit.shift_m)))]
                yield SHIFT(
                    f"link {name}",
                    f"its collision geometry lies {_length(largest)} along {axis} from its "
                    "visual geometry",
                    hint="compare their `<origin>` in the source; look at the report's 3D view",
                    data={"shift_m": fit.shift_m, "limit_m": limit},
                )
        for name, (body, move) in moves.items():
            if body not in beside:
                yield from self._judge_shape(name, body, move)
        for name in fits:
            yield from _filled(tree, shapes, meshes, name)

    def _judge_shape(self, name: str, body: str, move: Move) -> Iterator[Finding]:
        if move.length_m > self.max_shape_shift and move.after_m < BETTER * move.before_m:
            towards = ", ".join(f"{1e3 * v:.3g}" for v in move.shift_m)
            yield SHAPE_SHIFT(
                f"shape {name}",
                f"moved by ({towards}) mm in `{body}`, which is {_length(move.length_m)} and above "
                f"the limit of {_length(self.max_shape_shift)}, it would fit the visual geometry: "
                f"{_length(move.after_m)} away on average instead of {_length(move.before_m)}",
                hint="compare its `<origin>` with the visual one; if it stands there on purpose, "
                "say so in `rules`",
                data={"shift_m": move.shift_m, "limit_m": self.max_shape_shift},
            )


def _moves(
    tree: Tree, shapes: Shapes, meshes: Mapping[str, TriangleMesh], bodies: Collection[str]
) -> dict[str, tuple[str, Move]]:
    """Body of each collision shape, and the move that would lay it on the visual geometry.

    That of its body and of the next ones: see `_beyond_robot`.
    """
    seen = {
        body.name: surface_samples(merged(found), SURFACE_POINTS, 0)[0]
        for body in tree.bodies
        if (found := _surfaces(tree, shapes, meshes, body.name, "visual"))
    }
    moves = {}
    for body in bodies:
        around = _neighbours(tree, body).items()
        target = Target(np.concatenate([X.apply(seen[n]) for n, X in around if n in seen]))
        for shape, X_body_shape in _shapes_of(tree, shapes, body, "collision"):
            surface = _surface(shape, meshes).placed(X_body_shape)
            points = surface_samples(surface, SHAPE_POINTS, 0)[0]
            moves[shape.name] = (body, target.fit(points))
    return moves


def _length(metres: float) -> str:
    """Three figures in the unit of its size: `27.4 mm`, `2.03 m`, `1350 m`; never an exponent."""
    value, unit = (metres, "m") if metres >= 1.0 else (1e3 * metres, "mm")
    return f"{value:.0f} {unit}" if value >= 100.0 else f"{value:.3g} {unit}"


def _filled(
    tree: Tree, shapes: Shapes, meshes: Mapping[str, TriangleMesh], body: str
) -> Iterator[Finding]:
    """Holes that one sees through the body, and that nothing gets through in a simulator.

    A mesh collides as its hull there, whatever its own form.
    """
    seen = _surfaces(tree, shapes, meshes, body, "visual")
    solid = [_hull(surface) for surface in _surfaces(tree, shapes, meshes, body, "collision")]
    filled = [hole for hole in holes(merged(seen), merged(solid)) if hole.open < LEFT]
    if filled:
        largest = filled[0]
        x, y, z = (1e3 * v for v in largest.middle_m)
        u, v, w = largest.direction
        yield HOLE(
            f"link {body}",
            f"collision fills a hole of {1e4 * largest.area_m2:.3g} cm² at ({x:.3g}, {y:.3g}, "
            f"{z:.3g}) mm, seen along ({u:.3g}, {v:.3g}, {w:.3g})",
            hint="where something must pass: more pieces (`method: auto`), and `keep_open` there",
            data={
                "area_m2": largest.area_m2,
                "middle_m": largest.middle_m,
                "direction": largest.direction,
                "open": largest.open,
            },
        )


def _hull(surface: TriangleMesh) -> TriangleMesh:
    """What collides; a flat surface, which has no hull, as it is."""
    try:
        return convex_hull(surface.vertices)
    except StepError:
        return surface


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
    apart = [
        hulls[name](X_body_other.inverse().apply(collision))
        for name, X_body_other in _neighbours(tree, body).items()
        if name in hulls
    ]
    return max(float(np.min(apart, axis=0).max()), 0.0)


def _neighbours(tree: Tree, body: str) -> dict[str, Pose]:
    """X_body_other of the body itself and of those that a joint connects to it, joints at 0."""
    above = tree.joint_above.get(body)
    poses = {body: IDENTITY}
    if above is not None:
        poses[above.parent] = above.X_parent_joint.inverse()
    return poses | {j.child: j.X_parent_joint for j in tree.joints if j.parent == body}


def _solids(
    tree: Tree, shapes: Shapes, meshes: Mapping[str, TriangleMesh], body: str
) -> list[Distance]:
    return [
        distance_to(_solid(shape, meshes), X_body_shape)
        for shape, X_body_shape in _shapes_of(tree, shapes, body, "collision")
    ]


def _solid(shape: Shape, meshes: Mapping[str, TriangleMesh]) -> Primitive | Array:
    if isinstance(shape.geometry, Mesh):
        return meshes[shape.geometry.mesh].vertices
    return shape.geometry


def _points(
    tree: Tree, shapes: Shapes, meshes: Mapping[str, TriangleMesh], body: str, role: str
) -> Array | None:
    """(n, 3) of a body's shapes of one role, in its frame, m."""
    found = [surface.vertices for surface in _surfaces(tree, shapes, meshes, body, role)]
    return np.concatenate(found) if found else None


def _surfaces(
    tree: Tree, shapes: Shapes, meshes: Mapping[str, TriangleMesh], body: str, role: str
) -> list[TriangleMesh]:
    """A body's shapes of one role as triangles, in its frame, m."""
    return [
        _surface(shape, meshes).placed(X_body_shape)
        for shape, X_body_shape in _shapes_of(tree, shapes, body, role)
    ]


def _surface(shape: Shape, meshes: Mapping[str, TriangleMesh]) -> TriangleMesh:
    """In the shape's own frame, m."""
    if isinstance(shape.geometry, Mesh):
        return meshes[shape.geometry.mesh]
    return tessellate(shape.geometry)


def _shapes_of(tree: Tree, shapes: Shapes, body: str, role: str) -> Iterator[tuple[Shape, Pose]]:
    """A body's shapes of one role, each with X_body_shape."""
    for shape in shapes.shapes:
        owner, X_body_shape = tree.shape_placement(shape)
        if owner == body and shape.role == role:
            yield shape, X_body_shape
