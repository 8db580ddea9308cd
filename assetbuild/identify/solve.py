"""Records and a robot to parameters: unknowns, their start, the fit, and what to believe of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.identify.estimate import Estimate, Problem, approach, estimate
from assetbuild.identify.plant import Plant
from assetbuild.identify.record import Drive, Record, cutoff_hz, smooth
from assetbuild.identify.start import first_guess
from assetbuild.robot.pose import Array

SETTLE_S = 0.5
"""The beginning of each record, which depends on how it started, is not compared."""
BEGINNING, BEGINNING_S = 0.3, 10.0
"""Share of a record, or s, that the fit begins with: it is cheap to be nearly right."""
BLOCK_S = 1.0
"""Residuals further apart than this count as independent."""
WINDOW_S = 0.25
"""The noise of the sensors is read off in windows of this length."""
RATE_HZ = 250.0
"""Faster samples are averaged to this rate before they are compared."""
FLOOR = 0.01
"""No interval is narrower than this share of the value to either side: the steps of the simulation
and the stiffness of the links are not known better."""
CLOCK_S = 0.0002
"""A controller samples, so its damping acts late by a time that no log states: so much of it times
the damping is inertia that cannot be told from the armature. Of logs of a simulator it is known."""
DELAY_S = 0.001
"""A delay whose interval is no wider is identified, however short it is."""
STEP_ERROR = 2.0
"""What the steps of the simulation do to a parameter, in differences that half of the step makes:
an error of first order is twice that."""
MISSED = 2.0
"""Residuals above so many times the noise are said with a refusal."""
LACKS = "so it lacks something"
"""In the reason for a refusal, where residuals are above the noise."""
BESIDE_FRICTION = ("armature", "damping")
SAME = 0.99
"""Correlation from which two parameters cannot be told apart."""


@dataclass(frozen=True)
class Unknown:
    """A parameter of one or more joints that share it, by their numbers. prior: of the table."""

    name: str
    joints: tuple[int, ...]
    prior: float
    wanted: bool = True
    """False: fitted beside the others and not reported."""


@dataclass(frozen=True)
class Solution:
    """unknowns with their estimates; refused: why the data do not show each, "" where they do.

    drives: with what was identified, refused parameters at their priors.
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
    max_relative_interval: float,
    effective: bool = False,
) -> Solution:
    """Fit the unknowns to the records.

    max_relative_interval: as in `Identify`. effective: whether its `values` are.
    """
    offsets = [Unknown("offset", (j,), 0.0, wanted=False) for j in range(len(priors))]
    if _has_torque(records):
        offsets.append(Unknown("lag", tuple(range(len(priors))), 0.0, wanted=False))
    every = (*unknowns, *offsets)
    wanted = [
        frozenset(u.name for u in every if j in u.joints and u.wanted) for j in range(len(priors))
    ]
    records = [record.from_rest() for record in records]
    first = first_guess(plant, records, priors, wanted)
    beginnings = [_beginning(record) for record in records]
    guess = with_values(first, every, approach(make_problem(plant, beginnings, first, every)))
    fine = plant.longest_for(guess)
    if fine < plant.longest_s:
        guess = with_values(
            guess, every, approach(_in_steps(plant, fine, beginnings, guess, every))
        )
    problem = _in_steps(plant, fine, records, guess, every)
    plant = plant.in_steps(fine)
    fit = estimate(problem)
    if bool(np.any(fit.sigma > MISSED * problem.noise)):  # the beginning may have misled it
        other = estimate(_in_steps(plant, fine, records, first, every))
        fit = min(fit, other, key=lambda each: float(np.sum(np.log(each.sigma))))
    floor = FLOOR * np.abs(fit.theta)
    if plant.simulator_step is None:
        drives = with_values(priors, every, fit.theta)
        floor += [clock_error(unknown, drives, _has_torque(records)) for unknown in every]
        finer = make_problem(plant.in_steps(plant.longest_s / 2.0), records, guess, every)
        floor += STEP_ERROR * np.abs(fit.moved_by(finer.simulate([fit.theta])[0]))
    lacking = 0.0 * floor if effective else fit.lacking
    low = np.minimum(fit.low - lacking, fit.theta - floor)
    high = np.maximum(fit.high + lacking, fit.theta + floor)
    blame = [_missed(unknown, fit, problem.noise) for unknown in every]
    refused = _refusals(every, fit, low, high, max_relative_interval, blame)
    values = [
        value if not why else unknown.prior
        for unknown, value, why in zip(every, fit.theta, refused, strict=True)
    ]
    drives = with_values(priors, every, values)
    return Solution(every, fit, low, high, refused, tuple(drives))


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
    moved = [frozenset[int]().union(*(plant.moved[j] for j in u.joints)) for u in unknowns]
    parts = tuple(joints | {j + count for j in joints if has_torque} for joints in moved)
    start = np.array([np.mean([getattr(guess[j], u.name) for j in u.joints]) for u in unknowns])
    steps = np.array(
        [_step(u, value, plant, guess, records) for u, value in zip(unknowns, start, strict=True)]
    )
    lower = np.array([-np.inf if u.name in ("offset", "lag") else 0.0 for u in unknowns])
    noise = np.sqrt(np.mean([_noise(r, has_torque) ** 2 for r in records], axis=0))
    return Problem(simulate, measured, blocks, start, lower, steps, parts, noise)


