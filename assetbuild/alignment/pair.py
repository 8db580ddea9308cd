"""The two models of one robot: what both engines are asked, and the rows that come of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from assetbuild.alignment.gap import Ranges, ranges_of
from assetbuild.alignment.response import Responses
from assetbuild.alignment.row import Row
from assetbuild.alignment.rows import scene_rows
from assetbuild.alignment.stops import ENDS, FINER, End, explained, into_stop, stop_rows
from assetbuild.engine.step import Files
from assetbuild.quantities import Model, Positive
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Keyframe, Tree
from assetbuild.robot.pose import Pose
from assetbuild.simulators import loop_swing, mujoco, mujoco_motion, physx
from assetbuild.simulators.experiments import Fall, Motion, Sine, Swing, sine_of

EXTERNAL = frozenset({"ideal_pd", "dc_motor", "motor", "general"})
"""Their law runs outside of the simulator; the sine gives both engines the same servo instead."""
FINE_DT = 0.001
FALLEN_RAD = math.radians(20.0)
STAND_S, DROP_S, DROP_M, SLOPE = 2.0, 1.2, 1.0, 0.5
LANDING_S = math.sqrt(2.0 * DROP_M / 9.81)
"""0.452 s from 1 m under the gravity of the earth; scaled to the recipe's below."""


class FloorLimits(Model):
    """Where two engines may part on a floor: a warning, and an error."""

    stand_height: tuple[Positive, Positive] = Field(
        (0.005, 0.01), description="m, between the roots after standing"
    )
    landing: tuple[Positive, Positive] = Field(
        (0.03, 0.1), description="share of the time that a fall from 1 m takes, of either engine"
    )


@dataclass(frozen=True)
class Engine:
    """The engine beside MuJoCo. iterations: how often it applies gravity in a step.

    held: the rows of what both hold, of MuJoCo's model, what the other engine holds, and the tree.
    """

    name: str
    iterations: int
    held: Callable[[Any, Any, Tree], Iterator[Row]]


