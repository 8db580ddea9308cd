"""The box, sphere, capsule or cylinder that stands best for a mesh.

Each kind is fitted twice: the smallest that encloses all vertices, found over candidate axes,
and from there by bounded least squares to the surface. A two-sided score over the volumes
chooses: what sticks out counts once, what is missing twice.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from assetbuild.mesh.cover import POINTS, Reference
from assetbuild.mesh.cut import tips
from assetbuild.mesh.hull import capped, convex_hull
from assetbuild.mesh.primitives import Fitted, refined, resized, volume_of
from assetbuild.mesh.quality import sobol, surface_samples
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.pose import Array, Pose, quat_between, quat_of, vec3
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Primitive, Sphere

KINDS: tuple[type[Primitive], ...] = (Sphere, Capsule, Box, Cylinder)
"""From simple to costly in contact: of two equally good fits the earlier one is taken."""
AS_GOOD = 0.01
"""Scores closer than this, the sampling error, are equal."""
SAMPLES = 1000
SEARCHED = 64
"""Hull vertices of the search over axes; the chosen axis is fitted to all of them."""
FACETS = 20
FIBONACCI = 24


def best_primitive(reference: Reference, kinds: Sequence[type[Primitive]] = KINDS) -> Fitted:
    """(primitive, X_frame_primitive) with the lowest over + 2 under of the asked kinds."""
    score = _score(reference)
    samples, _ = surface_samples(reference.mesh, SAMPLES, 0)
    smallest = enclosing_each(reference, kinds)
    fits = (fit for each in smallest for fit in (each, _least_squares(each, samples)))
    return tidy(first_best(fits, score))


def box_axes(reference: Reference) -> tuple[Array, float]:
    """((3, 3) a rotation, its columns the axes of the smallest box about the mesh, that box's
    volume / volume of the box along x, y and z)."""
    box, pose = next(enclosing_each(reference, [Box]))
    along_xyz = float(np.prod(np.ptp(reference.hull.vertices, axis=0)))
    return pose.rotation, volume_of(box) / along_xyz


def enclosing_each(
    reference: Reference,
    kinds: Sequence[type[Primitive]],
    *,
    rough: bool = False,
) -> Iterator[Fitted]:
    """The smallest of each kind about the mesh.

    rough: for a start only, about SEARCHED vertices and along the very directions.
    """
    points = reference.hull.vertices
    search = capped(convex_hull(tips(points)), SEARCHED)
    axes = _candidate_axes(reference.mesh, search)
    for kind in kinds:
        held = search.vertices if rough else points
        yield _enclosing(kind, held, search.vertices, axes, refined=not rough)


def first_best(fits: Iterable[Fitted], score: Callable[[Fitted], float]) -> Fitted:
    """The fit with the lowest score; of those within AS_GOOD of one another the first."""
    best, least = None, math.inf
    for fitted in fits:
        value = score(fitted)
        if value < least - AS_GOOD:
            best, least = fitted, value
    if best is None:
        raise ValueError("no kinds of primitives to choose from")
    return best


def _score(reference: Reference) -> Callable[[Fitted], float]:
    """over + 2 under of a primitive against a mesh, on one cloud of points; 0 is perfect."""
    inside, volume = reference.inside
    if not len(inside):  # thinner than the points are apart
        lower, upper = reference.room
        inside, volume = sobol(POINTS, lower, upper), float(np.prod(upper - lower))

    def score(fitted: Fitted) -> float:
        covered = float((ConvexPiece(*fitted).distance(inside) <= 0.0).mean())
        over = volume_of(fitted[0]) / volume - covered
        return over + 2.0 * (1.0 - covered)

    return score


def _candidate_axes(mesh: TriangleMesh, hull: TriangleMesh) -> Array:
    """(k, 3) unit directions along which a body may lie.

    Normals of the largest hull facets, frame axes, principal axes of the surface, and directions
    spread evenly over a half sphere (Fibonacci lattice).
    """
    a, b, c = np.moveaxis(hull.corners, 1, 0)
    order = np.argsort(-hull.areas, kind="stable")[:FACETS]
    facets = np.cross(b - a, c - a)[order]
    weights = mesh.areas
    middle = mesh.corners.mean(axis=1)
    spread = middle - weights @ middle / weights.sum()
    principal = np.linalg.eigh((spread * weights[:, None]).T @ spread)[1].T
    k = np.arange(FIBONACCI) + 0.5
    z = k / FIBONACCI
    turn = k * math.pi * (3.0 - math.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    even = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    axes = np.concatenate([np.eye(3), principal, facets, even])
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True), dtype=np.float64)


def _smallest_ball(points: Array, steps: int = 400) -> tuple[Array, float]:
    """Centre and radius of nearly the smallest ball (any dimension) about the points.

    Badoiu and Clarkson (2003): the centre walks to the farthest point by 1 / (i + 1). It starts
    from the middle of the bounds, which is exact for bodies with mirror symmetry.
    """
    centre = best = (points.min(axis=0) + points.max(axis=0)) / 2.0
    least = math.inf
    for i in range(1, steps):
        away = points - centre
        squared = np.einsum("ij,ij->i", away, away)
        farthest = int(np.argmax(squared))
        if squared[farthest] < least * (1.0 - 2e-9):
            best, least = centre, float(squared[farthest])
        centre = centre + (points[farthest] - centre) / (i + 1)
    return best, math.sqrt(least)


def _frame_of(axis: Array) -> Array:
    """(3, 3) rotation whose z column is the axis."""
    return Pose(quat=quat_between((0.0, 0.0, 1.0), axis)).rotation


def _round_along(
    kind: type[Cylinder] | type[Capsule], axis: Array, points: Array, steps: int
) -> Fitted:
    """The shortest of the smallest radius about the axis; a capsule's caps reach over its ends."""
    rotation = _frame_of(axis)
    local = points @ rotation
    centre, radius = _smallest_ball(local[:, :2], steps)
    off = np.linalg.norm(local[:, :2] - centre, axis=1)
    cap = np.sqrt(np.maximum(radius * radius - off * off, 0.0)) if kind is Capsule else 0.0
    high, low = float((local[:, 2] - cap).max()), float((local[:, 2] + cap).min())
    if high < low:
        high = low = (high + low) / 2.0
    middle = rotation @ np.array([*centre, (low + high) / 2.0])
    return kind(radius, high - low), Pose(vec3(middle), quat_of(rotation))


