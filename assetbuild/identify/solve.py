"""Records and a robot to parameters: unknowns, their start, the fit, and what to believe of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.identify.estimate import Estimate, Problem, estimate
from assetbuild.identify.plant import Drive, Plant, Record, cutoff_hz, smooth
from assetbuild.identify.start import first_guess, motion
from assetbuild.robot.pose import Array

SETTLE_S = 0.5
"""The beginning of each record, which depends on how it started, is not compared."""
BLOCK_S = 1.0
"""Residuals further apart than this count as independent."""
RATE_HZ = 250.0
"""Faster samples are averaged to this rate before they are compared."""
FLOOR = 0.01
"""No interval is narrower than this share of the value to either side: the steps of the simulation
and the stiffness of the links are not known better."""
CLOCK_S = 0.0002
"""A controller samples, so its damping acts late by a time that no log states: so much of it times
the damping is inertia that cannot be told from the armature. Of logs of a simulator it is known."""
DELAY_S = 0.0005
"""A delay whose interval is no wider is identified, however short it is."""
SAME = 0.99
"""Correlation from which two parameters cannot be told apart."""


@dataclass(frozen=True)
class Unknown:
    """A parameter of one or more tied joints, by their numbers. prior: of the table."""

    name: str
    joints: tuple[int, ...]
    prior: float
    wanted: bool = True
    """False: fitted beside the others and not reported."""


@dataclass(frozen=True)
class Solution:
    """unknowns with their estimates; kept: whether the data show each, else why not.

    drives: with what was identified, refused parameters at their priors. split: samples of each
    record that were fitted.
    """

    unknowns: tuple[Unknown, ...]
    estimate: Estimate
    low: Array
    high: Array
    refused: tuple[str, ...]
    drives: tuple[Drive, ...]


def solve(
    plant: Plant,
    records: Sequence[Record],
    priors: Sequence[Drive],
    unknowns: Sequence[Unknown],
    widest: float,
) -> Solution:
    """Fit the unknowns to the records. widest: share of a value, see `Identify.widest`."""
    offsets = [Unknown("offset", (j,), 0.0, wanted=False) for j in range(len(priors))]
    if _has_torque(records):
        offsets.append(Unknown("lag", tuple(range(len(priors))), 0.0, wanted=False))
    every = (*unknowns, *offsets)
    wanted = [
        frozenset(u.name for u in every if j in u.joints and u.wanted) for j in range(len(priors))
    ]
    records = [record.from_rest() for record in records]
    motions = [motion(plant, record) for record in records]
    guess = first_guess(records, motions, priors, wanted)
    problem = make_problem(plant, records, guess, every)
    found = estimate(problem)
    floor = FLOOR * np.abs(found.theta)
    if plant.simulator_step is None:
        drives = with_values(priors, every, found.theta)
        floor += [clock_error(unknown, drives, _has_torque(records)) for unknown in every]
        unsure = plant.unsure_armature(drives)
        floor += [max(unsure[list(u.joints)]) * (u.name == "armature") for u in every]
    low = np.minimum(found.low, found.theta - floor)
    high = np.maximum(found.high, found.theta + floor)
    refused = _refusals(every, found, low, high, widest)
    values = [
        value if not why else unknown.prior
        for unknown, value, why in zip(every, found.theta, refused, strict=True)
    ]
    drives = with_values(priors, every, values)
    return Solution(every, found, low, high, refused, tuple(drives))


def with_values(
    drives: Sequence[Drive], unknowns: Sequence[Unknown], values: Sequence[float] | Array
) -> list[Drive]:
    """The drives with these values of the unknowns."""
    changes: list[dict[str, float]] = [{} for _ in drives]
    for unknown, value in zip(unknowns, values, strict=True):
        for joint in unknown.joints:
            changes[joint][unknown.name] = float(value)
    return [replace(drive, **change) for drive, change in zip(drives, changes, strict=True)]


# --- the problem ----------------------------------------------------------------------------


def make_problem(
    plant: Plant, records: Sequence[Record], guess: Sequence[Drive], unknowns: Sequence[Unknown]
) -> Problem:
    """The records as channels, and the simulation that predicts them."""
    count, has_torque = len(guess), _has_torque(records)

    def simulate(vectors: Sequence[Array]) -> Array:
        variants = [with_values(guess, unknowns, vector) for vector in vectors]
        parts = []
        for record in records:
            q, torque = plant.simulate(record, variants)
            both = np.concatenate([q, torque], axis=2) if has_torque else q
            parts.append(thinned(both, record, axis=1))
        return np.concatenate(parts, axis=1)

    measured = np.concatenate([thinned(_channels(r, has_torque), r) for r in records])
    blocks = np.concatenate([_blocks(r, n) for n, r in enumerate(records)])
    branches = [
        [j for j in range(count) if any(plant.branches[j] == plant.branches[k] for k in u.joints)]
        for u in unknowns
    ]
    parts = tuple(
        frozenset((*branch, *(j + count for j in branch if has_torque))) for branch in branches
    )
    start = np.array([np.mean([getattr(guess[j], u.name) for j in u.joints]) for u in unknowns])
    steps = np.array(
        [_step(u, value, guess, records) for u, value in zip(unknowns, start, strict=True)]
    )
    lower = np.array([-np.inf if u.name in ("offset", "lag") else 0.0 for u in unknowns])
    noise = np.sqrt(np.mean([_noise(r, has_torque) ** 2 for r in records], axis=0))
    return Problem(simulate, measured, blocks, start, lower, steps, parts, noise)


def _has_torque(records: Sequence[Record]) -> bool:
    return all(record.torque is not None for record in records)


def _channels(record: Record, has_torque: bool) -> Array:
    if not has_torque or record.torque is None:
        return record.position
    return np.concatenate([record.position, record.torque], axis=1)


def _noise(record: Record, has_torque: bool) -> Array:
    """(C,) of the channels after `thinned`: what is faster than any joint moves, taken as white."""
    values = _channels(record, has_torque)
    rate = 1.0 / record.period_s
    fast = values - smooth(values, rate)
    share = 1.0 - 2.0 * cutoff_hz(rate) / rate
    found: Array = np.std(fast, axis=0) / np.sqrt(share * _every(record))
    return found


def _every(record: Record) -> int:
    return max(1, int(1.0 / record.period_s / RATE_HZ))


def thinned(values: Array, record: Record, axis: int = 0) -> Array:
    """Means over neighbours, from where the start is forgotten."""
    every, settle = _every(record), int(SETTLE_S / record.period_s)
    count = (values.shape[axis] - settle) // every
    kept = np.take(values, np.arange(settle, settle + count * every), axis=axis)
    shape = (*kept.shape[:axis], count, every, *kept.shape[axis + 1 :])
    mean: Array = kept.reshape(shape).mean(axis=axis + 1)
    return mean


def _blocks(record: Record, number: int) -> Array:
    count = (len(record.position) - int(SETTLE_S / record.period_s)) // _every(record)
    seconds = np.arange(count) * _every(record) * record.period_s
    return (seconds // BLOCK_S).astype(int) + number * 1_000_000


def _step(
    unknown: Unknown, value: float, drives: Sequence[Drive], records: Sequence[Record]
) -> float:
    """For differences: large enough for the solver's tolerance, small beside what matters."""
    drive = drives[unknown.joints[0]]
    moved = np.concatenate(
        [r.position[:, unknown.joints[0]] - r.target[:, unknown.joints[0]] for r in records]
    )
    torque = drive.kp * float(np.std(moved)) + 1e-6
    scale = {
        "armature": max(value, 1e-3 * drive.kp / 100.0),
        "damping": max(value, 0.05 * (drive.kd + 1e-3 * drive.kp)),
        "friction": max(value, 0.05 * torque),
        "kp": max(value, 1e-3),
        "kd": max(value, 1e-3 * drive.kp),
        "offset": 0.2 * torque,
        "effort": max(value, torque),
        "delay": 0.05,
        "lag": 0.05,
    }[unknown.name]
    return 0.02 * scale


