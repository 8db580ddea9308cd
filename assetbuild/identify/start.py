"""Where the fit begins: the joint equations as a linear regression on the filtered record.

Of each joint, with the drive's torque tau = kp (u - q) - kd v or as measured:

    tau - ID(q, v, a) = armature a + damping v + friction sign(v) + offset

ID is the inverse dynamics of the links alone. Noise in v and a biases this a little, which is why
it is only the start. The delay is the lag of the command that explains the record best.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from assetbuild.identify.plant import Plant
from assetbuild.identify.record import Drive, Record, smooth, speeds
from assetbuild.robot.pose import Array

SLOWEST_HZ = 250.0
"""Inverse dynamics is asked at most so often."""
LAGS_S = np.arange(0.0, 0.0801, 0.001)
"""Delays that are tried."""
SHORTER = (1.0, 0.6, 0.3)
"""Shares of that delay that are tried in simulation."""
STICKING = (0.4, 0.7, 1.0)
"""Frictions that are tried in simulation, as shares of a torque that is seldom exceeded."""
TRIED_S = 12.0
FITTED = ("armature", "damping", "friction")


@dataclass(frozen=True)
class Motion:
    """A record, smoothed forwards and backwards, without its ends. All (N, J)."""

    v: Array
    a: Array
    rigid: Array


def motion(plant: Plant, record: Record) -> Motion:
    """Smoothed position with its derivatives, and the torque that the links need for them."""
    rate = 1.0 / record.period_s
    q = smooth(record.position, rate)
    v, a = speeds(q, record.period_s)
    every = max(1, int(rate / SLOWEST_HZ))
    at = np.arange(0, len(q), every)
    base = None
    if record.base is not None:
        first, second = speeds(record.base, record.period_s)
        base = (record.base[at], first[at], second[at])
    sparse = plant.rigid_torque(q[at], v[at], a[at], base)
    n = np.arange(len(q))
    columns = [np.interp(n, at, sparse[:, j]) for j in range(q.shape[1])]
    return Motion(v, a, np.stack(columns, axis=1))


def first_guess(
    plant: Plant,
    records: Sequence[Record],
    drives: Sequence[Drive],
    wanted: Sequence[frozenset[str]],
) -> list[Drive]:
    """The drives with the wanted parameters as the regression sees them, where it sees them.

    Dry friction lags like a delay, and a joint that sticks most of the time hides it from a
    regression. So shorter delays and frictions of the size of the torques are tried in simulation,
    too, and each joint begins with those that predict its first seconds best.

    wanted: names of parameters, for each joint.
    """
    motions = [motion(plant, record) for record in records]
    lags = [0.0]
    if any("delay" in names for names in wanted):
        lag = _common_lag(records, motions, drives)
        lags = [share * lag for share in SHORTER]
    best, least = list(drives), np.inf
    for lag in lags:
        late = [
            replace(drive, delay=lag if "delay" in names else drive.delay)
            for drive, names in zip(drives, wanted, strict=True)
        ]
        tried = [_guesses(records, motions, late, wanted)]
        for share, stated in itertools.product(STICKING, (False, True)):
            tried.append(_guesses(records, motions, late, wanted, share, stated))
        errors = _errors(plant, records, tried)
        chosen = np.argmin(errors, axis=0)
        score = float(np.sum(np.log(np.min(errors, axis=0))))
        if score < least:
            best, least = [tried[int(n)][j] for j, n in enumerate(chosen)], score
    return best


def _guesses(
    records: Sequence[Record],
    motions: Sequence[Motion],
    drives: Sequence[Drive],
    wanted: Sequence[frozenset[str]],
    share: float | None = None,
    stated: bool = False,
) -> list[Drive]:
    """Guess by the regression. share: of the usual torque, a friction that is given.

    stated: with the table's armature, for a regression takes for armature what a joint does that
    slips; from an armature of 0 a fit may never leave a wrong friction.
    """
    guesses = []
    for j, (drive, names) in enumerate(zip(drives, wanted, strict=True)):
        if share is not None and "friction" in names:
            usual = [
                np.abs(_equations(r, m, j, drive)[1]) for r, m in zip(records, motions, strict=True)
            ]
            drive = replace(drive, friction=share * float(np.quantile(np.concatenate(usual), 0.9)))
            names = names - {"friction"}
        if stated:
            names = names - {"armature"}
        guesses.append(_guess(records, motions, j, drive, names))
    return guesses


def _errors(plant: Plant, records: Sequence[Record], tried: Sequence[Sequence[Drive]]) -> Array:
    """(tried, J) RMS of what each predicts of the first seconds of the first record."""
    record = records[0][: int(TRIED_S / records[0].period_s)]
    errors = []
    for drives in tried:
        steps = plant.in_steps(plant.longest_for(drives))
        q, _ = steps.simulate(record, [drives])
        errors.append(np.sqrt(np.mean((q[0] - record.position) ** 2, axis=0)))
    rms: Array = np.nan_to_num(np.array(errors), nan=np.inf) + 1e-9
    return rms


def _common_lag(
    records: Sequence[Record], motions: Sequence[Motion], drives: Sequence[Drive]
) -> float:
    """Seconds; the median over the joints, which share a bus."""
    best = []
    for j, drive in enumerate(drives):
        costs = []
        for lag in LAGS_S:
            unexplained = 0.0
            for record, moved in zip(records, motions, strict=True):
                A, y = _equations(record, moved, j, replace(drive, delay=float(lag)))
                x, *_ = np.linalg.lstsq(A, y, rcond=None)
                unexplained += float(np.sum((y - A @ x) ** 2))
            costs.append(unexplained)
        best.append(float(LAGS_S[int(np.argmin(costs))]))
    return float(np.median(best))


def _guess(
    records: Sequence[Record],
    motions: Sequence[Motion],
    j: int,
    drive: Drive,
    names: frozenset[str],
) -> Drive:
    pairs = [_equations(r, m, j, drive) for r, m in zip(records, motions, strict=True)]
    A = np.concatenate([pair[0] for pair in pairs])
    y = np.concatenate([pair[1] for pair in pairs])
    fixed = [i for i, name in enumerate(FITTED) if name not in names]
    known = np.array([getattr(drive, name) for name in FITTED])
    y = y - A[:, fixed] @ known[fixed]
    free = [i for i in range(A.shape[1]) if i not in fixed]
    x, *_ = np.linalg.lstsq(A[:, free], y, rcond=None)
    values = dict(zip([(*FITTED, "offset")[i] for i in free], map(float, x), strict=True))
    return replace(drive, **{k: v if k == "offset" else max(v, 0.0) for k, v in values.items()})


def _equations(record: Record, moved: Motion, j: int, drive: Drive) -> tuple[Array, Array]:
    """(N, 4) regressors of armature, damping, friction and offset; (N,) what they explain."""
    rate = 1.0 / record.period_s
    if record.torque is not None:
        torque = smooth(record.torque[:, j], rate)
    else:
        n = np.arange(len(record.target)) - drive.delay / record.period_s
        late = np.interp(n, np.arange(len(record.target)), record.target[:, j])
        raw = drive.kp * (late - record.position[:, j]) - drive.kd * moved.v[:, j]
        torque = smooth(np.clip(raw, -drive.effort, drive.effort), rate)
    v = moved.v[:, j]
    width = 0.02 * np.sqrt(np.mean(v**2)) + 1e-9
    dry = smooth(np.tanh(v / width), rate)
    A = np.stack([moved.a[:, j], v, dry, np.ones_like(v)], axis=1)
    edge = min(len(v) // 10, int(0.2 * rate))
    inside = slice(edge, len(v) - edge)
    return A[inside], (torque - moved.rigid[:, j])[inside]