def _box_along(axis: Array, points: Array, steps: int) -> Fitted:
    """The smallest box with one edge along the axis: one side lies on an edge of the shadow."""
    from scipy.spatial import ConvexHull

    rotation = _frame_of(axis)
    local = points @ rotation
    shadow = local[:, :2][ConvexHull(local[:, :2]).vertices]
    edges = np.roll(shadow, -1, axis=0) - shadow
    angles = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (math.pi / 2.0), 12))
    cos, sin = np.cos(angles), np.sin(angles)
    u = np.outer(shadow[:, 0], cos) + np.outer(shadow[:, 1], sin)
    v = np.outer(shadow[:, 1], cos) - np.outer(shadow[:, 0], sin)
    best = int(np.argmin(np.ptp(u, axis=0) * np.ptp(v, axis=0)))
    turn = np.array([[cos[best], -sin[best], 0], [sin[best], cos[best], 0], [0, 0, 1]])
    turned = rotation @ turn
    local = points @ turned
    low, high = local.min(axis=0), local.max(axis=0)
    return Box(vec3(high - low)), Pose(vec3(turned @ ((low + high) / 2.0)), quat_of(turned))


_ALONG: Mapping[type[Primitive], Callable[[Array, Array, int], Fitted]] = {
    Box: _box_along,
    Cylinder: functools.partial(_round_along, Cylinder),
    Capsule: functools.partial(_round_along, Capsule),
}