# --- what to believe ------------------------------------------------------------------------


def clock_error(unknown: Unknown, drives: Sequence[Drive], has_torque: bool) -> float:
    """What a parameter is uncertain by because the clocks are, in its own unit.

    A torque that is sampled late looks like damping of the drive in place of the joint's.
    """
    own = [drives[j] for j in unknown.joints]
    if unknown.name == "delay":
        return CLOCK_S
    if unknown.name == "armature":
        return CLOCK_S * max(drive.kd + drive.damping for drive in own)
    if unknown.name in ("damping", "kd") and has_torque:
        return 2.0 * CLOCK_S * max(drive.kp for drive in own)
    return 0.0


def _refusals(
    unknowns: Sequence[Unknown], found: Estimate, low: Array, high: Array, widest: float
) -> tuple[str, ...]:
    """Why the data do not show each unknown; "" where they do."""
    same = np.abs(found.correlation) > SAME
    np.fill_diagonal(same, False)
    reasons = []
    for i, (unknown, value) in enumerate(zip(unknowns, found.theta, strict=True)):
        width = high[i] - low[i]
        others = [unknowns[int(k)].name for k in np.flatnonzero(same[i])]
        if not unknown.wanted:
            reasons.append("")
        elif others:
            reasons.append(f"the data show it only together with {others[0]}")
        elif value <= 0.0:
            reasons.append(f"the best value is 0, at most {high[i]:.3g}")
        elif width > max(widest * value, DELAY_S if unknown.name == "delay" else 0.0):
            reasons.append(
                f"its interval is {width / value:.0%} of its value, above the limit of {widest:.0%}"
            )
        else:
            reasons.append("")
    return tuple(reasons)
