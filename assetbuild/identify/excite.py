"""What to record: commands that stay inside of the limits, touch nothing, and show the parameters.

Each joint follows a slow swing for its friction, sweeps for its inertia and damping, and small
steps, all of them at all times, so that each stretch of the log shows everything. Joints whose
motion brings bodies into contact swing less, until nothing touches.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.identify.estimate import predicted_errors
from assetbuild.identify.fit_logs import drive_of, short
from assetbuild.identify.plant import Plant
from assetbuild.identify.record import Drive, Record
from assetbuild.identify.solve import Unknown, clock_error, make_problem
from assetbuild.robot.codec import decode_file
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Control, Joint, Tree
from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import above, at_key, follow, load, mj

SWING, SWEEP, STEPS = 0.55, 0.3, 0.15
"""Shares of the amplitude."""
SWEEP_S, FASTEST_HZ = 12.0, 5.0
RAMP_S = 2.0
WIDEST = {"prismatic": 0.15, "revolute": 0.6, "continuous": 0.6}
"""Largest amplitude, m or rad."""
ROOM = 0.6
"""Share of the way to the nearer limit that the command may go: weak drives overshoot."""
FASTEST = 0.5
"""Share of the velocity limit that a sweep may ask for."""
NOISE = 4e-4
"""rad or m: of a position that a usual encoder reports."""
CAUTION = 1.5
"""Residuals of a real robot are no white noise: predicted errors are so many times as large."""
LOOKS_HZ = 50.0
TRIES = 40

SMALLER = Rule(
    "identify.excite",
    "info",
    "joints swing less than their limits allow, because bodies would touch",
    "raise the robot further, or look for another initial pose",
)


class Excite(Step):
    """`tree.json`, `control.json`, `prior.json`, `mjcf/` -> `excite.csv`, `expected.json`.

    excite.csv: time and target of each joint, s and rad or m. expected.json: for each parameter the
    half width of the interval that a record of it would leave.
    """

    outputs = ("excite.csv", "expected.json")
    isolated = True
    cpu_bound = True
    preload = ("mujoco",)
    limits: ClassVar[Limits] = Limits(wall_s=3600.0, memory_mb=8192)

    joints: tuple[str, ...]
    fit: tuple[tuple[str, tuple[str, ...]], ...]
    gravity: tuple[float, float, float]
    max_relative_interval: float
    seconds: float = 60.0
    rate_hz: float = 200.0
    file: str
    """Name of the MJCF with the robot's collision geometry, below `mjcf/`."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError where no motion is free of contact."""
        robot = RobotFiles(files.inputs)
        prior = decode_file(Control, files.inputs / "prior.json")
        plant = Plant(robot.tree, prior, self.joints, self.gravity)
        drives = [drive_of(row) for row in prior.actuators]
        start = initial_pose(robot.tree, robot.control)
        ranges = [_range(robot.tree.by_joint[name], dict(start.joints)) for name in self.joints]
        touch = Touch(files.inputs / "mjcf" / self.file, plant)
        scale, record = self._clear(robot.tree, plant, drives, ranges, touch)
        rows = np.column_stack([np.arange(len(record.target)) / self.rate_hz, record.target])
        head = ",".join(["time", *(f"target_{name}" for name in self.joints)])
        formats = ["%.4f", *["%.5f"] * len(self.joints)]
        np.savetxt(files.outputs / "excite.csv", rows, formats, ",", header=head, comments="")
        expected = list(self._expected(plant, drives, record))
        text = json.dumps(expected, indent=1)
        (files.outputs / "expected.json").write_text(text + "\n", encoding="utf-8")
        small = [name for name, s in zip(self.joints, scale, strict=True) if s < 1.0]
        if small:
            yield SMALLER(
                "robot",
                f"{len(small)} joints swing less than their limits allow, so that nothing touches: "
                f"{', '.join(small[:6])}",
                data={"joints": tuple(small)},
            )

    def _clear(
        self,
        tree: Tree,
        plant: Plant,
        drives: Sequence[Drive],
        ranges: Sequence[tuple[float, float]],
        touch: Touch,
    ) -> tuple[Array, Record]:
        """(J,) factors of the amplitudes, and the record of a simulated robot without noise."""
        scale = np.ones(len(self.joints))
        for _ in range(TRIES):
            rows = zip(self.joints, ranges, scale, strict=True)
            commands = [
                self._command(tree.by_joint[name], middle, reach * s, j)
                for j, (name, (middle, reach), s) in enumerate(rows)
            ]
            target = np.stack(commands, axis=1)
            blank = Record(1.0 / self.rate_hz, target, target)
            position = plant.simulate(blank, [drives])[0][0]
            every = max(1, round(self.rate_hz / LOOKS_HZ))
            guilty = touch.guilty(np.concatenate([target[::every], position[::every]]))
            if not guilty:
                return scale, Record(blank.period_s, position, target)
            scale[sorted(guilty)] *= 0.8
        raise StepError(
            f"no motion around the initial pose is free of contact: {touch.last}",
            hint="give the recipe a keyframe `home` in which nothing touches",
        )

    def _command(self, joint: Joint, middle: float, reach: float, number: int) -> Array:
        """(N,) rad or m."""
        t = np.arange(round(self.seconds * self.rate_hz)) / self.rate_hz
        fastest = FASTEST * (joint.limits.velocity or math.inf)
        slow = np.sin(2.0 * np.pi * (0.11 + 0.017 * (number % 7)) * t + 0.7 * number)
        within = (t + 1.3 * number) % SWEEP_S
        hertz = 0.2 + (FASTEST_HZ - 0.2) * within / SWEEP_S
        phase = 2.0 * np.pi * (0.2 * within + (FASTEST_HZ - 0.2) * within**2 / 2.0 / SWEEP_S)
        height = np.minimum(SWEEP * reach, fastest / (2.0 * np.pi * hertz))
        level = np.random.default_rng(number).uniform(-1.0, 1.0, len(t))
        held = level[(t / 0.7 + 0.31 * number).astype(int)]
        moves = SWING * reach * slow + height * np.sin(phase) + STEPS * reach * held
        ramp = np.clip(np.minimum(t, t[-1] - t) / RAMP_S, 0.0, 1.0)
        command: Array = middle + ramp * moves
        return command

    def _expected(
        self, plant: Plant, drives: Sequence[Drive], record: Record
    ) -> Iterator[dict[str, Any]]:  # Any: JSON
        """One row for each parameter."""
        wanted = dict(self.fit)
        unknowns = [
            Unknown(name, (j,), getattr(drives[j], name))
            for j, joint in enumerate(self.joints)
            for name in wanted.get(joint, ())
            if name != "delay"
        ]
        offsets = [Unknown("offset", (j,), 0.0, wanted=False) for j in range(len(drives))]
        delay = [Unknown("delay", tuple(range(len(drives))), 0.0)]
        every = (*unknowns, *delay, *offsets)
        problem = make_problem(plant, [record], drives, every)
        sigma = np.full(problem.measured.shape[1], NOISE)
        errors, correlation = predicted_errors(problem, sigma)
        for i, unknown in enumerate(every):
            if not unknown.wanted:
                continue
            same = np.abs(np.delete(correlation[i], i)).max() > 0.99
            half = CAUTION * 1.96 * float(errors[i]) + clock_error(unknown, drives, False)
            yield {
                "parameter": unknown.name,
                "joint": self.joints[unknown.joints[0]] if len(unknown.joints) == 1 else "all",
                "prior": short(unknown.prior),
                "half_width": short(half),
                "shown_from": short(2.0 * half / self.max_relative_interval),
                "confounded": bool(same),
            }


