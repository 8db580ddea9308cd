"""What a collision method is given, as plain data: shapes with poses, places, equal shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assetbuild.mesh.primitives import BY_NAME, resized, sizes_of
from assetbuild.robot.pose import IDENTITY, Array, Pose, Vec3
from assetbuild.robot.shapes import Primitive

SEGMENT = 25
"""Points along the axis of a probe."""


@dataclass(frozen=True)
class PlacedSource:
    """One source shape: a mesh (its input folder) or a primitive, with its pose.

    kind: the class of a primitive by name, so that equal sizes of another kind differ; sizes: its
    own, as `sizes_of` lists them, m. pose: of the shape in the output frame.
    """

    folder: str | None = None
    kind: str | None = None
    sizes: tuple[float, ...] = ()
    pose: Pose = IDENTITY

    def __post_init__(self) -> None:
        if (self.folder is None) == (self.kind is None):
            raise ValueError("a source is either a mesh folder or a primitive")

    @classmethod
    def of_primitive(cls, geometry: Primitive, pose: Pose = IDENTITY) -> PlacedSource:
        """A primitive of the source."""
        return cls(kind=type(geometry).__name__, sizes=sizes_of(geometry), pose=pose)

    @property
    def primitive(self) -> Primitive | None:
        """The primitive of the robot model, if it is one."""
        return None if self.kind is None else resized(BY_NAME[self.kind], self.sizes)


@dataclass(frozen=True)
class Probe:
    """A capsule, or a ball when both ends are one, in the frame of the mesh: a place. m.

    max_outside: how far pieces may stick out of the mesh there; None: none may enter.
    """

    start: Vec3
    end: Vec3
    radius: float = 0.0
    max_outside: float | None = None

    def distance(self, points: Array) -> Array:
        """(n,) signed distances of points (n, 3) to the probe, m."""
        start, along = np.asarray(self.start), np.subtract(self.end, self.start)
        length = float(along @ along)
        share = np.clip((points - start) @ along / length, 0.0, 1.0) if length else np.zeros(1)
        nearest = start + np.multiply.outer(share, along)
        return np.asarray(np.linalg.norm(points - nearest, axis=1) - self.radius)

    def axis(self) -> Array:
        """(SEGMENT, 3) points from end to end."""
        return np.linspace(self.start, self.end, SEGMENT)


@dataclass(frozen=True)
class Likeness:
    """Another mesh has the same shape: p = signs * p_other + shift, per axis."""

    signs: Vec3
    shift: Vec3
