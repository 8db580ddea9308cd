"""What is asked of every simulator, and what comes back: plain values, no engine.

An `Experiment` is one stage, loaded and stepped: `load`, `drop` and `swing` make the usual ones,
with a `Course` it grips, with `Setting.gravity` it tilts. All simulators answer as an `Outcome`,
so that a check can lay two answers side by side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from assetbuild.plugin_types import Check
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Actuator, Control, Joint, Tree
from assetbuild.robot.pose import IDENTITY, Array, Pose, Vec3

CLEARANCE_M = 1e-3
EXTERNAL = frozenset({"ideal_pd", "dc_motor", "motor", "general"})
"""Their law runs outside of the simulator; both engines get the same servo instead."""
SWING_RAD = 0.3
SWING_M = 0.05
SHARE_OF_RANGE = 0.2
"""Largest swing as a share of the joint's range, so that narrow joints stay off their stops."""
SHARE_OF_SPEED = 0.6
"""Largest speed as a share of the joint's limit, which PhysX keeps and MuJoCo does not know."""


class Swing(Model):
    """Every joint follows a sine, base held, in MuJoCo and in PhysX; null = do not run it."""

    frequency: Positive = Field(1.0, description="Hz")
    seconds: Positive = Field(3.0, description="s; the first third is left out")
    tolerance: Positive = Field(
        0.01, description="of the swing, RMS between the engines without friction, warning"
    )
    tolerance_as_is: Positive = Field(
        0.05, description="the same with contacts, friction and limits, warning"
    )
    error_limit: Positive = Field(0.2, description="of the swing, either way, error")


# --- questions ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sine:
    """Every joint's target at once: middle + swing sin(2 pi f t). rad or m, by joint name.

    speeds: joints whose drive takes a speed; it is asked for that of the same motion.
    """

    middle: Mapping[str, float]
    swing: Mapping[str, float]
    frequency_hz: float = 1.0
    seconds: float = 3.0
    speeds: frozenset[str] = frozenset()

    def commands(self, steps: int, dt: float) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return the positions and speeds by joint that drives are asked for in each step."""
        omega, times = 2.0 * math.pi * self.frequency_hz, dt * np.arange(1.0, steps + 1.0)
        wave, rate = np.sin(omega * times), omega * np.cos(omega * times)
        positions = {name: q + self.swing[name] * wave for name, q in self.middle.items()}
        return positions, {name: self.swing[name] * rate for name in sorted(self.speeds)}


@dataclass(frozen=True)
class Gripped:
    """A free object on a table that is moved, in the world's frame, m and kg.

    size: (3,) of a cube, or of a cylinder along z, or of a sphere. table: X_world_table of the
    middle of its upper face, z up.
    """

    shape: Literal["cube", "cylinder", "sphere"]
    size: Vec3
    mass: float
    inertia: Vec3
    friction: float
    X_world_object: Pose
    X_world_table: Pose


@dataclass(frozen=True)
class Course:
    """What is done in every step to an object that is gripped.

    targets: (n,) of drives by joint, rad or m. table: (n, 3) world, m. force: (n, 3) on the object,
    world, N. watched: bodies from which the object is seen. n: steps and one.
    """

    targets: Mapping[str, Array]
    table: Array
    force: Array
    watched: tuple[str, ...]


@dataclass(frozen=True)
class Setting:
    """What surrounds the robot and what is changed on it.

    base: `asset` leaves it; `held` bolts a floating one to the world at the origin.
    at: X_world_robot of the whole asset, None = where it stands; keyframe, raised_m: the same for
    MuJoCo. floor_friction: None = no floor.
    contacts: False switches every collider off. rubbing: False takes joint friction and damping.
    limited: False takes the limits of effort and speed. clipped: False takes those of commands.
    hard: dry friction and coupled joints give way as little as in a textbook, in MuJoCo.
    drives: gains to write over the asset's own, by joint name; drive_type: of these, per unit of
    inertia where it is `acceleration`; other_drives: False takes all but these.
    loops: False opens every loop.
    locked: positions of joints that do not move, rad or m.
    slippery: factor of the friction of floor and robot. solver: how Newton solves contacts, by the
    names of its solver; a USD says nothing of it.
    """

    timestep: float
    gravity: Vec3
    base: Literal["asset", "held"] = "asset"
    at: Pose | None = None
    keyframe: str = ""
    raised_m: float = 0.0
    floor_friction: float | None = None
    contacts: bool = True
    rubbing: bool = True
    limited: bool = True
    clipped: bool = True
    hard: bool = False
    drives: Mapping[str, Actuator] | None = None
    drive_type: Literal["force", "acceleration"] = "force"
    other_drives: bool = True
    loops: bool = True
    locked: Mapping[str, float] = field(default_factory=dict)
    gripped: Gripped | None = None
    slippery: float = 1.0
    solver: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """One stage, loaded and stepped. steps: 0 = only loaded. every: steps between samples.

    start: joint positions, rad or m; joints without one stay where the asset puts them.
    sine: without joints there is none.
    pilot: a socket whose other end looks and commands until it has seen enough: see `_moving`.
    """

    name: str
    setting: Setting
    steps: int = 0
    every: int = 1
    start: Mapping[str, float] | None = None
    sine: Sine = Sine({}, {})
    course: Course | None = None
    pilot: str = ""


@dataclass(frozen=True)
class StageNames:
    """The robot's names by prim path below `/World/robot`, and which joints are angles."""

    bodies: Mapping[str, str]
    joints: Mapping[str, str]
    angular: frozenset[str]