def _range(joint: Joint, pose: dict[str, float]) -> tuple[float, float]:
    """(middle, reach) of the command, rad or m."""
    most, middle = WIDEST.get(joint.kind, 0.6), pose.get(joint.name, 0.0)
    if joint.range is None:
        return middle, most
    lower, upper = joint.range
    quarter = (upper - lower) / 4.0
    middle = min(max(middle, lower + quarter), upper - quarter)
    return middle, min(most, ROOM * min(middle - lower, upper - middle))


class Touch:
    """Contacts of the robot with itself, and of a fixed one with the floor at its foot."""

    def __init__(self, file: Path, plant: Plant) -> None:
        self.model = load(file, visuals=False).model
        self.data = at_key(self.model)
        self.last = ""
        joints = [self.model.joint(name) for name in plant.joints]
        self._at = [int(joint.qposadr[0]) for joint in joints]
        self._bodies = [int(joint.bodyid[0]) for joint in joints]
        self._always = self._pairs()

    def guilty(self, poses: Array) -> set[int]:
        """Numbers of joints that move one of two bodies that touch and not the other."""
        joints: set[int] = set()
        seen: set[tuple[int, int]] = set()
        for pose in poses:
            self.data.qpos[self._at] = pose
            follow(self.model, self.data)
            mj.mj_kinematics(self.model, self.data)
            mj.mj_collision(self.model, self.data)
            seen |= self._pairs() - self._always
        for a, b in seen:
            movers = self._movers(a) ^ self._movers(b)
            joints |= movers or self._movers(a) | self._movers(b)
            self.last = f"{self.model.body(a).name} and {self.model.body(b).name} touch"
        return joints

    def _pairs(self) -> set[tuple[int, int]]:
        contacts = self.data.contact.geom[: self.data.ncon]
        bodies = np.sort(self.model.geom_bodyid[contacts.reshape(-1, 2)], axis=1)
        return {(int(a), int(b)) for a, b in bodies if a != b}

    def _movers(self, body: int) -> set[int]:
        """Numbers of the joints between a body and the root."""
        below = above(self.model, body)
        return {j for j, child in enumerate(self._bodies) if child in below}
