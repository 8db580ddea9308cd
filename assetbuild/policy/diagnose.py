"""Why a policy falls: the usual wiring faults undone one by one, each in the loop.

Where a hypothesis undoes the fault, the robot does what it is asked to do: that is the proof.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from assetbuild.grouping import grouped
from assetbuild.policy.compare import ENGINES, orders_of, sides_of
from assetbuild.policy.replay import Replay, whole_steps
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import ByJoint, Policy
from assetbuild.policy.terms import width
from assetbuild.robot.twins import SIDES

BETTER = 0.25
"""A hypothesis must raise the score by at least this much."""
TIE = 0.05
"""A later one must be better than an earlier one by this much."""
SURE = 1.9
"""From this score on nothing further is tried."""
FACTORS = (0.5, 2.0, 0.25, 4.0)
OBSERVED = {
    "base_ang_vel": (1.0, 0.25, 0.2), "imu_ang_vel": (1.0, 0.25, 0.2),
    "joint_vel_rel": (1.0, 0.05, 0.1), "projected_gravity": (-1.0, 1.0),
    "base_lin_vel": (1.0, 2.0), "imu_lin_vel": (1.0, 2.0), "joint_pos_rel": (1.0,),
    "velocity_commands": (1.0, 2.0), "last_action": (1.0,),
}  # fmt: skip
"""Scales that trainers usually have, by observation."""
ALIKE = {"joint_pos": "joint_pos_rel", "joint_pos_rel": "joint_pos",
         "base_lin_vel": "imu_lin_vel", "imu_lin_vel": "base_lin_vel"}  # fmt: skip
"""Observations that are taken for one another."""
Try = Callable[[Policy], Replay]
Fault = tuple[str, Policy]
"""What was wrong, in words, and the policy with the fault undone."""


@dataclass(frozen=True)
class Diagnosis:
    """The fault that explains best what the policy did, and the replay with it undone."""

    fault: str
    replay: Replay


def diagnose(policy: Policy, bot: Bot, before: Replay, attempt: Try) -> Diagnosis | None:
    """The best hypothesis; None where with none of them the robot does what it should.

    Whole groups of faults are tried before single joints. attempt: replays one as `before` was.
    """
    best: Diagnosis | None = None
    for group in (_orders, _units, _tables, _poses, _terms, _signs, _neighbours):
        for text, undone in group(policy, bot):
            done = attempt(undone)
            limit = best.replay.score + TIE if best else before.score + BETTER
            if done.follows and done.score > limit:
                best = Diagnosis(text, done)
        if best is not None and best.replay.score >= SURE:
            return best
    return best


# --- hypotheses -----------------------------------------------------------------------------------


def _orders(policy: Policy, bot: Bot) -> Iterator[Fault]:
    """The joints stand in another order than the file declares; so perhaps do its gains."""
    for engine, order in orders_of(policy, bot).items():
        if order != policy.joints:
            names = dict(zip(policy.joints, order, strict=True))
            back = {there: here for here, there in names.items()}
            text = f"the joints of the policy stand in {ENGINES[engine]} order"
            yield text, renamed(policy, names)
            yield f"{text}, as do its gains", _with_gains(renamed(policy, names), names)
            text = f"its gains stand in {ENGINES[engine]} order"
            yield text, _with_gains(policy, names)
            text = f"its gains stand in its own order, not in {ENGINES[engine]}"
            yield text, _with_gains(policy, back)
    sides = sides_of(policy.joints)
    if sides:
        both = {name: sides.get(name, name) for name in policy.joints}
        yield "left and right are exchanged", renamed(policy, both)


def _units(policy: Policy, bot: Bot) -> Iterator[Fault]:
    """Rhythm, and the scale of all actions."""
    own_s = policy.step_s or bot.step_s
    for step_s in dict.fromkeys((bot.step_s, 0.5 * own_s, 2.0 * own_s)):
        if abs(step_s - own_s) > 1e-9 and whole_steps(step_s, bot.control.simulation.timestep):
            text = f"it acts every {1e3 * step_s:.4g} ms, not every {1e3 * own_s:.4g} ms"
            yield text, replace(policy, step_s=step_s)
    slips = {-1.0: "the sign of all actions is wrong", math.radians(1.0): "actions are in degrees"}
    for factor in (*slips, *FACTORS):
        scale = {name: factor * value for name, value in policy.scale.items()}
        text = slips.get(factor, f"the action scale is {factor:g} times what the file says")
        yield text, replace(policy, scale=scale)


def _tables(policy: Policy, bot: Bot) -> Iterator[Fault]:
    """Gains from elsewhere, or of another unit."""
    if not policy.kp:
        return
    gains = {name: (bot.kp[name], bot.kd[name]) for name in policy.acts_on if name in bot.kp}
    kp, kd = ({name: pair[i] for name, pair in gains.items()} for i in (0, 1))
    yield "it was trained with the bundle's gains", replace(policy, kp=kp, kd=kd)
    yield "kp and kd are exchanged", replace(policy, kp=policy.kd, kd=policy.kp)
    for factor in (*FACTORS, math.degrees(1.0)):
        times = f"{factor:g} times what the file says"
        times = times if factor in FACTORS else "stated per degree, not per rad"
        kp, kd = ({n: factor * v for n, v in gains.items()} for gains in (policy.kp, policy.kd))
        yield f"its gains are {times}", replace(policy, kp=kp, kd=kd)
        yield f"kp is {times}", replace(policy, kp=kp)
        yield f"kd is {times}", replace(policy, kd=kd)


def _poses(policy: Policy, bot: Bot) -> Iterator[Fault]:
    """Two poses in one file; a pose from elsewhere, in another order, or of the other side."""
    stated, bundle_pose = dict(policy.position), bot.position
    if any(policy.offset[name] != stated[name] for name in policy.acts_on):
        offset = {name: stated[name] for name in policy.acts_on}
        yield "its actions count from its default pose", replace(policy, offset=offset)
        text = "its observations count from the offset of its actions"
        yield text, replace(policy, position={**stated, **policy.offset})
    poses: dict[str, dict[str, float]] = {}
    for engine, order in orders_of(policy, bot).items():
        pairs = list(zip(policy.joints, order, strict=True))
        text = "its default pose is listed in"
        poses[f"{text} {ENGINES[engine]} order"] = {to: stated[of] for of, to in pairs}
        poses[f"{text} its own order, not in {ENGINES[engine]}"] = {
            to: stated[of] for to, of in pairs
        }
    sides = sides_of(policy.joints)
    poses["left and right of its default pose are exchanged"] = {
        name: stated[sides.get(name, name)] for name in policy.joints
    }
    poses["its default pose is the bundle's"] = {n: bundle_pose.get(n, 0.0) for n in policy.joints}
    poses["its default pose is 0"] = dict.fromkeys(policy.joints, 0.0)
    for text, pose in poses.items():
        if pose != stated:
            offset = {name: pose[name] for name in policy.acts_on}
            yield text, replace(policy, position=pose, offset=offset)


def _terms(policy: Policy, _: Bot) -> Iterator[Fault]:
    """Scales and meaning of observations, their order, and how histories are laid out."""
    for index, term in enumerate(policy.terms):
        before, after = policy.terms[:index], policy.terms[index + 1 :]
        for value in OBSERVED.get(term.function, ()):
            if odd := set(term.scale) - {value}:
                text = f"the scale of `{term.name}` is {value:g}, not {min(odd):g}"
                yield text, replace(policy, terms=(*before, replace(term, scale=(value,)), *after))
        if meant := ALIKE.get(term.function):
            text = f"`{term.name}` is `{meant}`, not `{term.function}`"
            yield text, replace(policy, terms=(*before, replace(term, function=meant), *after))
    if any(term.history > 1 for term in policy.terms):
        way = "each term by itself" if policy.by_time else "step by step, all terms together"
        yield f"histories are laid out {way}", replace(policy, by_time=not policy.by_time)
    for one, other in itertools.combinations(range(len(policy.terms)), 2):
        terms = list(policy.terms)
        if width(terms[one], policy) == width(terms[other], policy):
            text = f"`{terms[one].name}` and `{terms[other].name}` are exchanged"
            terms[one], terms[other] = terms[other], terms[one]
            yield text, replace(policy, terms=tuple(terms))


def _signs(policy: Policy, _: Bot) -> Iterator[Fault]:
    """A joint, or one kind of joint, that goes the other way, or starts from the other side."""
    for kind, names in _kinds(policy.acts_on):
        scale = {n: -v if n in names else v for n, v in policy.scale.items()}
        yield f"the action of {kind} has the wrong sign", replace(policy, scale=scale)
        if any(policy.position[name] for name in names):
            position = {n: -v if n in names else v for n, v in policy.position.items()}
            offset = {n: -v if n in names else v for n, v in policy.offset.items()}
            flipped = replace(policy, position=position, offset=offset)
            yield f"the default position of {kind} has the wrong sign", flipped


def _neighbours(policy: Policy, bot: Bot) -> Iterator[Fault]:
    """Gains or scales of two kinds of joints exchanged, on both sides, or of two neighbours."""
    kinds = [kind for kind in _kinds(policy.acts_on) if len(kind[1]) > 1]
    pairs = [(a, b) for a, b in itertools.combinations(kinds, 2) if len(a[1]) == len(b[1])]
    above = {joint.child: joint.name for joint in bot.tree.joints}
    for joint in bot.tree.joints:
        ends = (above.get(joint.parent, ""), joint.name)
        if set(ends) <= set(policy.acts_on):
            pairs.append(tuple((f"`{name}`", (name,)) for name in ends))  # type: ignore[arg-type] # two
    for (one, ours), (other, theirs) in pairs:
        names = dict(zip((*ours, *theirs), (*theirs, *ours), strict=True))
        for word, column in (("kp", policy.kp), ("kd", policy.kd), ("scale", policy.scale)):
            if any(column.get(a) != column.get(b) for a, b in names.items()):
                changed = {word: _moved(column, names)}
                text = f"{word} of {one} and {other} is exchanged"
                yield text, replace(policy, **changed)  # type: ignore[arg-type] # a column


def _kinds(joints: Sequence[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Each kind of joint on both sides, then each joint: `hip_pitch_joint`."""
    for stem, names in grouped(joints, _without_side).items():
        if len(names) > 1:
            yield f"`{stem.strip('_')}` of all limbs", tuple(names)
    yield from ((f"`{name}`", (name,)) for name in joints)


def _without_side(name: str) -> str:
    for pattern in SIDES:
        name = re.sub(pattern, "", name)
    return name


# --- changed policies -----------------------------------------------------------------------------


def renamed(policy: Policy, names: Mapping[str, str]) -> Policy:
    """The same lists for other joints; gains stay with theirs."""
    terms = (replace(t, joints=tuple(names[n] for n in t.joints)) for t in policy.terms)
    return replace(
        policy,
        joints=tuple(names[name] for name in policy.joints),
        acts_on=tuple(names[name] for name in policy.acts_on),
        position=_moved(policy.position, names),
        scale=_moved(policy.scale, names),
        offset=_moved(policy.offset, names),
        terms=tuple(terms),
    )


def _with_gains(policy: Policy, names: Mapping[str, str]) -> Policy:
    """The policy, whose gains are of other joints."""
    return replace(policy, kp=_moved(policy.kp, names), kd=_moved(policy.kd, names))


def _moved(values: ByJoint, names: Mapping[str, str]) -> dict[str, float]:
    """What was of a joint, of the one that it is renamed to."""
    return {names.get(name, name): value for name, value in values.items()}
