"""A swing of the driven joints of a robot with loops, and how far these open on the way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from pydantic import Field

from assetbuild.findings import Finding, Rule
from assetbuild.quantities import Model, Positive
from assetbuild.robot.closure import close, coordinates, gaps
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import path_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.robot.reflected import felt_inertia
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Motion, Sine, sine_of

SOURCES = ("loops", "compose", "source.mjcf")
"""Keys of a recipe by which its robot may have loops."""
SERVO_HZ = 4.0
"""Natural frequency of the critically damped servos that stand in for drives without a gain."""
HALVINGS = 6
SAMPLE_S = 0.01

OPENS = Rule(
    "loop.opens",
    ("warning", "error"),
    "a loop opens by more than `validate.loops.gap` while the driven joints swing (an error above "
    "`validate.loops.broken`, or where the simulation goes to infinity)",
    "for MuJoCo and Newton a smaller timestep or a firmer loop: one of the recipe takes the place "
    "of the MJCF's of its name, firm by default; for PhysX more "
    "`usd.articulation.solver_position_iterations`",
)
HANGS = Rule(
    "loop.rigid",
    "info",
    "the loops leave no joint a motion, so they were tried under gravity alone",
    "nothing, where that is meant",
)


class LoopSwing(Model):
    """The driven joints of a robot with loops swing, base held; null = do not run it."""

    frequency: Positive = Field(0.5, description="Hz")
    seconds: Positive = Field(3.0, description="s; the first third is left out")
    gap: Positive = Field(1e-4, description="m or rad: how far a loop may open, warning")
    broken: Positive = Field(5e-3, description="the same, error")


@dataclass(frozen=True)
class Trial:
    """What every engine is asked: targets, and the servos that follow them, by joint."""

    sine: Sine
    servos: Mapping[str, Actuator]


def trial(tree: Tree, control: Control, wish: LoopSwing) -> Trial:
    """Independent joints swing about the initial pose, as wide as all loops stay closed.

    Driven joints do; where none of them is part of a loop, joints of loops too. A joint without a
    gain gets a servo; a drive whose motion the others decide lets go.
    """
    home = with_mimics(tree, dict(initial_pose(tree, control).joints))
    armature = {row.joint: row.armature for row in control.actuators}
    robot = dynamics(replace(tree, base="fixed"), home, armature)
    driven = {a.joint for a in control.actuators if a.model != "passive"} & set(robot.joints)
    chain = {joint.name for loop in control.loops for joint in path_of(tree, loop)}
    chosen = coordinates(control.loops, robot, driven)
    free = {name for name in robot.joints if robot.column(name) in chosen}
    leading = free & (driven if driven & chain & free else driven | chain)
    felt = felt_inertia(control.loops, robot)
    servos, table = {}, {row.joint: row for row in control.actuators}
    for name in (joint.name for joint in tree.moving_joints if joint.name in driven | leading):
        row = table.get(name) or Actuator(name, "passive")
        servos[name] = _servo(row, felt[name]) if name in leading else Actuator(name, "pd")
        table[name] = replace(servos[name], velocity=row.velocity)
    made = sine_of(
        tree, replace(control, actuators=tuple(table.values())), home, wish.frequency, wish.seconds
    )
    swing = {name: width if name in leading else 0.0 for name, width in made.swing.items()}
    return Trial(replace(made, middle=home, swing=_closable(tree, control, home, swing)), servos)


def experiment(tree: Tree, control: Control, asked: Trial) -> physx.Experiment:
    """The swing as PhysX and Newton do it on the USD."""
    step = control.simulation.timestep
    setting = physx.Setting(
        step,
        control.simulation.gravity,
        "held" if tree.base == "floating" else "asset",
        contacts=False,
        limited=False,
        drives=asked.servos,
    )
    steps, every = round(asked.sine.seconds / step), max(1, round(SAMPLE_S / step))
    return physx.Experiment("loops", setting, steps, every, asked.sine.middle, asked.sine)


def about_closed(tree: Tree, control: Control, sine: Sine, home: Mapping[str, float]) -> Sine:
    """The sine about a middle that keeps all loops closed: its own, or home where that opens one.

    PhysX goes to infinity from a start whose loops are far open.
    """
    if not control.loops:
        return sine
    if not balls(tree, control):
        chain = {joint.name for loop in control.loops for joint in path_of(tree, loop)}
        free = [name for name in chain if not sine.swing.get(name)]
        found = close(tree, control.loops, sine.middle, free)
        if found.closed:
            return replace(sine, middle=found.positions)
    return replace(sine, middle=with_mimics(tree, home))


def unfit(tree: Tree, control: Control) -> str:
    """Why the loops of this robot cannot be swung; "" where they can."""
    if not control.loops:
        return "the robot has no loops"
    over = balls(tree, control)
    hint = "the edit `split_joint` makes hinges"
    return f"a loop runs over ball joint `{over[0]}`; {hint}" if over else ""


def balls(tree: Tree, control: Control) -> tuple[str, ...]:
    """Ball joints of a robot with loops, whose positions no engine tells as numbers."""
    names = tuple(joint.name for joint in tree.joints if joint.kind == "ball")
    return names if control.loops else ()


def _servo(row: Actuator, inertia: float) -> Actuator:
    """The drive itself where it holds a position, else a critically damped servo."""
    if row.kp > 0.0 and row.model in ("pd", "ideal_pd", "dc_motor"):
        return Actuator(row.joint, "pd", kp=row.kp, kd=row.kd, damping=row.damping)
    rate = 2.0 * math.pi * SERVO_HZ
    inertia = inertia if math.isfinite(inertia) else 1.0  # of a joint that the loops lock
    return Actuator(row.joint, "pd", kp=inertia * rate**2, kd=2.0 * inertia * rate)


def _closable(
    tree: Tree, control: Control, home: Mapping[str, float], swing: Mapping[str, float]
) -> dict[str, float]:
    """Half as wide until the loops close at both ends of the swing."""
    chain = {joint.name for loop in control.loops for joint in path_of(tree, loop)}
    free = [name for name in chain if not swing.get(name)]
    share = 1.0
    for _ in range(HALVINGS):
        ends = [
            {name: q + sign * share * swing.get(name, 0.0) for name, q in home.items()}
            for sign in (-1.0, 1.0)
        ]
        if all(close(tree, control.loops, end, free, 1).closed for end in ends):
            break
        share /= 2.0
    return {name: share * width for name, width in swing.items()}


def opened(tree: Tree, control: Control, motion: Motion | None) -> dict[str, float]:
    """The largest gap of each loop over a motion, m or rad; infinite where it is not finite.

    The first third is left out: there the drives catch up with targets that start with a jerk.
    """
    worst = {loop.name: 0.0 for loop in control.loops}
    if motion is None or not motion.finite:
        return dict.fromkeys(worst, math.inf)
    for index in range(len(motion.time) // 3, len(motion.time)):
        q = {joint.name: 0.0 for joint in tree.moving_joints}
        q |= {name: float(track[index]) for name, track in motion.joints.items() if name in q}
        for name, size in gaps(tree, control.loops, q).items():
            worst[name] = max(worst[name], size)
    return worst


def figures(asked: Trial, worst: Mapping[str, float]) -> dict[str, object]:
    """For the report."""
    return {
        "swing": {name: width for name, width in asked.sine.swing.items() if width},
        "seconds": asked.sine.seconds,
        "open": {name: gap if math.isfinite(gap) else None for name, gap in worst.items()},
        "largest_gap": max((gap for gap in worst.values() if math.isfinite(gap)), default=0.0),
    }


def judge(
    engine: str, wish: LoopSwing, asked: Trial, worst: Mapping[str, float]
) -> Iterator[Finding]:
    """engine: its name in sentences."""
    if not any(asked.sine.swing.values()):
        yield HANGS("robot", f"no joint of the loops can swing: in {engine} gravity alone pulled")
    for name, size in worst.items():
        if not size <= wish.gap:
            told = f"opened by {size:.3g} m or rad" if math.isfinite(size) else "went to infinity"
            yield OPENS(
                f"loop {name}",
                f"in {engine} it {told} over {asked.sine.seconds:g} s of swinging, above the limit "
                f"of {wish.gap:g}",
                severity="error" if not size <= wish.broken else "warning",
                data={"open": size if math.isfinite(size) else None, "limit": wish.gap},
            )
