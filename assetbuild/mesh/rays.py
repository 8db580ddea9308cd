"""Parallel rays through a mesh: what they strike, and holes seen by grids of them.

Everything that asks for rays asks for families of parallel ones, so the triangles are laid out in
the plane across them and a ray is a point there. Plain float64 sums, one at a time: the same bytes
on every CPU, which ray tracers that divide approximately do not give.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from assetbuild.mesh.triangles import Indices, TriangleMesh
from assetbuild.robot.pose import Array

Ends = tuple[Array, Array]
"""(least, greatest) of each triangle."""
LEAST_CELLS, MOST_CELLS = 64, 1024
"""Along each side of the picture that rays are sorted into."""
CELLS = 4
"""For each ray, where there are more triangles: most of them then share a cell with no ray."""
NEAR = 1e-6
"""Share of a cell: a triangle that comes this close is taken to be in it."""
AT_ONCE = 500_000
"""Pairs of a ray and a triangle that are looked at together; about 100 MB."""


@dataclass(frozen=True)
class Struck:
    """What rays strike, sorted by ray, then by depth. One surface may count several times.

    ray: (n,) numbers; depth: (n,) along the direction from its origin's plane, m, where the ray's
    own origin is at 0; front: (n,) whether the ray goes against the triangle's normal.
    """

    ray: Indices
    depth: Array
    front: NDArray[np.bool_]


class Across:
    """The triangles of a mesh as rays along one direction see them."""

    def __init__(self, mesh: TriangleMesh, direction: Array) -> None:
        """Lay the corners out, (m, 3) each: x and y across the rays, z along."""
        self._axes = _axes(np.asarray(direction, dtype=np.float64))
        points = (along(mesh.vertices, axis) for axis in self._axes)
        self._corners = tuple(values[mesh.faces] for values in points)
        self._boxes = _ends(self._corners[0]), _ends(self._corners[1])  # of x, of y
        self._bounds = (
            np.array([least.min(initial=np.inf) for least, _ in self._boxes]),
            np.array([most.max(initial=-np.inf) for _, most in self._boxes]),
        )

    def strike(self, origins: Array) -> Struck:
        """All that rays from origins (n, 3) strike ahead of them and behind, m."""
        x, y, z = (along(origins, axis) for axis in self._axes)
        cells = _Cells(x, y, self._bounds, len(self._corners[0]))
        near = cells.met(*self._boxes)
        seen = _Triangles(*(values[near] for values in self._corners))
        rays, faces = cells.pairs(seen)
        hits = [np.zeros(0, dtype=np.int64)]
        for start in range(0, len(rays), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            hits.append(start + np.flatnonzero(seen.cover(x, y, rays[part], faces[part])))
        hit = np.concatenate(hits)
        rays, faces = rays[hit], faces[hit]
        depth = seen.height(x[rays], y[rays], faces) - z[rays]
        order = np.lexsort((depth, rays))
        return Struck(rays[order], depth[order], (seen.slopes[2][faces] < 0.0)[order])


class _Triangles:
    """Those that rays may strike. x, y, z: (m, 3) of their corners, z along the rays."""

    def __init__(self, x: Array, y: Array, z: Array) -> None:
        self._x, self._y, self._z = x, y, z
        self.across, self.up = _ends(x), _ends(y)

    @cached_property
    def slopes(self) -> tuple[Array, Array, Array]:
        """(dz/dx, dz/dy, the normal's part along the rays) of each triangle; edge-on: 0."""
        x, y, z = self._x, self._y, self._z
        ax, ay, az = (v[:, 1] - v[:, 0] for v in (x, y, z))
        bx, by, bz = (v[:, 2] - v[:, 0] for v in (x, y, z))
        normal = ax * by - ay * bx
        safe = np.where(normal != 0.0, normal, 1.0)
        return -(ay * bz - az * by) / safe, -(az * bx - ax * bz) / safe, normal

    def height(self, x: Array, y: Array, faces: Indices) -> Array:
        """The height of the triangles' planes at points of the picture, along the rays; m."""
        along_x, along_y, _ = self.slopes
        apart_x, apart_y = x - self._x[faces, 0], y - self._y[faces, 0]
        height: Array = self._z[faces, 0] + along_x[faces] * apart_x + along_y[faces] * apart_y
        return height

    @cached_property
    def _edges(self) -> tuple[Array, Array, Array, Array]:
        """(x, y of the lower end, x, y of the upper end), (m, 3) each.

        Two triangles that share an edge have the same numbers for it, so a ray that runs along it
        strikes exactly one of them.
        """
        x, y = self._x, self._y
        next_x, next_y = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
        up = (y < next_y) | ((y == next_y) & (x < next_x))
        low, high = (x, next_x), (y, next_y)
        return (
            np.where(up, *low),
            np.where(up, *high),
            np.where(up, *low[::-1]),
            np.where(up, *high[::-1]),
        )

    def cover(self, x: Array, y: Array, rays: Indices, faces: Indices) -> NDArray[np.bool_]:
        """Which triangles lie over their point: an odd number of edges to the right of it."""
        low_x, low_y, high_x, high_y = (values[faces] for values in self._edges)
        at_x, at_y = x[rays, None], y[rays, None]
        beside = (low_y <= at_y) & (at_y < high_y)
        right = (at_x - low_x) * (high_y - low_y) < (at_y - low_y) * (high_x - low_x)
        odd: NDArray[np.bool_] = np.logical_xor.reduce(beside & right, axis=1)
        return odd

    def span(self, faces: Indices, lower: Array, height: float) -> Ends:
        """(least, greatest) x of triangles within the rows of cells from `lower` up."""
        least, greatest = np.full(len(faces), np.inf), np.full(len(faces), -np.inf)
        lower, upper = lower - NEAR * height, lower + (1.0 + NEAR) * height
        for edge in range(3):
            low_x, low_y, high_x, high_y = (values[faces, edge] for values in self._edges)
            tall = high_y - low_y
            slope = (high_x - low_x) / np.where(tall > 0.0, tall, 1.0)
            meets = (low_y <= upper) & (high_y >= lower)
            for end in (np.maximum(low_y, lower), np.minimum(high_y, upper)):
                at = np.where(tall > 0.0, low_x + (end - low_y) * slope, low_x)
                least = np.where(meets, np.minimum(least, at), least)
                greatest = np.where(meets, np.maximum(greatest, at), greatest)
            flat = meets & ~(tall > 0.0)
            greatest = np.where(flat, np.maximum(greatest, high_x), greatest)
        return least, greatest


class _Cells:
    """Rays, sorted into the cells of a picture.

    x, y: (n,); bounds: lower and upper corner of the picture of so many triangles.
    """

    def __init__(self, x: Array, y: Array, bounds: tuple[Array, Array], triangles: int) -> None:
        self._lower, upper = bounds
        inside = (x >= self._lower[0]) & (x <= upper[0]) & (y >= self._lower[1]) & (y <= upper[1])
        self._rays = np.flatnonzero(inside)
        wanted = min(CELLS * len(self._rays), triangles)
        self._side = int(np.clip(wanted**0.5, LEAST_CELLS, MOST_CELLS))
        self._size = np.maximum(upper - self._lower, 1e-300) / self._side
        cells = self._cell(y[self._rays], 1) * self._side + self._cell(x[self._rays], 0)
        self._rays = self._rays[np.argsort(cells, kind="stable")]
        self._x = x[self._rays]
        self._counts = np.bincount(cells, minlength=self._side**2)

    def _cell(self, values: Array, axis: int) -> Indices:
        """Column (axis 0) of each x, or row (axis 1) of each y."""
        place = (values - self._lower[axis]) / self._size[axis]
        cells: Indices = np.clip(place, 0, self._side - 1).astype(np.int64)
        return cells

    def met(self, across: Ends, up: Ends) -> Indices:
        """Numbers of the triangles whose box shares a cell with a ray: no other can be struck."""
        table = np.zeros((self._side + 1, self._side + 1), dtype=np.int64)
        counts = self._counts.reshape(self._side, self._side)
        table[1:, 1:] = counts.cumsum(axis=0).cumsum(axis=1)
        flat, width = table.ravel(), self._side + 1
        near = NEAR * self._size[0]
        left, right = self._cell(across[0] - near, 0), self._cell(across[1] + near, 0)
        below, above = self._cell(up[0], 1) * width, (self._cell(up[1], 1) + 1) * width
        rays = flat[above + right + 1] - flat[above + left]
        rays -= flat[below + right + 1] - flat[below + left]
        return np.flatnonzero(rays)

    def pairs(self, triangles: _Triangles) -> tuple[Indices, Indices]:
        """(rays, triangles) that share a cell, by the numbers of both."""
        first = self._cell(triangles.up[0], 1)
        rows = self._cell(triangles.up[1], 1) - first + 1
        faces = np.repeat(np.arange(len(rows)), rows)
        row = np.repeat(first, rows) + _within(rows)
        left, right = (values[faces] for values in triangles.across)
        wide = np.flatnonzero(right - left > 2.0 * self._size[0])
        bottom = self._lower[1] + row[wide] * self._size[1]
        left[wide], right[wide] = triangles.span(faces[wide], bottom, self._size[1])
        near = NEAR * self._size[0]
        left, right = left - near, right + near
        starts = np.concatenate([[0], np.cumsum(self._counts)])
        start = starts[row * self._side + self._cell(left, 0)]
        counts = starts[row * self._side + self._cell(right, 0) + 1] - start
        entry = np.repeat(np.arange(len(row)), counts)
        ray = start[entry] + _within(counts)
        kept = np.flatnonzero((left[entry] <= self._x[ray]) & (self._x[ray] <= right[entry]))
        return self._rays[ray[kept]], faces[entry[kept]]


def _ends(values: Array) -> Ends:
    """(least, greatest) of each row of (m, 3) values; much faster than along an axis of three."""
    a, b, c = values.T
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def along(points: Array, axis: Array) -> Array:
    """(n,) coordinates of points (n, 3) on an axis; equal points get equal ones."""
    coordinates: Array = points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2]
    return coordinates