def _in_steps(
    plant: Plant,
    fine: float,
    records: Sequence[Record],
    guess: Sequence[Drive],
    unknowns: Sequence[Unknown],
) -> Problem:
    """The problem with residuals of fine steps, s, and differences of twice as long ones."""
    problem = make_problem(plant.in_steps(fine), records, guess, unknowns)
    if fine >= plant.longest_s:
        return problem
    coarse = make_problem(plant.in_steps(2.0 * fine), records, guess, unknowns)
    return replace(problem, sense=coarse.simulate)


def _beginning(record: Record) -> Record:
    least = round(BEGINNING_S / record.period_s)
    return record[: max(least, round(BEGINNING * len(record.position)))]


def _has_torque(records: Sequence[Record]) -> bool:
    return all(record.torque is not None for record in records)


def _channels(record: Record, has_torque: bool) -> Array:
    if not has_torque or record.torque is None:
        return record.position
    return np.concatenate([record.position, record.torque], axis=1)


def _noise(record: Record, has_torque: bool) -> Array:
    """(C,) of the channels after `thinned`: what is faster than any joint moves, taken as white.

    The median over short windows, because a joint that sticks and slips moves fast now and then.
    """
    values = _channels(record, has_torque)
    rate = 1.0 / record.period_s
    fast = values - smooth(values, rate)
    share = 1.0 - 2.0 * cutoff_hz(rate) / rate
    count = max(1, int(len(fast) / (WINDOW_S * rate)))
    windows = np.stack([np.std(part, axis=0) for part in np.array_split(fast, count)])
    noise: Array = np.median(windows, axis=0) / np.sqrt(share * _every(record))
    return noise


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
    unknown: Unknown,
    value: float,
    plant: Plant,
    drives: Sequence[Drive],
    records: Sequence[Record],
) -> float:
    """A step for differences: large for the solver's tolerance, small beside what matters."""
    drive = drives[unknown.joints[0]]
    moved = np.concatenate(
        [r.position[:, unknown.joints[0]] - r.target[:, unknown.joints[0]] for r in records]
    )
    torque = drive.kp * float(np.std(moved)) + 1e-6
    scale = {
        "armature": max(value, 1e-5 * drive.kp, 0.1 * float(plant.inertia[unknown.joints[0]])),
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
    affected = [drives[j] for j in unknown.joints]
    if unknown.name == "delay":
        return CLOCK_S
    if unknown.name == "armature":
        return CLOCK_S * max(drive.kd + drive.damping for drive in affected)
    if unknown.name in ("damping", "kd") and has_torque:
        return 2.0 * CLOCK_S * max(drive.kp for drive in affected)
    return 0.0


def _missed(unknown: Unknown, fit: Estimate, noise: Array) -> str:
    """Say by how much the model misses the log; "" where the noise explains it."""
    ratio = fit.sigma / np.maximum(noise, 1e-12)
    worst = max(unknown.joints, key=lambda j: float(ratio[j]))
    if fit.sigma[worst] < MISSED * noise[worst]:
        return ""
    return (
        f"; the model misses the log by {fit.sigma[worst]:.2g}, {LACKS} "
        f"(the noise is {noise[worst]:.2g})"
    )


def _slides_freely(unknown: Unknown, unknowns: Sequence[Unknown], low: Array) -> bool:
    """Whether a friction that is fitted beside it may be 0: a joint that sticks most of the time
    looks like one of much damping, too, and a drive without dry friction is rare."""
    return any(
        other.name == "friction" and low[i] <= 0.0 and set(other.joints) & set(unknown.joints)
        for i, other in enumerate(unknowns)
    )


def _refusals(
    unknowns: Sequence[Unknown],
    fit: Estimate,
    low: Array,
    high: Array,
    max_relative_interval: float,
    blame: Sequence[str],
) -> tuple[str, ...]:
    """Why the data do not show each unknown; "" where they do. blame: what widens intervals."""
    same = np.abs(fit.correlation) > SAME
    np.fill_diagonal(same, False)
    reasons = []
    for i, (unknown, value) in enumerate(zip(unknowns, fit.theta, strict=True)):
        width = high[i] - low[i]
        others = [unknowns[int(k)].name for k in np.flatnonzero(same[i])]
        if not unknown.wanted:
            reasons.append("")
        elif others:
            reasons.append(f"the data show it only together with {others[0]}")
        elif unknown.name == "delay" and width <= DELAY_S:
            reasons.append("")
        elif value <= 0.0:
            reasons.append(f"the best value is 0, at most {high[i]:.3g}{blame[i]}")
        elif width > max_relative_interval * value:
            reasons.append(
                f"its interval is {width / value:.0%} of its value, above the limit of "
                f"{max_relative_interval:.0%}{blame[i]}"
            )
        elif unknown.name in BESIDE_FRICTION and _slides_freely(unknown, unknowns, low):
            reasons.append(
                "the best friction of the joint is 0, as where a fit ends beside its minimum; "
                "a joint that has none needs 0 in the table and `fit` without friction"
            )
        else:
            reasons.append("")
    return tuple(reasons)
