"""What a mesh is, in a few numbers that neither order nor format of its vertices changes, and
what a picture shows, as a digest.

Sums over the corners of all triangles: whatever moves one vertex moves them, however a format
shares, splits or orders vertices.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from assetbuild.facts.table import Value
from assetbuild.robot.inertia import matrix_of, tensor_of
from assetbuild.robot.pose import Array, Pose, cross


@dataclass(frozen=True)
class Surface:
    """A triangle mesh in some frame.

    triangles: their number. area: m2. volume: m3, signed: the sum of the tetrahedra with the mean
    of all corners, so that an open mesh has the same wherever it lies. mean: (3,) m, mean of all
    corners. moments: xx, yy, zz, xy, xz, yz, m2, of the mean of their outer products. uv: means of
    u, v, uu, vv, uv; empty without texture.
    """

    triangles: int
    area: float
    volume: float
    mean: tuple[float, ...]
    moments: tuple[float, ...]
    uv: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        lengths = len(self.mean), len(self.moments), len(self.uv)
        if lengths not in ((3, 6, 0), (3, 6, 5)):
            raise ValueError(f"a surface has means of {lengths} numbers")

    def moved(self, pose: Pose) -> Surface:
        """The same mesh in the parent of its frame."""
        turn, shift = pose.rotation, np.asarray(pose.xyz)
        mean = turn @ np.asarray(self.mean)
        second = turn @ matrix_of(np.array(self.moments)) @ turn.T
        second = second + np.outer(mean, shift) + np.outer(shift, mean) + np.outer(shift, shift)
        return replace(self, mean=tuple((mean + shift).tolist()), moments=tensor_of(second))

    def facts(self) -> dict[str, Value]:
        """Its facts, by the names of the vocabulary."""
        facts: dict[str, Value] = {
            "triangles": float(self.triangles),
            "area": (self.area,),
            "volume": (self.volume,),
            "mean corner": tuple(self.mean),
            "corner moments": tuple(self.moments),
        }
        if self.uv:
            facts["texture corners"] = tuple(self.uv)
        return facts


def measure(corners: ArrayLike, uv: ArrayLike | None = None, *, by_area: bool = False) -> Surface:
    """Measure (n, 3, 3) corners, m, with (n, 3, 2) texture coordinates.

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
    middle = tuple(mean.tolist())
    return Surface(len(points), area, volume, middle, tensor_of(moments), _uv_means(uv))


def lengths(vectors: Array) -> Array:
    """(n,) lengths of (n, 3) vectors."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def _uv_means(uv: ArrayLike | None) -> tuple[float, ...]:
    if uv is None:
        return ()
    flat: Array = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    if not len(flat):
        return ()
    u, v = flat[:, 0], flat[:, 1]
    return tuple(float(np.mean(part)) for part in (u, v, u * u, v * v, u * v))


# --- pictures -----------------------------------------------------------------------------------


def pixel_digest(file: Path) -> str:
    """Digest of the size and the RGBA pixels of a picture, whatever its file says besides.

    "" where it is missing or no picture, which the targets report.
    """
    return pixels_of(file.read_bytes()) if file.is_file() else ""


def pixels_of(data: bytes) -> str:
    """The digest of the size and the RGBA pixels in the bytes of a picture; "" of no picture."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data)) as picture:
            pixels = picture.convert("RGBA")
    except UnidentifiedImageError:
        return ""
    return hashlib.sha256(repr(pixels.size).encode() + pixels.tobytes()).hexdigest()[:16]
