"""What a fit found: parameters with their intervals, and how well it predicts."""

from __future__ import annotations

from dataclasses import dataclass

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
    """One parameter of one or more tied joints. low, high: 95 % interval; prior: None = none.

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
        more = f" and {len(self.joints) - 1} tied" if len(self.joints) > 1 else ""
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


@dataclass(frozen=True)
class Curve:
    """Measured and simulated position of a joint on part of a log, thinned out for a picture."""

    joint: str
    time_s: tuple[float, ...]
    measured: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    held_from_s: float


@dataclass(frozen=True)
class Curves:
    """Pictures of one fit."""

    curves: tuple[Curve, ...]
