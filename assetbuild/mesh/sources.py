"""What a collision method is given, as plain data: shapes with poses, places, equal shapes."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from assetbuild.mesh.cover import Probe
from assetbuild.robot.model import Box, Capsule, Cylinder, Primitive, Sphere
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3


class PrimitiveSource(BaseModel):
    """A primitive as plain data, tagged so that equal numbers of another kind differ."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    type: Literal["Box", "Sphere", "Cylinder", "Capsule"]
    size: Vec3 | None = None
    radius: float | None = Field(None, gt=0)
    length: float | None = Field(None, ge=0)

    @model_validator(mode="after")
    def _complete(self) -> PrimitiveSource:
        needed = {"Box": {"size"}, "Sphere": {"radius"}}.get(self.type, {"radius", "length"})
        given = {name for name in ("size", "radius", "length") if getattr(self, name) is not None}
        if given != needed:
            raise ValueError(f"a {self.type} has {sorted(needed)}, not {sorted(given)}")
        return self

    @property
    def geometry(self) -> Primitive:
        """The primitive of the robot model."""
        if self.size is not None:
            return Box(self.size)
        radius, length = self.radius or 0.0, self.length or 0.0
        if self.type == "Sphere":
            return Sphere(radius)
        return Cylinder(radius, length) if self.type == "Cylinder" else Capsule(radius, length)


class PlacedSource(BaseModel):
    """One source shape: a mesh (its input folder) or a primitive, with its pose.

    xyz, quat: of the shape in the output frame, m and wxyz.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    folder: str | None = None
    primitive: PrimitiveSource | None = None
    xyz: Vec3 = (0.0, 0.0, 0.0)
    quat: Quat = (1.0, 0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _one(self) -> PlacedSource:
        if (self.folder is None) == (self.primitive is None):
            raise ValueError("a source is either a mesh folder or a primitive")
        return self

    @classmethod
    def of_mesh(cls, folder: str, pose: Pose | None = None) -> PlacedSource:
        """The converted mesh in the input folder `folder`; no pose = the output frame."""
        at = pose or IDENTITY
        return cls(folder=folder, xyz=at.xyz, quat=at.quat)

    @classmethod
    def of_primitive(cls, geometry: Primitive, pose: Pose | None = None) -> PlacedSource:
        """A primitive of the source; no pose = the output frame."""
        at = pose or IDENTITY
        values = {name: getattr(geometry, name) for name in geometry.__dataclass_fields__}
        plain = PrimitiveSource.model_validate({"type": type(geometry).__name__, **values})
        return cls(primitive=plain, xyz=at.xyz, quat=at.quat)

    @property
    def pose(self) -> Pose:
        """X_frame_shape."""
        return Pose(self.xyz, self.quat)


class ProbeSource(BaseModel):
    """A place that pieces must leave open, or follow closely. start, end: output frame, m."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    start: Vec3
    end: Vec3
    radius: float = Field(0.0, ge=0)
    max_outside: float | None = Field(None, ge=0)
    """m; None: nothing may enter."""

    @property
    def probe(self) -> Probe:
        """As the metrics take it."""
        return Probe(self.start, self.end, self.radius)


class Likeness(BaseModel):
    """Another mesh has the same shape: p = signs * p_other + shift, per axis."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    signs: Vec3
    shift: Vec3