def plain(control: Control) -> Setting:
    """Return the setting of the asset alone, as the recipe has it simulated."""
    return Setting(control.simulation.timestep, control.simulation.gravity)


def load(control: Control) -> Experiment:
    """What the simulator holds of the robot."""
    return Experiment("load", plain(control))


def drop(control: Control, seconds: float) -> Experiment:
    """The robot falls without contacts; only the end is seen."""
    setting = replace(plain(control), contacts=False)
    steps = max(1, round(seconds / setting.timestep))
    return Experiment("fall", setting, steps=steps, every=steps)


def standing(tree: Tree, control: Control, raised_m: float = 0.0) -> Setting:
    """The initial pose on a floor, a hair above it, with servos for laws outside of the engine.

    A sole that starts inside of the floor by the smallest amount is thrown out in the first step.
    """
    start = initial_pose(tree, control)
    base = start.base or IDENTITY
    x, y, z = base.xyz
    return replace(
        plain(control),
        at=Pose((x, y, z + CLEARANCE_M + raised_m), base.quat),
        keyframe=start.name,
        raised_m=raised_m,
        floor_friction=control.contact.friction[0],
        drives=servos(control),
    )


def servos(control: Control) -> dict[str, Actuator]:
    """Drives whose law is outside of the simulator."""
    return {a.joint: a for a in control.actuators if a.model in EXTERNAL and a.kp > 0.0}


def swing(name: str, setting: Setting, sine: Sine, sample_s: float) -> Experiment:
    """All joints follow a sine from its middle."""
    dt = setting.timestep
    every = max(1, round(sample_s / dt))
    return Experiment(name, setting, round(sine.seconds / dt), every, sine.middle, sine)


def sine_of(
    tree: Tree, control: Control, home: Mapping[str, float], frequency_hz: float, seconds: float
) -> Sine:
    """A swing about `home` (0 without) that stays inside the limits of every joint, speed too.

    A middle too near to a stop is moved off it: there two engines would compare their stops.
    Joints without a drive for positions or speeds have no swing; those that mimic follow their
    leader.
    """
    middle, swing, speeds = {}, {}, set()
    for joint in tree.moving_joints:
        lower, upper = joint.bounds
        room = 1.25 * widest(joint)  # a small swing too: weight may press its joint on the stop
        actuator = control.by_joint.get(joint.name)
        by_speed = actuator is not None and actuator.model == "velocity" and actuator.kd > 0.0
        limits = [actuator.velocity if actuator else joint.limits.velocity]
        if by_speed and actuator is not None and actuator.ctrl is not None:
            limits += [-actuator.ctrl[0], actuator.ctrl[1]]  # what may be asked of it
        width = widest(joint, [max(v, 0.0) for v in limits if v is not None], frequency_hz)
        middle[joint.name] = min(max(home.get(joint.name, 0.0), lower + room), upper - room)
        driven = by_speed or (actuator is not None and actuator.kp > 0.0)
        swing[joint.name] = width if driven and joint.mimic is None else 0.0
        if by_speed:
            speeds.add(joint.name)
    return Sine(with_mimics(tree, middle), swing, frequency_hz, seconds, frozenset(speeds))


