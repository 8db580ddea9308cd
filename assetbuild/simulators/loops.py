"""A swing of the driven joints of a robot with loops, and how far these open on the way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar, Self

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule, known
from assetbuild.plugin_types import RecipeView, write_figures
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.closure import close, coordinates, felt_inertia, gaps
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import joints_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.simulators.experiments import (
    Experiment,
    Outcome,
    SimulatorCheck,
    Sine,
    plain,
    sine_of,
    swing,
)

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
    "`validate.loops.error_limit`, or where the simulation goes to infinity)",
    "for MuJoCo and Newton a smaller timestep or a firmer loop: one of the recipe takes the place "
    "of the MJCF's of its name, firm by default; for PhysX more "
    "`usd.articulation.solver_position_iterations`",
)
HANGS = Rule(
    "loop.no_mobility",
    "info",
    "the loops leave no joint a motion, so they were tried under gravity alone",
    "nothing, where that is meant",
)


class LoopSwing(Model):
    """The driven joints of a robot with loops swing, base held; null = do not run it."""

    frequency: Positive = Field(0.5, description="Hz")
    seconds: Positive = Field(3.0, description="s; the first third is left out")
    gap: Positive = Field(1e-4, description="m or rad: how far a loop may open, warning")
    error_limit: Positive = Field(5e-3, description="the same, error")


def trial(tree: Tree, control: Control, wish: LoopSwing) -> Experiment:
    """Independent joints swing about the initial pose, as wide as all loops stay closed.

    Driven joints do; where none of them is part of a loop, joints of loops too. A joint without a
    gain gets a servo; a drive whose motion the others decide lets go.
    """
    home = with_mimics(tree, dict(initial_pose(tree, control).joints))
    armature = {row.joint: row.armature for row in control.actuators}
    robot = dynamics(replace(tree, base="fixed"), home, armature)
    driven = {a.joint for a in control.actuators if a.model != "passive"} & set(robot.joints)
    chain = joints_of(tree, control.loops)
    chosen = coordinates(control.loops, robot, driven)
    free = {name for name in robot.joints if robot.column(name) in chosen}
    leading = free & (driven if driven & chain & free else driven | chain)
    felt = felt_inertia(control.loops, robot)
    rate = 2.0 * math.pi * SERVO_HZ
    servos, table = {}, {row.joint: row for row in control.actuators}
    for name in (joint.name for joint in tree.moving_joints if joint.name in driven | leading):
        row = table.get(name) or Actuator(name, "passive")
        # The drive itself where it holds a position, else a critically damped servo.
        servos[name] = Actuator(name, "pd")
        if name in leading and row.kp > 0.0 and row.model in ("pd", "ideal_pd", "dc_motor"):
            servos[name] = Actuator(name, "pd", kp=row.kp, kd=row.kd, damping=row.damping)
        elif name in leading:
            inertia = felt[name] if math.isfinite(felt[name]) else 1.0  # of a joint that loops lock
            servos[name] = Actuator(name, "pd", kp=inertia * rate**2, kd=2.0 * inertia * rate)
        table[name] = replace(servos[name], velocity=row.velocity)
    made = sine_of(
        tree, replace(control, actuators=tuple(table.values())), home, wish.frequency, wish.seconds
    )
    wide = {name: width if name in leading else 0.0 for name, width in made.swing.items()}
    setting = replace(
        plain(control),
        base="held" if tree.base == "floating" else "asset",
        contacts=False,
        limited=False,
        drives=servos,
        other_drives=False,
    )
    sine = replace(made, middle=home, swing=_closable(tree, control, home, wide))
    return swing("loops", setting, sine, SAMPLE_S)


def about_closed(tree: Tree, control: Control, sine: Sine, home: Mapping[str, float]) -> Sine:
    """The sine about a middle that keeps all loops closed: its own, or home where that opens one.

    PhysX goes to infinity from a start whose loops are far open.
    """
    if not control.loops:
        return sine
    if not _balls(tree):
        free = [name for name in joints_of(tree, control.loops) if not sine.swing.get(name)]
        solution = close(tree, control.loops, sine.middle, free)
        if solution.closed:
            return replace(sine, middle=solution.positions)
    return replace(sine, middle=with_mimics(tree, home))


def _balls(tree: Tree) -> list[str]:
    """Ball joints, whose positions no engine tells as numbers."""
    return [joint.name for joint in tree.joints if joint.kind == "ball"]


def _closable(
    tree: Tree, control: Control, home: Mapping[str, float], swing: Mapping[str, float]
) -> dict[str, float]:
    """Half as wide until the loops close at both ends of the swing."""
    free = [name for name in joints_of(tree, control.loops) if not swing.get(name)]

    def closes(share: float) -> bool:
        end = {name: q + share * swing.get(name, 0.0) for name, q in home.items()}
        return close(tree, control.loops, end, free, 1).closed

    shares = [0.5**halving for halving in range(HALVINGS + 1)]
    largest = next((share for share in shares[:-1] if closes(-share) and closes(share)), shares[-1])
    return {name: largest * width for name, width in swing.items()}


def opened(tree: Tree, control: Control, done: Outcome) -> dict[str, float]:
    """The largest gap of each loop over a motion, m or rad; infinite where it is not finite.

    The first third is left out: there the drives catch up with targets that start with a jerk.
    """
    worst, motion = {loop.name: 0.0 for loop in control.loops}, done.motion
    if motion is None or not done.finite:
        return dict.fromkeys(worst, math.inf)
    moving = [joint.name for joint in tree.moving_joints]
    for index in range(len(motion.time) // 3, len(motion.time)):
        tracks = motion.joints
        q = {name: float(tracks[name][index]) if name in tracks else 0.0 for name in moving}
        for name, size in gaps(tree, control.loops, q).items():
            worst[name] = max(worst[name], size)
    return worst


class LoopCheck(SimulatorCheck):
    """Swings the driven joints of a robot with loops, its base held, and measures every gap."""

    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    sections: ClassVar[Mapping[str, str]] = {"validate.loops": "wish"}

    wish: LoopSwing = LoopSwing()

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self | None:
        """Make it only for a robot that may have loops: by its recipe, its parts or its MJCF."""
        asked = any(map(recipe.value, SOURCES))
        return super().configure(recipe) if asked else None

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and the simulator's file."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        reason = "" if control.loops else "the robot has no loops"
        if control.loops and (balls := _balls(tree)):
            reason = (
                f"a loop runs over ball joint `{balls[0]}`; the edit `split_joint` makes hinges"
            )
        if reason:
            write_figures(files, {"skipped": reason})
            return
        asked = trial(tree, control, self.wish)
        done = self.perform(files.inputs, (asked,))[asked.name]
        worst = opened(tree, control, done)
        gaps_known = {name: known(gap) for name, gap in worst.items()}
        figures = {
            "swing": {name: width for name, width in asked.sine.swing.items() if width},
            "seconds": asked.sine.seconds,
            "open": gaps_known,
            "largest_gap": max(
                (gap for gap in gaps_known.values() if gap is not None), default=0.0
            ),
        }
        write_figures(files, figures, dict.fromkeys(("open", "largest_gap"), self.wish.gap))
        yield from self.evaluate(asked.sine, worst, done.failure)

    def evaluate(
        self, sine: Sine, worst: Mapping[str, float], failure: str = ""
    ) -> Iterator[Finding]:
        """worst: gap of each loop, m or rad; infinite where the simulation failed."""
        if not any(sine.swing.values()):
            message = f"no joint of the loops can swing: in {self.engine} gravity alone pulled"
            yield HANGS("robot", message)
        for name, size in worst.items():
            message = (
                f"in {self.engine} it opened by {size:.3g} m or rad over {sine.seconds:g} s of "
                f"swinging, above the limit of {self.wish.gap:g}"
            )
            if not math.isfinite(size):
                message = f"{self.engine} did not swing it: {failure or 'it went to infinity'}"
            if size > self.wish.gap:
                yield OPENS(
                    f"loop {name}",
                    message,
                    severity="error" if size > self.wish.error_limit else "warning",
                    data={"open": known(size), "limit": self.wish.gap},
                )
