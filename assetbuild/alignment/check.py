"""MuJoCo beside another simulator, row by row: how both move the robot, and why not alike.

What each of them holds is compared with the robot by the read-backs. A row has a rank, and two
limits: the design's, for a warning, and the coarse one of practice, for an error.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from assetbuild.alignment.row import SLOWER, SOFT, Row, findings_of
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import NOT_LOADED, Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import joints_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import (
    Experiment,
    Motion,
    Outcome,
    SimulatorCheck,
    Sine,
    Swing,
    compare_response,
    drop,
    load,
    plain,
    servos,
    sine_of,
    standing,
    swing,
    widest,
)
from assetbuild.simulators.free_fall import Fall, fall_of
from assetbuild.simulators.loops import about_closed
from assetbuild.simulators.mujoco.motion import perform

FINE_DT, SAMPLE_S, FALL_S = 0.001, 0.005, 0.4
STAND_S, DROP_S, DROP_M = 2.0, 1.2, 1.0
STOP_HZ, STOP_S = 1.0, 1.0
SHARP = 2.0
"""Into a stop the target goes so many times as far as the joint has room for: beyond the limit by
as much as it stood before it."""
FINER = 8
"""So many times shorter steps tell a difference of integrators from one of the robot."""
End = Literal["lower", "upper"]
ENDS: tuple[End, End] = ("lower", "upper")
RANKS = ("HIGH", "MEDIUM")
VERDICTS = ("error", "warning", "ok", "told")
EXPLAINED = 0.5
"""Share of a difference that must be gone before a reason counts as one."""
RAD, METRE = (0.01, 0.1), (0.001, 0.01)
"""How much further past a limit than in MuJoCo: a warning, an error."""
SHORTER = "a shorter `simulation.timestep` brings them together"
OFF = ("warning", "error")


class FloorLimits(Model):
    """Where two engines may part on a floor: a warning, and an error."""

    stand_height: tuple[Positive, Positive] = Field(
        (0.005, 0.01), description="m, between the roots after standing"
    )
    landing: tuple[Positive, Positive] = Field(
        (0.03, 0.1), description="share of the time that a fall from 1 m takes, of either engine"
    )


class AlignmentCheck(SimulatorCheck):
    """`mjcf/` in MuJoCo and `usd/` in another simulator: how they move."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    sections: ClassVar[Mapping[str, str]] = {"validate.alignment": "floor", "validate.sine": "sine"}
    recipe_fields: ClassVar[Mapping[str, str]] = {"fall": "validate.free_fall"}
    off: ClassVar[Rule]
    failed: ClassVar[Rule]

    sine: Swing | None = Swing()
    fall: Fall = Fall()
    floor: FloorLimits = FloorLimits()
    iterations: int = 1
    """How often the simulator applies gravity in a step."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: all rows, worst first within their rank."""
        robot, mjcf = RobotFiles(files.inputs), files.inputs / "mjcf"
        tree, control = robot.tree, robot.control
        try:
            model = mujoco.load(mjcf / f"{self.robot}.xml", visuals=False).model
        except StepError:
            write_figures(files, {NOT_LOADED: "the MJCF does not load"})  # `mjcf.load` says why
            return
        experiments = experiments_of(tree, control, self.sine)
        theirs = self.perform(files.inputs, tuple(experiments.values()))
        ours = functools.partial(perform, mjcf, self.robot)
        rows = [*Compared(self, tree, control, ours, experiments, theirs).rows()]
        if (held := theirs["load"].held) is not None:
            rows += self.held_rows(model, held, tree)
        rows.sort(key=lambda row: (RANKS.index(row.rank), VERDICTS.index(row.verdict)))
        write_figures(files, {"rows": [row.shown(self.engine) for row in rows]})
        for name, done in theirs.items():
            if not done.finite:
                message = f"no comparison of `{name}`: {done.failure}"
                yield self.failed("robot", message, data={"simulator": self.engine.lower()})
        yield from findings_of(rows, self.off, self.engine)

    def held_rows(self, model: mujoco.Model, held: Any, tree: Tree) -> Iterator[Row]:
        """Rows about what the other engine holds. held: as it says. Any: JSON."""
        yield from ()