def widest(joint: Joint, speeds: Iterable[float] = (), frequency_hz: float = 1.0) -> float:
    """How far a joint may swing, rad or m. speeds: limits, rad/s or m/s."""
    lower, upper = joint.bounds
    most = SWING_M if joint.kind == "prismatic" else SWING_RAD
    fastest = [SHARE_OF_SPEED * speed / (2.0 * math.pi * frequency_hz) for speed in speeds]
    return min(most, SHARE_OF_RANGE * (upper - lower), *fastest)


# --- answers ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Motion:
    """Trajectories, sampled at `time` (n,), s. joints: rad or m by name, each (n,).

    root: (n, 3) m; turn: (n, 4) wxyz of the root; com: (n, 3) of the whole robot, m.
    touched: something touched something on the way; False where nobody looked. seen: (n, k, 3) of
    an object in the frames of k bodies, m; None without one.
    """

    time: Array
    joints: Mapping[str, Array]
    root: Array
    turn: Array
    com: Array
    touched: bool = False
    seen: Array | None = None

    @property
    def finite(self) -> bool:
        """Nothing went to infinity or to NaN."""
        tracks = (self.root, self.turn, self.com, *self.joints.values())
        return all(bool(np.isfinite(track).all()) for track in tracks)


@dataclass(frozen=True)
class Outcome:
    """held, motion: None where the simulator did not get that far, and `failure` says why."""

    held: Any  # `Held` of PhysX, JSON of Newton
    motion: Motion | None
    failure: str = ""

    @property
    def finite(self) -> bool:
        """It got to its end and nothing was NaN."""
        return not self.failure and (self.motion is None or self.motion.finite)


class SimulatorCheck(Check):
    """Base of the checks that ask one simulator, whichever it is: the face of all simulators."""

    engine: ClassVar[str]
    """Its name in sentences."""

    robot: str
    """Name of the robot: the stem of its files."""

    def perform(self, inputs: Path, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
        """Outcomes by name. A crash or a NaN ends only its own experiment."""
        raise NotImplementedError

    def label(self, target: str, file: Path) -> tuple[str, str]:
        """(target, its name in sentences) that it simulates where MuJoCo has this file."""
        return "usd", self.engine


@dataclass(frozen=True)
class Response:
    """How one joint followed one sine, or one engine another.

    swing: amplitude of the first at the frequency of the sine, rad or m. rms: of the difference, as
    a share of the swing; gain: ratio of the amplitudes; lag_rad: phase of the second behind the
    first.
    """

    swing: float
    rms: float
    gain: float
    lag_rad: float


def compare_response(sine: Sine, joint: str, first: Motion, second: Motion) -> Response:
    """The second motion against the first, the first third left out: there both still settle."""
    start = len(first.time) // 3
    time = first.time[start:]
    a = first.joints[joint][start:]
    b = np.interp(time, second.time, second.joints[joint])
    omega = 2.0 * math.pi * sine.frequency_hz
    one, two = phasor(time, a, omega), phasor(time, b, omega)
    ratio = two / one if abs(one) > 0.0 else complex(math.inf)
    rms = float(np.sqrt(np.mean((b - a) ** 2))) / sine.swing[joint]
    return Response(abs(one), rms, abs(ratio), -float(np.angle(ratio)))


def phasor(time: Array, values: Array, omega: float) -> complex:
    """Complex amplitude of the part that swings with `omega`: least squares, with an offset."""
    basis = np.stack([np.sin(omega * time), np.cos(omega * time), np.ones_like(time)], axis=1)
    (sine, cosine, _), *_ = np.linalg.lstsq(basis, values, rcond=None)
    return complex(sine, cosine)
