"""Ranges that cover two engines, each derived from the motion that it explains."""

from __future__ import annotations

import math

import pytest
from tiny import tiny_quadruped

from assetbuild.alignment.gap import ranges_of, told
from assetbuild.alignment.row import Row
from assetbuild.report.summary import public_message

CONTROL = tiny_quadruped().control


def test_a_block_that_slides_further_has_so_much_less_friction() -> None:
    """Two blocks from rest on the slope, s = g t² (sin a - mu cos a) / 2: the difference is mu."""
    nominal = CONTROL.contact.friction[0]
    angle, g, t = math.atan(0.5 * nominal), 9.81, 2.0
    ways = [g * t**2 / 2 * (math.sin(angle) - mu * math.cos(angle)) for mu in (0.3, 0.25)]
    (low, high) = ranges_of([Row("slide_m", "LOW", "robot", *ways)], CONTROL, 1.0)["friction"]
    assert (nominal - low, high - nominal) == pytest.approx((0.05, 0.05))


def test_a_ball_that_rises_a_quarter_has_half_the_speed() -> None:
    rows = [Row("bounce_m", "LOW", "robot", 0.0, 0.25)]
    assert ranges_of(rows, CONTROL, 1.0)["restitution"] == pytest.approx((0.0, 0.5))


def test_a_joint_that_lags_has_more_damping() -> None:
    """Below its own frequency a joint lags by omega d / kp; twice the damping, twice the lag."""
    drive = CONTROL.by_joint["FR_hip_joint"]
    lag = 2 * math.pi * (drive.kd + drive.damping) / drive.kp
    row = Row("sine_as_is", "HIGH", "joint FR_hip_joint", "", "", lag_rad=lag)
    assert ranges_of([row], CONTROL, 1.0)["damping"] == pytest.approx((1.0, 2.0))


def test_equal_engines_and_missing_experiments_propose_nothing_wide() -> None:
    assert ranges_of([], CONTROL, 1.0) == {}
    nan = [Row("slide_m", "LOW", "robot", math.nan, 0.1), Row("bounce_m", "LOW", "robot", 0.1, "x")]
    assert ranges_of(nan, CONTROL, 1.0) == {}
    same = ranges_of([Row("slide_m", "LOW", "robot", 0.1, 0.1)], CONTROL, 1.0)
    assert same["friction"][0] == same["friction"][1]


def test_the_finding_is_not_for_the_public() -> None:
    (finding,) = told({"friction": (0.7, 0.9)})
    assert finding.rule == "alignment.physx.gap"
    assert "0.7" not in public_message(finding)