def _axes(direction: Array) -> tuple[Array, Array, Array]:
    """(u, v, direction), unit vectors at right angles."""
    forward = direction / np.sqrt((direction * direction).sum())
    across = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
    across /= np.sqrt((across * across).sum())
    return across, np.cross(forward, across), forward


def _within(counts: Indices) -> Indices:
    """0, 1, ... for each count in turn."""
    indices: Indices = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    return indices


def missed(origins: Array, view: Across) -> NDArray[np.bool_]:
    """(n,) which rays from origins (n, 3) strike no triangle ahead of them."""
    free = np.ones(len(origins), dtype=bool)
    struck = view.strike(origins)
    free[struck.ray[struck.depth >= 0.0]] = False
    return free


GRID = 64
"""Rays along each edge of a square that holds the mesh, for six directions."""
LEAST = 8
"""Rays: less is a slit between parts. A round hole of a twentieth of the size has as many."""


def widest_hole(mesh: TriangleMesh) -> float:
    """Area in m2 of the widest way through, with mesh all around it; 0 = there is none.

    Seen along the axes and the principal axes of the vertices. A notch is none: it is open on one
    side.
    """
    reach = 1.05 * mesh.diagonal
    lower, upper = mesh.bounds
    middle = (lower + upper) / 2.0
    spread = mesh.vertices - mesh.vertices.mean(axis=0)
    principal = np.linalg.eigh(spread.T @ spread)[1].T
    across = (np.arange(GRID) + 0.5) / GRID * reach - reach / 2.0
    u, v = (side.ravel()[:, None] for side in np.meshgrid(across, across, indexing="ij"))
    most = 0
    for direction in np.concatenate([np.eye(3), principal]):
        first, second, forward = _axes(direction)
        origins = middle - reach * forward + u * first + v * second
        most = max(most, _enclosed(missed(origins, Across(mesh, direction))))
    return float(most * (reach / GRID) ** 2)


def _enclosed(through: NDArray[np.bool_]) -> int:
    """Rays of the largest patch that does not reach the edge of the picture; 0 = a slit at most."""
    from scipy.ndimage import label

    patches, _ = label(through.reshape(GRID, GRID))
    sizes = np.bincount(patches.ravel())
    sizes[0] = 0  # no patch: rays that strike something
    sizes[patches[[0, -1]]] = sizes[patches[:, [0, -1]]] = 0
    return int(sizes.max()) if sizes.max() >= LEAST else 0