@dataclass
class Pair:
    """The two models of one robot, and what is asked of both."""

    files: Files
    robot: str
    tree: Tree
    control: Control
    wish: Swing | None
    engine: Engine
    fall: Fall
    floor: FloorLimits

    @property
    def start(self) -> Keyframe:
        """The pose that stands."""
        return initial_pose(self.tree, self.control)

    @property
    def stands(self) -> bool:
        """Standing, landing and sliding need a floating base and a keyframe above a floor."""
        return self.tree.base == "floating" and bool(self.start.name)

    def sine(self) -> Sine | None:
        """The sine of both engines; None when no joint can follow one."""
        if self.wish is None:
            return None
        start = dict(self.start.joints)
        made = sine_of(self.tree, self.control, start, self.wish.frequency, self.wish.seconds)
        made = loop_swing.about_closed(self.tree, self.control, made, start)
        return made if any(made.swing.values()) else None

    @property
    def servos(self) -> dict[str, Actuator]:
        """Drives whose law is outside of the simulator."""
        return {a.joint: a for a in self.control.actuators if a.model in EXTERNAL and a.kp > 0.0}

    def experiments(self) -> list[physx.Experiment]:
        """What the other engine does."""
        gravity, dt = self.control.simulation.gravity, self.control.simulation.timestep
        plain = physx.Setting(dt, gravity)
        made = [physx.Experiment("load", plain)]
        if self.tree.base == "floating":
            steps = round(0.4 / dt)
            made.append(
                physx.Experiment(
                    "fall", physx.Setting(dt, gravity, contacts=False), steps=steps, every=steps
                )
            )
        if (sine := self.sine()) is not None:
            made += self._sines(sine)
        made += self._into_stops()
        if self.stands:
            made += self._on_floor()
        return made

    @property
    def stops(self) -> dict[End, Sine]:
        """The ways into the limits; none where no sine is asked for."""
        home = dict(self.start.joints)
        asked = (
            {}
            if self.wish is None
            else {end: into_stop(self.tree, self.control, home, end) for end in ENDS}
        )
        return {end: sine for end, sine in asked.items() if sine is not None}

    @property
    def _stop_steps(self) -> tuple[float, float]:
        """Seconds: the robot's own timestep, and one in which integrators agree."""
        own = self.control.simulation.timestep
        return own, own / FINER

    def _into_stops(self) -> list[physx.Experiment]:
        gravity = self.control.simulation.gravity
        base: Literal["asset", "held"] = "held" if self.tree.base == "floating" else "asset"
        return [
            physx.Experiment(
                f"into_{end}_{dt}",
                physx.Setting(dt, gravity, base, contacts=False, drives=self.servos),
                round(sine.seconds / dt),
                start=sine.middle,
                sine=sine,
            )
            for end, sine in self.stops.items()
            for dt in self._stop_steps
        ]

    def _stopped(self, outcomes: Mapping[str, physx.Outcome]) -> Iterator[Row]:
        own, fine = self._stop_steps
        for end in self.stops:
            rows = list(self._stop_rows(outcomes, end, own))
            if any(row.verdict in ("warning", "error") for row in rows):
                rows = explained(rows, list(self._stop_rows(outcomes, end, fine)), fine)
            yield from rows

    def _stop_rows(
        self, outcomes: Mapping[str, physx.Outcome], end: End, dt: float
    ) -> Iterator[Row]:
        sine, done = self.stops[end], outcomes[f"into_{end}_{dt}"]
        if done.finite and done.motion is not None:
            model = mujoco_motion.held_model(self.files.inputs / "mjcf" / f"{self.robot}.xml")
            mujoco_motion.drive_as(model, self.servos)
            model.actuator_ctrllimited[:] = 0  # it would clip what asks for more
            ours = mujoco_motion.held_sine(model, sine, dt, contacts=False, rubbing=True)
            yield from stop_rows(self.tree, sine, end, ours, done.motion)

    def _sines(self, sine: Sine) -> list[physx.Experiment]:
        gravity, dt = self.control.simulation.gravity, self.control.simulation.timestep
        base: Literal["asset", "held"] = "held" if self.tree.base == "floating" else "asset"
        pure = physx.Setting(
            FINE_DT,
            gravity,
            base,
            contacts=False,
            rubbing=False,
            limited=False,
            drives=self.servos,
        )
        as_is = physx.Setting(dt, gravity, base, drives=self.servos)
        return [
            physx.Experiment(
                name,
                setting,
                steps=round(sine.seconds / setting.timestep),
                every=max(1, round(0.005 / setting.timestep)),
                start=sine.middle,
                sine=sine,
            )
            for name, setting in (("sine", pure), ("sine_as_is", as_is))
        ]

    def _on_floor(self) -> list[physx.Experiment]:
        gravity, dt = self.control.simulation.gravity, self.control.simulation.timestep
        base, friction = physx.clear_of_floor(self.start.base), self.control.contact.friction[0]
        raised = Pose((base.xyz[0], base.xyz[1], base.xyz[2] + DROP_M), base.quat)
        start = dict(self.start.joints)
        return [
            physx.Experiment(
                name,
                physx.Setting(dt, pull, at=at, floor_friction=friction, drives=self.servos),
                steps=round(seconds / dt),
                every=every,
                start=start,
            )
            for name, pull, at, seconds, every in (
                ("stand", gravity, base, STAND_S, 20),
                ("drop", gravity, raised, DROP_S, 1),
                ("slope", self._tilted(), base, STAND_S, 20),
            )
        ]

    def _tilted(self) -> tuple[float, float, float]:
        """Gravity as on a slope on which half of the friction holds the robot."""
        x, y, z = self.control.simulation.gravity
        angle = math.atan(SLOPE * self.control.contact.friction[0])
        return x + abs(z) * math.sin(angle), y, z * math.cos(angle)

    def ranges(self, rows: Sequence[Row]) -> Ranges:
        """What to randomize, so that a policy has met both engines."""
        sine = self.sine()
        return ranges_of(
            rows,
            self.control,
            slope=SLOPE,
            seconds=STAND_S,
            fall_m=DROP_M,
            sine_hz=sine.frequency_hz if sine else 1.0,
        )

    # --- rows ---------------------------------------------------------------------------

    def rows(self, outcomes: Mapping[str, physx.Outcome]) -> Iterator[Row]:
        """CRITICAL first."""
        held = outcomes["load"].held
        model = self._model(f"{self.robot}.xml")
        made = [*scene_rows(self.files.inputs, self.robot, self._model("scene.xml"))]
        if held is not None:
            made += self.engine.held(model, held, self.tree)
        made += self._falls(outcomes)
        made += self._responses(outcomes)
        made += self._stopped(outcomes)
        if self.stands:
            made += self._on_floor_rows(outcomes)
        ranks = ("CRITICAL", "HIGH", "MEDIUM", "LOW")
        order = {"error": 0, "warning": 1, "ok": 2, "told": 3}
        yield from sorted(made, key=lambda r: (ranks.index(r.rank), order[r.verdict]))

    def _model(self, name: str) -> Any:  # Any: mujoco.MjModel
        return mujoco.load(self.files.inputs / "mjcf" / name).model

    def _falls(self, outcomes: Mapping[str, physx.Outcome]) -> Iterator[Row]:
        if "fall" not in outcomes or not outcomes["fall"].finite:
            return
        dt, gravity = self.control.simulation.timestep, self.control.simulation.gravity
        ours = mujoco.free_fall(self._model(f"{self.robot}.xml"), 0.4)
        setting = physx.Setting(dt, gravity, contacts=False)
        theirs = physx.free_fall_of(outcomes["fall"], setting, self.engine.iterations)
        off = max(ours.relative_error, theirs.relative_error)
        yield Row(
            "free_fall",
            "HIGH",
            "robot",
            f"{ours.drop_m:.6g} m of {ours.expected_m:.6g}",
            f"{theirs.drop_m:.6g} m of {theirs.expected_m:.6g}",
            off,
            self.fall.tolerance,
            self.fall.broken,
            "of the drop",
        )

    def _responses(self, outcomes: Mapping[str, physx.Outcome]) -> Iterator[Row]:
        sine = self.sine()
        if sine is None or self.wish is None:
            return
        dt = self.control.simulation.timestep
        mjcf = self.files.inputs / "mjcf" / f"{self.robot}.xml"
        sines = Responses(mjcf, self.tree, self.control, sine, self.wish, self.servos)
        pure, as_is = outcomes["sine"], outcomes["sine_as_is"]
        if pure.finite and pure.motion is not None:
            yield from sines.pure(pure.motion, FINE_DT)
        if as_is.finite and as_is.motion is not None:
            yield from sines.as_is(as_is.motion, dt)

    def _on_floor_rows(self, outcomes: Mapping[str, physx.Outcome]) -> Iterator[Row]:
        dt = self.control.simulation.timestep
        ours: dict[str, Motion] = {}
        for name, seconds, raised in (
            ("stand", STAND_S, 0.0),
            ("drop", DROP_S, DROP_M),
            ("slope", STAND_S, 0.0),
        ):
            model = self._model("scene.xml")
            mujoco_motion.drive_as(model, self.servos)
            if name == "slope":
                model.opt.gravity[:] = self._tilted()
            ours[name] = mujoco_motion.keyframe_motion(
                model, self.start.name, round(seconds / dt), raised_m=raised, servos=self.servos
            )
        theirs = {name: outcomes[name].motion for name in ours if outcomes[name].finite}
        if (other := theirs.get("stand")) is not None:
            yield stand_row(ours["stand"], other, self.floor.stand_height)
        if (other := theirs.get("drop")) is not None:
            yield from self._landing(ours["drop"], other)
        if (other := theirs.get("slope")) is not None:
            moved = [
                float(np.linalg.norm(m.root[-1, :2] - m.root[0, :2]))
                for m in (ours["slope"], other)
            ]
            yield Row("slide_m", "LOW", "robot", moved[0], moved[1])

    def _landing(self, ours: Motion, theirs: Motion) -> Iterator[Row]:
        down = abs(self.control.simulation.gravity[2])
        if down == 0.0:
            return
        ideal = LANDING_S * math.sqrt(9.81 / down)
        times = [_landing_time(motion) for motion in (ours, theirs)]
        off = max(abs(time - ideal) / ideal for time in times)
        yield Row(
            "landing_s",
            "MEDIUM",
            "robot",
            times[0],
            times[1],
            off,
            *self.floor.landing,
            "of the time",
        )
        heights = [
            _bounce(motion, time) for motion, time in zip((ours, theirs), times, strict=True)
        ]
        yield Row("bounce_m", "LOW", "robot", heights[0], heights[1])