# --- what both are asked: to load, fall, follow sines, push into stops, stand, and land ----------


def experiments_of(tree: Tree, control: Control, wish: Swing | None) -> dict[str, Experiment]:
    """Name -> experiment, in the order of running. wish: None = no sine and no stops."""
    experiments = [load(control)]
    floats, start = tree.base == "floating", initial_pose(tree, control)
    if floats:
        experiments += [drop(control, FALL_S)]
    if wish is not None:
        home = dict(start.joints)
        held = replace(plain(control), drives=servos(control))
        held = replace(held, base="held") if floats else held
        bare = replace(held, timestep=FINE_DT, contacts=False, rubbing=False, limited=False)
        # MuJoCo's limits of commands would clip what asks for more than a limit allows.
        unclipped = replace(held, contacts=False, clipped=False)
        fine = replace(unclipped, timestep=unclipped.timestep / FINER)
        sine = sine_of(tree, control, home, wish.frequency, wish.seconds)
        sine = about_closed(tree, control, sine, home)
        # Twice: stripped of what simulators model differently, in fine steps, and as it is.
        asked = [("sine", bare, sine, SAMPLE_S), ("sine_as_is", held, sine, SAMPLE_S)]
        for end in ENDS:
            stop = into_stop(tree, control, home, end)
            asked += [(f"past_{end}", unclipped, stop, 0.0), (f"past_{end}_fine", fine, stop, 0.0)]
        experiments += [swing(*one) for one in asked if any(one[2].swing.values())]
    if floats and start.name:  # a keyframe above a floor
        stand, raised = standing(tree, control), standing(tree, control, DROP_M)
        joints = dict(start.joints)
        steps = [round(seconds / stand.timestep) for seconds in (STAND_S, DROP_S)]
        experiments += [
            Experiment("stand", stand, steps[0], every=20, start=joints),
            Experiment("drop", raised, steps[1], start=joints),
        ]
    return {experiment.name: experiment for experiment in experiments}


def into_stop(tree: Tree, control: Control, home: Mapping[str, float], end: End) -> Sine:
    """Return a sine that starts before the limits and passes them, of the joints that have one.

    Loops stop their joints before the limits do: these stay at home, where all loops are closed. A
    joint that mimics goes with its leader.
    """
    chain = joints_of(tree, control.loops)
    middle, swing = {}, {}
    for joint in tree.moving_joints:
        lower, upper = joint.bounds
        rest = home.get(joint.name, 0.0) if joint.name in chain else 0.0
        middle[joint.name], swing[joint.name] = min(max(rest, lower), upper), 0.0
        stop = upper if end == "upper" else lower
        drive = control.by_joint.get(joint.name)
        if drive is None or not drive.kp > 0.0 or joint.mimic is not None:
            continue
        if joint.name not in chain and math.isfinite(stop) and upper > lower:
            speeds = [drive.velocity] if drive.velocity else ()
            room = widest(joint, speeds, SHARP * STOP_HZ)
            sign = 1.0 if end == "upper" else -1.0
            middle[joint.name], swing[joint.name] = stop - sign * room, sign * SHARP * room
    return Sine(with_mimics(tree, middle), swing, STOP_HZ, STOP_S)


# --- what comes of it ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Compared:
    """The robot and both simulators: MuJoCo is asked for what the other has done."""

    limits: AlignmentCheck
    tree: Tree
    control: Control
    mujoco: Callable[[Experiment], Outcome]
    asked: Mapping[str, Experiment]
    theirs: Mapping[str, Outcome]

    def rows(self) -> Iterator[Row]:
        """A row for each joint or robot of each experiment that both brought to its end."""
        for name, of in ROWS.items():
            if motions := self.motions(name):
                yield from of(self, self.asked[name], *motions)

    def motions(self, name: str) -> tuple[Motion, Motion] | None:
        """Return MuJoCo's motion and the other's, where both brought the experiment to its end."""
        done = self.theirs.get(name)
        if done is None or not done.finite or done.motion is None:
            return None
        ours = self.mujoco(self.asked[name]).motion
        return None if ours is None else (ours, done.motion)