def _enclosing(
    kind: type[Primitive], points: Array, search: Array, axes: Array, *, refined: bool
) -> Fitted:
    """The smallest body of a kind about points (n, 3), over axes (k, 3).

    search: some of the points, to compare axes by; refined: the three best axes may tilt.
    """
    if kind is Sphere:
        centre, radius = _smallest_ball(points)
        return Sphere(radius), Pose(vec3(centre))
    along = _ALONG[kind]
    volumes = [volume_of(along(axis, search, 60)[0]) for axis in axes]
    order = np.argsort(volumes, kind="stable")[:3]
    tilts = refined and kind is not Box
    tilted = [_tilted(along, axes[i], search) for i in order] if tilts else []
    # The untilted axes stay in the race: an exact one must not lose to rounding.
    fits = [along(axis, points, 400) for axis in (*axes[order], *tilted)]
    return min(fits, key=lambda fitted: round(volume_of(fitted[0]), 15))


def _tilted(along: Callable[[Array, Array, int], Fitted], axis: Array, search: Array) -> Array:
    from scipy.optimize import minimize

    frame = _frame_of(axis)

    def direction(tilt: Array) -> Array:
        turned = np.array([tilt[0], tilt[1], 1.0])
        return np.asarray(frame @ np.asarray(turned / np.linalg.norm(turned)))

    def volume(tilt: Array) -> float:
        return volume_of(along(direction(tilt), search, 60)[0])

    simplex = np.array([[0.0, 0.0], [0.05, 0.0], [0.0, 0.05]])
    result = minimize(
        volume,
        np.zeros(2),
        method="Nelder-Mead",
        options={"maxiter": 40, "initial_simplex": simplex},
    )
    return direction(result.x)


def _least_squares(start: Fitted, samples: Array) -> Fitted:
    """The fit that is nearest to the surface samples, from `start` and never far from it.

    Minimises mean |d| + RMS(d) / 2 over the signed distances d, by L-BFGS-B within BOUNDS
    (unbounded, a box once ran away).
    """
    scale = float(np.linalg.norm(np.ptp(samples, axis=0)))

    def cost(distance: Array) -> tuple[float, Array]:
        rms = math.sqrt(float((distance**2).mean()))
        by_distance = (np.sign(distance) + 0.5 * distance / max(rms, 1e-12)) / len(distance)
        return float(np.abs(distance).mean()) + 0.5 * rms, by_distance

    return refined([start], samples, scale, cost, 100, scale)[0]


def tidy(fitted: Fitted) -> Fitted:
    """Micrometres, and of the equal descriptions the one whose axes are nearest to the frame's."""
    primitive, pose = fitted
    rotation = pose.rotation
    if isinstance(primitive, Box):
        rotation, order = _nearest_axes(rotation)
        size = np.asarray(primitive.size)[order]
        primitive = Box(vec3(np.round(size, 6)))
    elif isinstance(primitive, Sphere):
        rotation = np.eye(3)
        primitive = Sphere(round(primitive.radius, 6))
    else:
        axis = rotation[:, 2]
        # Pointing up; a level one along +x, else +y.
        lead = axis[2] if abs(axis[2]) > 1e-6 else axis[0] if abs(axis[0]) > 1e-6 else axis[1]
        rotation = _frame_of(axis if lead > 0.0 else -axis)
        primitive = resized(type(primitive), np.round([primitive.radius, primitive.length], 6))
    quat = quat_of(rotation)
    snapped = (1.0, 0.0, 0.0, 0.0) if max(map(abs, quat[1:])) < 1e-6 else quat
    return primitive, Pose(vec3(np.round(pose.xyz, 6)), snapped)


def _nearest_axes(rotation: Array) -> tuple[Array, list[int]]:
    """Columns permuted and signed so that each lies near its axis; and their former places."""
    order: list[int] = []
    for row in range(3):
        free = [k for k in range(3) if k not in order]
        order.append(max(free, key=lambda k: round(abs(float(rotation[row, k])), 9)))
    turned = rotation[:, order]
    turned = turned * np.where(np.diagonal(turned) < 0.0, -1.0, 1.0)
    if np.linalg.det(turned) < 0.0:
        weakest = int(np.argmin(np.abs(np.diagonal(turned))))
        turned[:, weakest] *= -1.0
    return turned, order
