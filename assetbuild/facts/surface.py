"""What a mesh is, in a few numbers that neither order nor format of its vertices changes, and
what a picture shows, as a digest.

Sums over the corners of all triangles: whatever moves one vertex moves them, however a format
shares, splits or orders vertices.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from assetbuild.facts.table import Value
from assetbuild.robot.pose import Array, Pose


@dataclass(frozen=True)
class Surface:
    """A triangle mesh in some frame.

    triangles: their number. area: m2. volume: m3, signed: the sum of the tetrahedra with the mean
    of all corners, so that an open mesh has the same wherever it lies. mean: (3,) m, mean of all
    corners. moments: xx, yy, zz, xy, xz, yz, m2, of the mean of their outer products. uv: means of
    u, v, uu, vv, uv; empty without texture. normals: means of x, y, z, xx, yy, zz, xy, xz, yz of
    the normals that the file states at its corners; empty where it states none. vertices: places
    in the file.
    """

    triangles: int
    area: float
    volume: float
    mean: tuple[float, ...]
    moments: tuple[float, ...]
    uv: tuple[float, ...] = ()
    normals: tuple[float, ...] = ()
    vertices: int = 0

    def __post_init__(self) -> None:
        lengths = len(self.mean), len(self.moments), len(self.uv), len(self.normals)
        if lengths[:2] != (3, 6) or lengths[2] not in (0, 5) or lengths[3] not in (0, 9):
            raise ValueError(f"a surface has means of {lengths} numbers")

    def moved(self, pose: Pose) -> Surface:
        """The same mesh in the parent of its frame."""
        turn, shift = pose.rotation, np.asarray(pose.xyz)
        mean = turn @ np.asarray(self.mean)
        second = turn @ _matrix(self.moments) @ turn.T
        second = second + np.outer(mean, shift) + np.outer(shift, mean) + np.outer(shift, shift)
        return Surface(
            self.triangles, self.area, self.volume,
            tuple((mean + shift).tolist()), _six(second), self.uv,
            self._turned_normals(turn), self.vertices,
        )  # fmt: skip

    def _turned_normals(self, turn: Array) -> tuple[float, ...]:
        if not self.normals:
            return ()
        second = turn @ _matrix(self.normals[3:]) @ turn.T
        return (*(turn @ np.asarray(self.normals[:3])).tolist(), *_six(second))

    def facts(self) -> dict[str, Value]:
        """By the names of the vocabulary."""
        found: dict[str, Value] = {
            "triangles": float(self.triangles),
            "area": (self.area,),
            "volume": (self.volume,),
            "mean corner": tuple(self.mean),
            "corner moments": tuple(self.moments),
        }
        if self.uv:
            found["texture corners"] = tuple(self.uv)
        return found


def measure(
    corners: ArrayLike,
    uv: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    *,
    by_area: bool = False,
) -> Surface:
    """Measure (n, 3, 3) corners, m, with (n, 3, 2) texture coordinates and (n, 3, 3) normals.

    by_area: each triangle counts by its area in mean and moments, so that it makes no difference
    whether one without area is there.
    """
    points: Array = np.asarray(corners, dtype=np.float64).reshape(-1, 3, 3)
    a, b, c = points[:, 0], points[:, 1], points[:, 2]
    across = cross(b - a, c - a)
    doubled = lengths(across)
    area = float(doubled.sum()) / 2.0
    flat = points.reshape(-1, 3)
    count = max(1, len(flat))
    mean, moments = flat.sum(axis=0) / count, flat.T @ flat / count
    if by_area and area:
        weighed = flat * np.repeat(doubled / (6.0 * area), 3)[:, None]
        mean, moments = weighed.sum(axis=0), weighed.T @ flat
    volume = float(np.einsum("ij,ij->", a - mean, across)) / 6.0
    return Surface(
        len(points), area, volume,
        tuple(mean.tolist()), _six(moments), _uv_means(uv),
        _normal_means(normals),
    )  # fmt: skip


def lengths(vectors: Array) -> Array:
    """(n,) lengths of (n, 3) vectors."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def cross(u: Array, v: Array) -> Array:
    """(n, 3) cross products; numpy's own takes three times as long."""
    (ux, uy, uz), (vx, vy, vz) = u.T, v.T
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)


def _uv_means(uv: ArrayLike | None) -> tuple[float, ...]:
    if uv is None:
        return ()
    flat: Array = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    if not len(flat):
        return ()
    u, v = flat[:, 0], flat[:, 1]
    return tuple(float(np.mean(part)) for part in (u, v, u * u, v * v, u * v))


def _normal_means(normals: ArrayLike | None) -> tuple[float, ...]:
    flat: Array = np.asarray(() if normals is None else normals, dtype=np.float64).reshape(-1, 3)
    if not len(flat):
        return ()
    return (*flat.mean(axis=0).tolist(), *_six(flat.T @ flat / len(flat)))


def _matrix(six: tuple[float, ...]) -> Array:
    """(3, 3) of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _six(m: Array) -> tuple[float, ...]:
    """xx, yy, zz, xy, xz, yz of a symmetric matrix."""
    return tuple(float(m[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


# --- pictures -----------------------------------------------------------------------------------


def pixel_digest(file: Path) -> str:
    """Digest of the size and the RGBA pixels of a picture, whatever its file says besides.

    "" where it is missing or no picture, which the targets report.
    """
    return pixels_of(file.read_bytes()) if file.is_file() else ""


def pixels_of(data: bytes) -> str:
    """The same of the bytes of a picture."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data)) as picture:
            pixels = picture.convert("RGBA")
    except UnidentifiedImageError:
        return ""
    return hashlib.sha256(repr(pixels.size).encode() + pixels.tobytes()).hexdigest()[:16]
