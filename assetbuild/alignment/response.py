"""How each joint follows a sine in both engines, as rows; why not alike, where that is known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from assetbuild.alignment.row import SLOWER, SOFT, Row
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.simulators import mujoco_motion
from assetbuild.simulators.experiments import Motion, Sine, Swing, compare_response, phasor

FRICTION, COUPLING = "dry friction", "coupling of joints"
EXPLAINED = 0.5
"""Share of a difference that must be gone before a reason counts as one."""


@dataclass(frozen=True)
class Responses:
    """MuJoCo's half. servos: drives whose law is outside of the simulator."""

    mjcf: Path
    tree: Tree
    control: Control
    sine: Sine
    wish: Swing
    servos: Mapping[str, Actuator]

    def pure(self, theirs: Motion, step: float) -> Iterator[Row]:
        """Without contacts, joint friction, damping, and limits of effort and speed."""
        leaders = {j.mimic.joint: COUPLING for j in self.tree.joints if j.mimic}
        yield from self._rows("sine", theirs, step, self.wish.tolerance, leaders)

    def as_is(self, theirs: Motion, step: float) -> Iterator[Row]:
        """With all that the robot has."""
        leaders = {j.mimic.joint: COUPLING for j in self.tree.joints if j.mimic}
        rubbing = {a.joint: FRICTION for a in self.control.actuators if a.friction > 0.0}
        yield from self._rows(
            "sine_as_is", theirs, step, self.wish.tolerance_as_is, leaders | rubbing
        )

    def _rows(
        self, name: str, theirs: Motion, step: float, warn: float, soft: Mapping[str, str]
    ) -> Iterator[Row]:
        """soft: what of MuJoCo's may be why a joint's row is off, by joint."""
        is_pure = name == "sine"
        ours, hard = self._motion(step, is_pure), None
        hasty = "" if is_pure else self._hasty(ours)
        for joint, swing in self.sine.swing.items():
            if swing <= 0.0:
                continue
            row = self._row(name, joint, ours, theirs, warn)
            if joint in soft and row.verdict in ("warning", "error"):
                hard = hard or self._motion(step, is_pure, hard=True)
                row = self._explained(row, joint, soft[joint], hard, theirs)
            if hasty and not row.because and row.verdict in ("warning", "error"):
                row = replace(row, because=hasty, advice=SLOWER)
            yield row

    def _hasty(self, ours: Motion) -> str:
        """The joint that is most above its limit of speed in MuJoCo, which has none; or "".

        Thrown about by what carries it, a wrist passes it whatever its own drive is asked, and
        what hangs on it and what carries it move otherwise too.
        """
        worst, said = 1.0, ""
        for joint, angle in ours.joints.items():
            drive = self.control.by_joint.get(joint)
            if drive is None or not drive.velocity:
                continue
            fastest = float(np.abs(np.gradient(angle, ours.time)).max())
            if fastest > worst * drive.velocity:
                worst = fastest / drive.velocity
                said = (
                    f"MuJoCo has no limit of speed: `{joint}` moves at {fastest:.3g}, its limit is "
                    f"{drive.velocity:.3g} rad/s or m/s"
                )
        return said

    def _motion(self, step: float, is_pure: bool, hard: bool = False) -> Motion:
        model = mujoco_motion.held_model(self.mjcf)
        mujoco_motion.drive_as(model, self.servos)
        return mujoco_motion.held_sine(
            model,
            self.sine,
            step,
            contacts=not is_pure,
            rubbing=not is_pure,
            limited=not is_pure,
            hard=hard,
            every=max(1, round(0.005 / step)),
        )

    def _row(self, name: str, joint: str, ours: Motion, theirs: Motion, warn: float) -> Row:
        response = compare_response(self.sine, joint, ours, theirs)
        # After a touch two motions have nothing more to do with one another: told, not judged.
        limits = (math.inf, math.inf) if ours.touched else (warn, self.wish.broken)
        return Row(
            name,
            "HIGH",
            f"joint {joint}",
            f"swing {self._swing(joint, ours):.5g}",
            f"swing x {response.gain:.5f}, {response.lag_rad:+.4f} rad later",
            response.rms,
            *limits,
            f"of the swing, RMS{self._unfair(ours)}",
            lag_rad=None if ours.touched or joint in self.sine.speeds else response.lag_rad,
        )

    def _unfair(self, ours: Motion) -> str:
        """What lets two motions part that began alike, for the reader."""
        if ours.touched:
            return "; the robot touches itself"
        loose = [
            joint.name
            for joint in self.tree.moving_joints
            if joint.mimic is None and self.sine.swing[joint.name] == 0.0
        ]
        count = f"{len(loose)} joints without a drive of positions or speeds"
        return f"; {count} swing freely, where small differences grow" if loose else ""

    def _explained(self, row: Row, joint: str, what: str, hard: Motion, theirs: Motion) -> Row:
        """The row with its reason, where MuJoCo agrees with PhysX once its constraints are hard:
        within the warning, or twice as well and no error.

        MuJoCo's dry friction and its coupling of joints are soft constraints: under a torque tau
        below the limit of friction a joint of inertia M creeps by v = (1 - d) tau / (d b M), d and
        b of solimp and solref. A hip stands; a wrist of 1e-3 kg m2 moves by 1 rad/s for each N m,
        where PhysX's joint sticks. A coupled finger gives way by a like amount.
        """
        left = compare_response(self.sine, joint, hard, theirs).rms
        enough = max(row.warn, min(row.error, EXPLAINED * (row.off or 0.0)))
        if not left <= enough:
            return row
        because = f"MuJoCo's {what} is soft: made hard, {left:.3g} apart"
        return replace(row, because=because, advice=SOFT)

    def _swing(self, joint: str, motion: Motion) -> float:
        start = len(motion.time) // 3
        omega = 2.0 * math.pi * self.sine.frequency_hz
        return abs(phasor(motion.time[start:], motion.joints[joint][start:], omega))