def fall_rows(both: Compared, asked: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """The drop of each against the law of its own integrator."""
    one = fall_of(asked, Outcome(None, ours))
    two = fall_of(asked, Outcome(None, theirs), both.limits.iterations)
    if one is not None and two is not None:
        yield Row(
            "free_fall",
            "HIGH",
            "robot",
            f"{one.drop_m:.6g} m of {one.expected_m:.6g}",
            f"{two.drop_m:.6g} m of {two.expected_m:.6g}",
            max(one.relative_error, two.relative_error),
            both.limits.fall.tolerance,
            both.limits.fall.error_limit,
            "of the drop",
        )


# --- sines --------------------------------------------------------------------------------------


def sine_rows(both: Compared, asked: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """How each joint follows its sine."""
    sine, is_pure, wish = asked.sine, not asked.setting.rubbing, both.limits.sine or Swing()
    soft = {joint.mimic.joint: "coupling of joints" for joint in both.tree.joints if joint.mimic}
    if not is_pure:
        soft |= {a.joint: "dry friction" for a in both.control.actuators if a.friction > 0.0}
    hasty, hard = "" if is_pure else _hasty(both.control, ours), None
    # After a touch two motions have nothing more in common: reported, not judged.
    warn = wish.tolerance if is_pure else wish.tolerance_as_is
    limits = (math.inf, math.inf) if ours.touched else (warn, wish.error_limit)
    followed = {joint.name for joint in both.tree.joints if joint.mimic}
    loose = [name for name, width in sine.swing.items() if not width and name not in followed]
    unit = "of the swing, RMS"
    if ours.touched:  # what lets two motions part that began alike, for the reader
        unit += "; the robot touches itself"
    elif loose:
        unit += f"; {len(loose)} joints without a drive of positions or speeds swing freely, where "
        unit += "small differences grow"
    for joint, width in sine.swing.items():
        if width <= 0.0:
            continue
        response = compare_response(sine, joint, ours, theirs)
        moved = f"swing x {response.gain:.5f}, {response.lag_rad:+.4f} rad later"
        swung = f"swing {response.swing:.5g}"
        row = Row(asked.name, "HIGH", f"joint {joint}", swung, moved, response.rms, *limits, unit)
        if joint in soft and row.verdict in OFF:
            firm = replace(asked, setting=replace(asked.setting, hard=True))
            hard = hard or both.mujoco(firm).motion
            row = row if hard is None else _explained(row, sine, joint, soft, hard, theirs)
        if hasty and not row.because and row.verdict in OFF:
            row = replace(row, because=hasty, advice=SLOWER)
        yield row


def _hasty(control: Control, ours: Motion) -> str:
    """The joint that is most above its limit of speed in MuJoCo, which has none; or "".

    Thrown about by what carries it, a wrist passes it whatever its own drive is asked, and what
    hangs on it and what carries it move otherwise too.
    """
    worst, message = 1.0, ""
    for joint, angle in ours.joints.items():
        drive = control.by_joint.get(joint)
        if drive is None or not drive.velocity:
            continue
        fastest = float(np.abs(np.gradient(angle, ours.time)).max())
        if fastest > worst * drive.velocity:
            worst = fastest / drive.velocity
            message = (
                f"MuJoCo has no limit of speed: `{joint}` moves at {fastest:.3g}, its limit is "
                f"{drive.velocity:.3g} rad/s or m/s"
            )
    return message


def _explained(
    row: Row, sine: Sine, joint: str, soft: Mapping[str, str], hard: Motion, theirs: Motion
) -> Row:
    """The row with its reason, where MuJoCo agrees once its constraints are hard: within the
    warning, or twice as well and no error.

    MuJoCo's dry friction and its coupling of joints are soft constraints: under a torque tau
    below the limit of friction a joint of inertia M creeps by v = (1 - d) tau / (d b M), d and
    b of solimp and solref. A hip stands; a wrist of 1e-3 kg m2 moves by 1 rad/s for each N m,
    where PhysX's joint sticks. A coupled finger gives way by a like amount.
    """
    left = compare_response(sine, joint, hard, theirs).rms
    if not left <= max(row.warn, min(row.error, EXPLAINED * (row.off or 0.0))):
        return row
    because = f"MuJoCo's {soft[joint]} is soft: made hard, {left:.3g} apart"
    return replace(row, because=because, advice=SOFT)


# --- stops --------------------------------------------------------------------------------------


def stop_rows(both: Compared, asked: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """How far each driven joint runs past its limit; why further, where shorter steps agree."""
    rows = list(_past_rows(both.tree, asked, ours, theirs))
    fine, apart = both.asked[f"{asked.name}_fine"], dict[str, Row]()
    if any(row.verdict in OFF for row in rows) and (motions := both.motions(fine.name)):
        apart = {row.subject: row for row in _past_rows(both.tree, fine, *motions)}
    for row in rows:
        short = apart.get(row.subject)
        if row.verdict in OFF and short is not None and short.verdict == "ok":
            steps = f"in steps of {fine.setting.timestep:g} s, {short.off:.2g} apart"
            row = replace(row, because=f"the integrators part: {steps}", advice=SHORTER)
        yield row


def _past_rows(tree: Tree, asked: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """A row for each joint that was driven: beyond its limit, rad or m, the largest of the run."""
    end: End = "lower" if asked.name.startswith("past_lower") else "upper"
    for joint in tree.moving_joints:
        if not asked.sine.swing[joint.name]:
            continue
        lower, upper = joint.bounds
        tracks = [motion.joints[joint.name] for motion in (ours, theirs)]
        # Negative where the joint stays before its limit.
        beyond = [track - upper if end == "upper" else lower - track for track in tracks]
        past, linear = [float(each.max()) for each in beyond], joint.kind == "prismatic"
        yield Row(
            f"past_{end}",
            "HIGH",
            f"joint {joint.name}",
            past[0],
            past[1],
            max(0.0, past[1] - max(0.0, past[0])),
            *(METRE if linear else RAD),
            "m further" if linear else "rad further",
        )


# --- on the floor -------------------------------------------------------------------------------


def stand_rows(both: Compared, _: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """Where the root stands at the end; two falls have nothing to do with one another."""
    one, two = float(ours.root[-1, 2]), float(theirs.root[-1, 2])
    _, x, y, _ = ours.turn[-1]
    tilt = math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * float(x * x + y * y))))
    falls = tilt > math.radians(20.0)
    limits = (math.inf, math.inf) if falls else both.limits.floor.stand_height
    unit = "m; it falls over in MuJoCo, as the check `stand` would say" if falls else "m"
    yield Row("stand_height", "MEDIUM", "robot", one, two, abs(one - two), *limits, unit)


def landing_rows(both: Compared, _: Experiment, ours: Motion, theirs: Motion) -> Iterator[Row]:
    """When each lands, against the law of falling."""
    down = abs(both.control.simulation.gravity[2])
    if down == 0.0:
        return
    ideal = math.sqrt(2.0 * DROP_M / down)
    one, two = _landing_time(ours), _landing_time(theirs)
    off = max(abs(time - ideal) / ideal for time in (one, two))
    yield Row(
        "landing_s", "MEDIUM", "robot", one, two, off, *both.limits.floor.landing, "of the time"
    )


def _landing_time(motion: Motion) -> float:
    """When the centre of mass has fallen as far as the soles had to go; inf when it never did."""
    fallen = motion.com[0, 2] - motion.com[:, 2]
    reached = np.flatnonzero(fallen >= DROP_M)
    if not len(reached):
        return math.inf
    last = int(reached[0])
    return float(np.interp(DROP_M, fallen[last - 1 : last + 1], motion.time[last - 1 : last + 1]))


ROWS = {
    "fall": fall_rows,
    "sine": sine_rows,
    "sine_as_is": sine_rows,
    "past_lower": stop_rows,
    "past_upper": stop_rows,
    "stand": stand_rows,
    "drop": landing_rows,
}
"""What is compared of each experiment."""
