"""`identify`: what a recipe says about logs of the real robot, and what a fit to them found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, model_validator

from assetbuild.recipe_types import Model, NonNegative, Pattern, Positive, Real

ParameterName = Literal["armature", "damping", "friction", "kp", "kd", "delay", "effort"]
ByJoint = NonNegative | dict[Pattern, NonNegative]
"""One number for all joints, or one for each pattern of joints."""


class LogFile(Model):
    """One recording."""

    file: str = Field(
        min_length=1,
        max_length=500,
        description="CSV, Parquet, MCAP or ROS bag, relative to the recipe",
    )
    interval: tuple[Real, Real] | None = Field(
        None, description="the part to use, s on the log's own clock; without it all"
    )

    episode: Annotated[int, Field(ge=0)] | None = Field(
        None, description="the episode to use, of a Parquet file that holds several, as LeRobot's"
    )

    @model_validator(mode="after")
    def _rising(self) -> LogFile:
        if self.interval is not None and not self.interval[0] < self.interval[1]:
            raise ValueError("`interval`: the first time must be before the second")
        return self


class Columns(Model):
    """Names of the log's columns; `{joint}` stands for the name of the joint in the log."""

    time: str = Field("time", description="column of the time")
    position: str = Field("position_{joint}", description="measured position")
    target: str = Field("target_{joint}", description="commanded position")
    velocity: str | None = Field(
        None, description="measured velocity; used to check the position column"
    )
    torque: str | None = Field(
        None, description="measured torque, or the current if `torque_constant` is given"
    )
    base_orientation: str | None = Field(
        None,
        description="orientation of the root in the world, where `base` is measured: four columns "
        "of a unit quaternion, `{axis}` stands for w, x, y and z",
    )
    base_position: str | None = Field(
        None,
        description="position of the root in the world, m: three columns, `{axis}` stands for x, y "
        "and z; without it the root only turns",
    )


class Recorded(Model):
    """Gains of the position controller while the log was recorded."""

    kp: ByJoint = Field(description="N m/rad or N/m; one number, or one for each pattern of joints")
    kd: ByJoint = Field(0.0, description="N m s/rad or N s/m; likewise")


class Identify(Model):
    """Parameters of some joints, fitted to one or more logs."""

    joints: Pattern = Field(".*", description="the joints that the logs hold")
    logs: tuple[LogFile, ...] = Field(
        min_length=1, max_length=64, description="recordings with the same columns and gains"
    )
    columns: Columns = Columns()
    names: dict[str, str] = Field(
        default_factory=dict,
        description="joint -> its name or number in the log, where that differs",
    )
    time_unit: Literal["s", "ms", "us", "ns"] = Field("s", description="unit of the time column")
    angle_unit: Literal["rad", "deg"] | Annotated[int, Field(ge=4)] = Field(
        "rad",
        description="unit of angles in the log: rad, deg, or the encoder ticks of one turn; "
        "positions of joints that slide are in m",
    )
    torque_constant: ByJoint | None = Field(
        None, description="N m/A or N/A after the gear, if the torque column is a current"
    )
    recorded: Recorded | None = Field(
        None, description="gains while recording; without it those of the actuator table"
    )
    fit: tuple[ParameterName, ...] | dict[Pattern, tuple[ParameterName, ...]] = Field(
        ("armature", "damping", "friction", "delay"),
        description="parameters to fit, of all the joints or for each pattern of joints",
    )
    shared: tuple[Pattern, ...] = Field(
        (), max_length=64, description="joints that share their values, such as left and right"
    )
    hold_out: Annotated[float, Field(ge=0.0, le=0.5)] = Field(
        0.2, description="share at the end of each log that is predicted, not fitted"
    )
    base: Literal["fixed", "measured"] = Field(
        "fixed",
        description="fixed: the root stood still while recording, on a stand; measured: it moved, "
        "and columns of the log say how",
    )
    gravity: tuple[Real, Real, Real] = Field(
        (0.0, 0.0, -9.81), description="while recording, in the axes of the root, m/s2"
    )
    max_relative_interval: Positive = Field(
        0.1,
        description="a parameter with a 95 % interval wider than this share of its value is "
        "refused and keeps its prior",
    )
    values: Literal["physical", "effective"] = Field(
        "physical",
        description="physical: what the model lacks (a payload, friction that grows with the load) "
        "widens all intervals; effective: it does not, and the numbers are those with which this "
        "model follows the logs best",
    )
    simulator_step: Positive | None = Field(
        None,
        description="s; the timestep of the simulator that made the logs, if no real robot did: "
        "its error of integration is then part of the fit",
    )
    apply: bool = Field(True, description="false: fit and report, but build with the priors")

    @model_validator(mode="after")
    def _base_has_columns(self) -> Identify:
        columns = self.columns
        if self.base == "measured" and columns.base_orientation is None:
            raise ValueError("`base: measured` needs `base_orientation` in `columns`")
        if self.base == "fixed" and (columns.base_orientation or columns.base_position):
            raise ValueError("columns of the base are for `base: measured`")
        if columns.base_position and not columns.base_orientation:
            raise ValueError("`base_position` needs `base_orientation`")
        return self


UNITS = {
    "armature": ("kg m²", "kg"),
    "damping": ("N m s/rad", "N s/m"),
    "friction": ("N m", "N"),
    "kp": ("N m/rad", "N/m"),
    "kd": ("N m s/rad", "N s/m"),
    "delay": ("s", "s"),
    "effort": ("N m", "N"),
}
"""Unit of a parameter for joints that turn, and for joints that slide."""


@dataclass(frozen=True)
class LogUsed:
    """A log, by its name in the recipe. seconds: that were fitted; held_s: that were predicted."""

    file: str
    sha256: str
    seconds: float
    held_s: float
    rate_hz: float


@dataclass(frozen=True)
class Parameter:
    """One parameter of one or more joints that share it.

    low, high: 95 % interval. prior: None = none.
    refused: why the data do not show it; "" = identified.
    """

    name: str
    joints: tuple[str, ...]
    value: float
    low: float
    high: float
    prior: float | None = None
    refused: str = ""
    unit: str = ""

    @property
    def label(self) -> str:
        """`friction of FR_hip_joint`."""
        more = f" and {len(self.joints) - 1} that share it" if len(self.joints) > 1 else ""
        return f"{self.name} of {self.joints[0]}{more}"


@dataclass(frozen=True)
class Prediction:
    """RMS of measured minus simulated position of a joint, rad or m.

    fitted: where it was fitted; before, after: on the held-out part, with priors and with the fit.
    """

    joint: str
    fitted: float
    before: float
    after: float


@dataclass(frozen=True)
class Related:
    """Two parameters with correlated estimates."""

    a: str
    b: str
    correlation: float


@dataclass(frozen=True)
class Fit:
    """One entry of `identify`. condition: of the scaled Fisher information."""

    logs: tuple[LogUsed, ...]
    parameters: tuple[Parameter, ...]
    predictions: tuple[Prediction, ...]
    related: tuple[Related, ...] = ()
    condition: float = 1.0
    recorded: tuple[tuple[str, float, float], ...] = ()
    """(joint, kp, kd) of the controller while recording."""
