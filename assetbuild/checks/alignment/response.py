"""How each joint follows a sine in both engines, as rows; why not alike, where that is known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from assetbuild.checks.alignment.row import Row
from assetbuild.robot.model import Actuator, Control
from assetbuild.simulators import mujoco, mujoco_motion
from assetbuild.simulators.experiments import Motion, Sine, compare_response, phasor

WARN_AS_IS, BROKEN = 0.05, 0.20
"""Shares of the swing, RMS: with contacts and friction, and where something is wrong."""


@dataclass(frozen=True)
class Responses:
    """MuJoCo's half. servos: drives whose law is outside of the simulator."""

    mjcf: Path
    control: Control
    sine: Sine
    servos: Mapping[str, Actuator]

    def pure(self, theirs: Motion, step: float, warn: float) -> Iterator[Row]:
        """Without contacts, joint friction and damping."""
        ours = self._motion(step, "none")
        for joint in self._swinging():
            yield self._row("sine", joint, ours, theirs, warn)

    def as_is(self, theirs: Motion, step: float) -> Iterator[Row]:
        """With all that the robot has."""
        ours, hard = self._motion(step, "soft"), None
        for joint in self._swinging():
            row = self._row("sine_as_is", joint, ours, theirs, WARN_AS_IS)
            drive = self.control.by_joint.get(joint)
            if drive and drive.friction > 0.0 and row.verdict in ("warning", "error"):
                hard = hard or self._motion(step, "hard")
                row = self._explained(row, joint, hard, theirs)
            yield row

    def _swinging(self) -> list[str]:
        return [joint for joint, swing in self.sine.swing.items() if swing > 0.0]

    def _motion(self, step: float, friction: mujoco_motion.Friction) -> Motion:
        model = mujoco.load(self.mjcf).model
        mujoco_motion.drive_as(model, self.servos)
        every = max(1, round(0.005 / step))
        return mujoco_motion.held_sine(
            model, self.sine, step, contacts=friction != "none", friction=friction, every=every
        )

    def _row(self, name: str, joint: str, ours: Motion, theirs: Motion, warn: float) -> Row:
        response = compare_response(self.sine, joint, ours, theirs)
        # After a touch two motions have nothing more to do with one another: told, not judged.
        limits = (math.inf, math.inf) if ours.touched else (warn, BROKEN)
        return Row(
            name,
            "HIGH",
            f"joint {joint}",
            f"swing {self._swing(joint, ours):.5g}",
            f"swing x {response.gain:.5f}, {response.lag_rad:+.4f} rad later",
            response.rms,
            *limits,
            "of the swing, RMS" + ("; the robot touches itself" if ours.touched else ""),
            lag_rad=None if ours.touched else response.lag_rad,
        )

    def _explained(self, row: Row, joint: str, hard: Motion, theirs: Motion) -> Row:
        """The row with its reason, where MuJoCo agrees with PhysX once its friction is made hard.

        MuJoCo's dry friction is a soft constraint: under a torque tau below its limit a joint of
        inertia M creeps by v = (1 - d) tau / (d b M), d and b of solimp and solref. A hip stands;
        a wrist of 1e-3 kg m2 moves by 1 rad/s for each N m, where PhysX's joint sticks.
        """
        left = compare_response(self.sine, joint, hard, theirs).rms
        if not left <= row.warn:
            return row
        return replace(row, because=f"MuJoCo's dry friction is soft: made hard, {left:.3g} apart")

    def _swing(self, joint: str, motion: Motion) -> float:
        start = len(motion.time) // 3
        omega = 2.0 * math.pi * self.sine.frequency_hz
        return abs(phasor(motion.time[start:], motion.joints[joint][start:], omega))
