"""How PhysX couples joints that mimic others, which its interface does not tell.

Without gravity, contacts and friction a drive swings each leader about the middle of its range.
The line on which its followers move is the multiplier and the offset that PhysX holds. All start
where the robot's own coupling wants them: light links on a line of PhysX's far from there are
thrown to infinity, and nothing is measured, which is a difference too.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.simulators.experiments import Experiment, Outcome, Setting, Sine

NARROW, WIDE = 1e-4, (-0.5, 0.5)
"""rad or m: least range of a leader that shows a line; the range of one without limits."""
SHARE = 0.3
"""How far the leader swings to one side of the middle, as a share of its range."""
FREQUENCY_HZ, STEP_S, STEPS = 2.5, 0.001, 200
KP, KD = 2500.0, 100.0
"""Per unit of inertia: 1/s2 and 1/s."""
NAME = "coupling"
ZERO = 5e-3
"""Share of the leader's way: a smaller offset is none."""


def measurable(tree: Tree) -> Mapping[str, tuple[str, tuple[float, float]]]:
    """Follower -> its leader, and the leader's range in which all its followers move, rad or m."""
    followers = {j.name: j.mimic for j in tree.moving_joints if j.mimic and j.mimic.multiplier}
    ranges: dict[str, tuple[float, float]] = {}
    for name, mimic in followers.items():
        low, high = ranges.get(mimic.joint, tree.by_joint[mimic.joint].range or WIDE)
        span = tree.by_joint[name].range or WIDE
        ends = [(end - mimic.offset) / mimic.multiplier for end in span]
        ranges[mimic.joint] = max(low, min(ends)), min(high, max(ends))
    led = {name: (mimic.joint, ranges[mimic.joint]) for name, mimic in followers.items()}
    return {name: row for name, row in led.items() if row[1][1] - row[1][0] > NARROW}


def experiments(tree: Tree, control: Control) -> tuple[Experiment, ...]:
    """One, or none where nothing mimics."""
    followers = measurable(tree)
    if not followers:
        return ()
    leaders = dict(followers.values())
    drives = {name: Actuator(name, "pd", kp=KP, kd=KD) for name in leaders}
    drives |= {name: Actuator(name, "pd") for name in followers}
    middle = {name: (low + high) / 2.0 for name, (low, high) in leaders.items()}
    swing = {name: SHARE * (high - low) for name, (low, high) in leaders.items()}
    start = with_mimics(tree, {**dict(initial_pose(tree, control).joints), **middle})
    setting = Setting(
        STEP_S, (0.0, 0.0, 0.0), contacts=False, rubbing=False, limited=False, drives=drives,
        drive_type="acceleration", loops=False,
    )  # fmt: skip
    sine = Sine(middle, swing, FREQUENCY_HZ, STEPS * STEP_S)
    return (Experiment(NAME, setting, STEPS, every=5, start=start, sine=sine),)


def measured(tree: Tree, outcomes: Mapping[str, Outcome]) -> dict[str, dict[str, float | str]]:
    """Facts of each follower's coupling, measured once the solver has settled.

    q = multiplier * q(leader) + offset, rad or m. A line that does not show is left out, and so are
    all after a failure.
    """
    done = outcomes.get(NAME)
    if done is None or done.motion is None or not done.finite:
        return {}
    half = len(done.motion.time) // 2
    couplings: dict[str, dict[str, float | str]] = {}
    joints = {name: track[half:] for name, track in done.motion.joints.items()}
    for name, (leader, _) in measurable(tree).items():
        way = float(np.ptp(joints[leader]))
        if way > NARROW * ZERO:
            multiplier, offset = (float(v) for v in np.polyfit(joints[leader], joints[name], 1))
            couplings[name] = {
                "mimics": leader,
                "mimic multiplier": multiplier,
                "mimic offset": offset if abs(offset) > ZERO * way else 0.0,
            }
    return couplings
