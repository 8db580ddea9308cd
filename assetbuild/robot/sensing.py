"""Sensors, cameras and feet of a recipe. Links are links of the source, before merging."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field, model_validator

from assetbuild.quantities import Model, Name, NonNegative, Pattern, Positive, Real

ImuKind = Literal["gyro", "accelerometer", "velocimeter", "framequat", "framezaxis", "magnetometer"]
AT_LINK = (
    "accelerometer", "gyro", "velocimeter", "magnetometer", "force", "torque", "touch",
    "rangefinder", "framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis",
    "framelinvel", "frameangvel", "framelinacc", "frameangacc",
    "subtreecom", "subtreelinvel", "subtreeangmom",
)  # fmt: skip
SensorKind = Literal[
    "accelerometer", "gyro", "velocimeter", "magnetometer", "force", "torque", "touch",
    "rangefinder", "framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis",
    "framelinvel", "frameangvel", "framelinacc", "frameangacc",
    "subtreecom", "subtreelinvel", "subtreeangmom",
    "jointpos", "jointvel", "jointlimitpos", "jointlimitvel", "jointlimitfrc",
    "jointactuatorfrc", "actuatorpos", "actuatorvel", "actuatorfrc",
]  # fmt: skip


IMU_NAMES: Mapping[ImuKind, str] = {
    "gyro": "imu_ang_vel",
    "accelerometer": "imu_lin_acc",
    "velocimeter": "imu_lin_vel",
    "framequat": "imu_quat",
    "framezaxis": "imu_upvector",
    "magnetometer": "imu_magnetic_field",
}
"""What the sensors of an IMU are called; mjlab's and Menagerie's names."""


class Imu(Model):
    """An inertial measurement unit: sensors at the frame of a link."""

    link: str = Field(description="its frame is the sensor's frame")
    sensors: tuple[ImuKind, ...] = Field(
        ("gyro", "accelerometer", "velocimeter", "framequat"),
        description="velocimeter and framequat are what a simulator knows and an IMU does not",
    )


class Feet(Model):
    """What the robot stands on."""

    links: Pattern = Field(description="links whose collision shapes are the soles")
    contact_sensors: bool = Field(True, description="one per sole, in the MJCF")


class Sensor(Model):
    """One sensor, in MJCF's word, at a link, joint or actuated joint."""

    kind: SensorKind = Field(description="MJCF's word")
    link: str | None = Field(None, description="where it sits, or whose subtree it sums")
    joint: str | None = Field(None, description="of joint and actuator sensors")
    relative_to: str | None = Field(None, description="link in whose frame; without it the world")
    cutoff: NonNegative = Field(0.0, description="clipped beyond, in the sensor's unit; 0 = never")
    noise: NonNegative = Field(0.0, description="standard deviation to add, in the sensor's unit")

    @model_validator(mode="after")
    def _place(self) -> Sensor:
        wanted = "link" if self.kind in AT_LINK else "joint"
        other = "joint" if wanted == "link" else "link"
        if getattr(self, wanted) is None or getattr(self, other) is not None:
            raise ValueError(f"a {self.kind} sits at a `{wanted}`")
        if self.relative_to is not None and not self.kind.startswith("frame"):
            raise ValueError(f"a {self.kind} takes no `relative_to`")
        return self


class Camera(Model):
    """A camera at a link: it looks along -z of its frame, +y is up."""

    link: str | None = Field(None, description="without it it stands in the world")
    xyz: tuple[Real, Real, Real] = Field((0.0, 0.0, 0.0), description="in the link, m")
    rpy: tuple[Real, Real, Real] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw in the link, rad"
    )
    optical: bool = Field(
        False, description="the frame is an optical one: it looks along +z, +y is down"
    )
    fovy: Positive = Field(0.785398, lt=3.14, description="vertical field of view, rad")
    resolution: tuple[int, int] = Field((640, 480), description="width, height in pixels")
    tracking: Literal["fixed", "trackcom"] = Field(
        "fixed", description="trackcom: keeps its angle and follows the robot's centre of mass"
    )

    @model_validator(mode="after")
    def _size(self) -> Camera:
        if not all(1 <= side <= 16384 for side in self.resolution):
            raise ValueError("`resolution`: 1 to 16384 pixels")
        return self


Sensors = dict[Name, Sensor]
Cameras = dict[Name, Camera]