def stand_row(ours: Motion, theirs: Motion, allowed: tuple[float, float]) -> Row:
    """Where the root stands at the end; two falls have nothing to do with one another."""
    one, two = float(ours.root[-1, 2]), float(theirs.root[-1, 2])
    _, x, y, _ = ours.turn[-1]
    tilt = math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * float(x * x + y * y))))
    falls = tilt > FALLEN_RAD
    limits = (math.inf, math.inf) if falls else allowed
    unit = "m; it falls over in MuJoCo, as the check `stand` would say" if falls else "m"
    return Row("stand_height", "MEDIUM", "robot", one, two, abs(one - two), *limits, unit)


def _landing_time(motion: Motion) -> float:
    """When the centre of mass has fallen as far as the soles had to go; inf when it never did."""
    fallen = motion.com[0, 2] - motion.com[:, 2]
    reached = np.flatnonzero(fallen >= DROP_M)
    if not len(reached):
        return math.inf
    last = int(reached[0])
    return float(np.interp(DROP_M, fallen[last - 1 : last + 1], motion.time[last - 1 : last + 1]))


def _bounce(motion: Motion, landed: float) -> float:
    """How far the root rises again after its lowest point, m."""
    after = motion.root[motion.time >= landed, 2]
    if not len(after):
        return math.nan
    lowest = int(after.argmin())
    return float(after[lowest:].max() - after[lowest])
