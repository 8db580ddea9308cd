"""How PhysX couples joints that mimic others, which its interface does not tell.

Without gravity, contacts, friction and drives the leader starts at two places, its followers
where the robot starts. PhysX pulls both onto the line that it holds: two points of it are its
multiplier and its offset, whatever the robot has in mind.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Joint, Tree
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Motion

SHARES = (0.35, 0.65)
"""Of the leader's range: where it starts."""
NARROW, WIDE = 1e-4, 0.5
"""rad or m: least range of a leader that shows a line; the range of one without limits."""
STEP_S, STEPS, SETTLED = 0.001, 200, 0.5
ZERO = 5e-3
"""Share of the leader's way: a smaller offset is none."""


@dataclass(frozen=True)
class Coupling:
    """q = multiplier * q(leader) + offset, rad or m."""

    leader: str
    multiplier: float
    offset: float


def measurable(tree: Tree) -> Mapping[str, tuple[float, float]]:
    """Follower -> range of its leader, rad or m, of joints that PhysX couples.

    It couples joints of one kind, and a follower that has limits: `usd.mimic` reports others.
    """
    ranges: dict[str, tuple[float, float]] = {}
    followers = [j for j in tree.moving_joints if j.mimic is not None and _is_coupled(tree, j)]
    for joint in followers:
        assert joint.mimic is not None  # noqa: S101 # chosen above
        leader = tree.by_joint[joint.mimic.joint]
        low, high = ranges.get(leader.name, _range(leader))
        ends = [(end - joint.mimic.offset) / joint.mimic.multiplier for end in _range(joint)]
        ranges[leader.name] = max(low, min(ends)), min(high, max(ends))
    found = {j.name: ranges[j.mimic.joint] for j in followers if j.mimic is not None}
    return {name: (low, high) for name, (low, high) in found.items() if high - low > NARROW}


def _is_coupled(tree: Tree, joint: Joint) -> bool:
    if joint.mimic is None or not joint.mimic.multiplier:
        return False
    leader = tree.by_joint[joint.mimic.joint]
    alike = (leader.kind == "prismatic") == (joint.kind == "prismatic")
    return alike and None not in (joint.limits.lower, joint.limits.upper)


def _range(joint: Joint) -> tuple[float, float]:
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous" or lower is None or upper is None:
        return -WIDE, WIDE
    return lower, upper


def experiments(tree: Tree, control: Control) -> tuple[physx.Experiment, ...]:
    """Two, or none where nothing mimics."""
    ranges = measurable(tree)
    if not ranges:
        return ()
    leaders = {tree.by_joint[name].mimic.joint: ends for name, ends in ranges.items()}  # type: ignore[union-attr] # followers
    limp = {name: Actuator(name, "pd") for name in {*leaders, *ranges}}
    setting = physx.Setting(
        STEP_S, (0.0, 0.0, 0.0), contacts=False, rubbing=False, limited=False, drives=limp
    )
    start = dict(initial_pose(tree, control).joints)
    one = physx.Experiment("", setting, steps=STEPS, every=10)
    return tuple(
        replace(one, name=f"coupling_{number}", start={
            **start, **{name: low + share * (high - low) for name, (low, high) in leaders.items()}
        })
        for number, share in enumerate(SHARES)
    )  # fmt: skip


def measured(tree: Tree, outcomes: Mapping[str, physx.Outcome]) -> dict[str, Coupling]:
    """Of each follower; a line that does not show is left out, and so is one after a failure."""
    motions = [o.motion for n, o in outcomes.items() if n.startswith("coupling_") and o.finite]
    done = [motion for motion in motions if motion is not None]
    found = {}
    for name in measurable(tree) if len(done) == len(SHARES) else ():
        mimic = tree.by_joint[name].mimic
        assert mimic is not None  # noqa: S101 # a follower
        leader, follower = _settled(done, mimic.joint), _settled(done, name)
        way = float(np.ptp(leader))
        if way <= NARROW * ZERO:
            continue
        multiplier, offset = (float(v) for v in np.polyfit(leader, follower, 1))
        found[name] = Coupling(mimic.joint, multiplier, offset if abs(offset) > ZERO * way else 0.0)
    return found


def _settled(motions: list[Motion], joint: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    parts = [m.joints[joint][int(SETTLED * len(m.time)) :] for m in motions]
    return np.concatenate(parts)
