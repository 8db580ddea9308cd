"""Small sections of a recipe that the robot model, its steps and its writers take as they stand.

Who made it, its action, time steps, mounts, places, poses, sensors. Links are links of the source,
before merging.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from assetbuild.recipe_types import Length, Model, Name, NonNegative, Pattern, Positive, Real, Turns

Line = Annotated[
    str, Field(min_length=1, max_length=2000, pattern=r"^[^\x00-\x1f]*\S[^\x00-\x1f]*$")
]


class About(Model):
    """Words for the model card and the metadata of the USD; what is not stated is left out."""

    author: Line | None = Field(None, description="who wrote the description: people or a company")
    vendor: Line | None = Field(None, description="who makes the robot itself")
    description: Line | None = Field(None, description="what the robot is, in a sentence")
    tags: tuple[Line, ...] = Field((), max_length=64, description="words to find it by")
    date: Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")] | None = Field(
        None,
        description="the day that the USD states as its own, YYYY-MM-DD; without it the USD says "
        "that none is recorded, because a build on another day must give the same bytes",
    )


class Action(Model):
    """How far one unit of a policy's action moves a joint's target."""

    effort_share: Positive = Field(
        0.25, description="share of the error in position that asks for the whole effort"
    )
    rad: Positive = Field(
        0.5,
        description="rad; most for a joint that turns: an `effort` that is a placeholder would "
        "else ask for whole turns",
    )
    min_rad: NonNegative = Field(
        0.25,
        description="rad; least for a joint that turns, up to `rad`: the share of a stiff drive is "
        "too little to learn to walk with",
    )
    m: Positive = Field(0.05, description="m; most for a joint that slides")

    def scale(self, effort: float | None, kp: float, *, slides: bool) -> float:
        """rad or m of a joint's target for one unit of action. effort: N m or N; kp: per rad or m.

        A quarter of the error that asks for the whole effort is what mjlab's own robots have,
        whose drives are soft.
        """
        least, most = (0.0, self.m) if slides else (self.min_rad, self.rad)
        if effort is None or kp <= 0.0:
            return most
        return min(max(self.effort_share * effort / kp, least), most)


class Simulation(Model):
    """What the generated files and checks step with."""

    timestep: Positive = Field(0.005, le=1, description="length of a step, s")
    decimation: int = Field(4, ge=1, le=10_000, description="simulation steps per control step")
    gravity: tuple[Real, Real, Real] = Field((0.0, 0.0, -9.81), description="m/s2, world frame")


Three = tuple[Real, Real, Real]


class At(Model):
    """Where the root of a part sits."""

    link: str = Field(description="link of the base robot")
    xyz: Three = Field((0.0, 0.0, 0.0), description="of the part's root in that link, m")
    rpy: Turns = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw in that link, rad")


class Mount(Model):
    """What holds the part: a homogeneous box, fixed to the same link."""

    mass: Positive = Field(description="kg")
    size: tuple[Positive, Positive, Positive] = Field(description="edges, m")
    at: Three = Field(
        (0.0, 0.0, 0.0), description="its centre, from the part's root, m; its axes are the part's"
    )


class Region(Model):
    """A place in the frame of the link: a ball, or a capsule from one point to another."""

    from_: Three = Field(alias="from", description="x, y, z in the frame of the link, m")
    to: Three | None = Field(None, description="the other end, m; without it a ball at `from`")
    radius: Length = Field(0.0, description="about the line, `2 mm` or m; 0: the line itself")

    @property
    def ends(self) -> tuple[Three, Three]:
        """Both ends of its axis, m."""
        return self.from_, self.to or self.from_


class ToleranceRegion(Region):
    """A place where collision must follow the mesh more closely."""

    max_outside: Length = Field(description="most that collision may stick out there, `1 mm` or m")


class Keyframe(Model):
    """A named pose."""

    base: Literal["on_ground"] | tuple[Real, Real, Real] = Field(
        "on_ground", description="on_ground: lowest collision point at z = 0; or x, y, z in metres"
    )
    joints: dict[Pattern, Real] = Field(
        default_factory=dict,
        description="rad or m; joints that no pattern matches are 0; without any pattern, as the "
        "keyframe of this name in the source's MJCF says",
    )


ImuKind = Literal["gyro", "accelerometer", "velocimeter", "framequat", "framezaxis", "magnetometer"]
AtLink = Literal[
    "accelerometer", "gyro", "velocimeter", "magnetometer", "force", "torque", "touch",
    "rangefinder", "framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis",
    "framelinvel", "frameangvel", "framelinacc", "frameangacc",
    "subtreecom", "subtreelinvel", "subtreeangmom",
]  # fmt: skip
SensorKind = Literal[
    AtLink,
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
        wanted = "link" if self.kind in get_args(AtLink) else "joint"
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
    rpy: Turns = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw in the link, rad")
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
