"""Output-error fit of parameters to a record, with intervals that hold for coloured residuals.

The model predicts channels y(t, theta); the record is y(t, theta0) + e(t). Gauss and Newton's
method minimises the weighted squares of the residuals. The residuals of a robot are neither white
nor independent of the motion, because no model is complete, so the intervals come from the sums of
the scores over blocks of time, not from the Fisher information alone:

    cov = A^-1 (sum over blocks of s s^T) A^-1,  A = J^T W J,  s = J^T W e of a block

(the cluster-robust "sandwich"; White 1980, Arellano 1987). What the Fisher information alone says
is a lower bound of it here.

Residuals above the noise of the sensors come from something that the model lacks, such as a
payload. It may look like a parameter in every block, so it widens the intervals further, by
2 |r| / (|J_p| sqrt(K)): J_p is the part of a parameter's effect that no other has, K the number of
independent directions that such a residual is assumed to have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.pose import Array

ROUNDS = 14
"""Most Gauss-Newton steps."""
DIRECTIONS = 12.0
"""K, see the module: of 1, all of what the model lacks would look like the parameter."""
NOISE_MARGIN = 1.15
"""Residuals up to so many times the noise are noise."""
ENOUGH, STALLED = 0.05, 0.5
"""Steps below this share of each standard error end the fit; the second, where they do no good."""
WORTH = 0.2
"""So does a step that lowers the weighted squares by less than this for each parameter: half a
standard error of each lowers them by 0.25."""
OTHERWISE, ROUGHLY = 0.1, (0.5, 0.3)
"""Effects are stale whose prediction of a step misses more than this share of the squares of what
it did. The second: `ENOUGH` and this of a coarse fit."""
FURTHEST = 25.0
"""A step changes no parameter by more than its size, or so many times its step for differences."""

Simulate = Callable[[Sequence[Array]], Array]
"""Parameter vectors, (P,) each -> predictions (vectors, samples, channels)."""


@dataclass(frozen=True)
class Problem:
    """A record and what to fit to it.

    measured: (N, C). blocks: (N,) number of the block of time of each sample. start, lower, steps:
    (P,); steps: for finite differences. noise: (C,) of the sensors, as the record itself shows it.
    parts: for each parameter the channels that it can move; parameters that move no common channel
    are perturbed in one simulation. sense: a faster simulation for the differences; an error of it
    slows the fit down, but does not bias it, because the residuals are those of `simulate`.
    """

    simulate: Simulate
    measured: Array
    blocks: Array
    start: Array
    lower: Array
    steps: Array
    parts: tuple[frozenset[int], ...]
    noise: Array
    sense: Simulate | None = None


@dataclass(frozen=True)
class Estimate:
    """theta, low, high: (P,), 95 % intervals. correlation: (P, P) of the Fisher information.

    condition: of the scaled information; sigma: (C,) RMS of the residuals; simulated: (N, C);
    effect: (P, N, C) of the parameters on it; covariance: (P, P) of white noise; lacking: (P,) what
    residuals above the noise would add to either side of an interval.
    """

    theta: Array
    low: Array
    high: Array
    correlation: Array
    condition: float
    sigma: Array
    simulated: Array
    effect: Array
    covariance: Array
    lacking: Array

    def moved_by(self, simulated: Array) -> Array:
        """(P,) how far a fit with this prediction instead would lie from this one."""
        pull = np.einsum("pnc,nc->p", self.effect, (self.simulated - simulated) / self.sigma**2)
        shift: Array = self.covariance @ pull
        return shift


def estimate(problem: Problem) -> Estimate:
    """Fit and judge."""
    return _judged(problem, *_fitted(problem, ENOUGH, OTHERWISE))


def approach(problem: Problem) -> Array:
    """(P,) where a coarse fit ends."""
    return _fitted(problem, *ROUGHLY)[0]


def _fitted(problem: Problem, enough: float, otherwise: float) -> tuple[Array, Array, Array, Array]:
    """theta, the effect of the parameters there, what is simulated, its sigma.

    Effects are taken anew only where a step did something else than they said; in between, each
    step corrects them by what it did (Broyden 1965).
    """
    theta = at = np.array(problem.start, float)
    simulated = problem.simulate([theta])[0]
    sigma = _sigma(problem, simulated)
    jacobian = _jacobian(problem, theta, simulated)
    for _ in range(ROUNDS):
        step, error = _newton(problem, jacobian, simulated, sigma, theta)
        before, predicted = theta, simulated
        theta, simulated, moved = _walk(problem, theta, step, simulated, sigma)
        gain = _cost(problem, predicted, sigma) - _cost(problem, simulated, sigma)
        sigma = _sigma(problem, simulated)
        left = float(np.max(np.abs(step) / error))
        if left <= enough or (not moved and (left <= STALLED or np.array_equal(at, theta))):
            break
        if moved and gain <= WORTH * len(theta):
            break
        step, change = theta - before, simulated - predicted
        expected = np.einsum("p,pnc->nc", step, jacobian)
        if not moved or _is_stale(expected, change, sigma, otherwise):
            jacobian, at = _jacobian(problem, theta, simulated), theta
        else:
            _correct(problem, jacobian, step, change - expected)
    return theta, jacobian, simulated, sigma


def predicted_errors(problem: Problem, sigma: Array) -> tuple[Array, Array]:
    """Standard errors and correlations that a record will have whose noise is white; (P,), (P, P).

    sigma: (C,) noise of the channels. For a plan of what to record, before there is a record.
    """
    simulated = problem.simulate([problem.start])[0]
    information = _information(_jacobian(problem, problem.start, simulated), sigma)
    covariance, correlation, _ = _inverse(information, _scale(problem, problem.start))
    return np.sqrt(np.diag(covariance)), correlation


# --- the parts ------------------------------------------------------------------------------


def _sigma(problem: Problem, simulated: Array) -> Array:
    """RMS of each channel; a channel that fits exactly keeps a weight that is finite."""
    rms: Array = np.sqrt(np.mean((problem.measured - simulated) ** 2, axis=0))
    spread = np.std(problem.measured, axis=0)
    least: Array = 1e-6 * np.maximum(spread, 1e-6)
    return np.maximum(rms, least)


def _jacobian(problem: Problem, theta: Array, simulated: Array) -> Array:
    """(P, N, C), by differences; parameters of disjoint parts share a simulation."""
    rounds: list[list[int]] = []
    for index, part in enumerate(problem.parts):
        for together in rounds:
            if all(not part & problem.parts[other] for other in together):
                together.append(index)
                break
        else:
            rounds.append([index])
    vectors = []
    for together in rounds:
        moved = theta.copy()
        moved[together] += problem.steps[together]
        vectors.append(moved)
    jacobian = np.zeros((len(theta), *simulated.shape))
    if problem.sense is None:
        outcomes = problem.simulate(vectors)
    else:
        simulated, outcomes = problem.sense([theta])[0], problem.sense(vectors)
    for together, outcome in zip(rounds, outcomes, strict=True):
        for index in together:
            channels = sorted(problem.parts[index])
            jacobian[index][:, channels] = (outcome - simulated)[:, channels] / problem.steps[index]
    return jacobian


def _is_stale(expected: Array, change: Array, sigma: Array, otherwise: float) -> bool:
    """Whether a step did something else in some channel; less than noise does not count."""
    did = np.sum((change / sigma) ** 2, axis=0)
    missing = np.sum(((change - expected) / sigma) ** 2, axis=0)
    return bool(np.any(missing > np.maximum(otherwise * did, 1.0)))


def _correct(problem: Problem, jacobian: Array, step: Array, missing: Array) -> None:
    """Make, in place, the smallest change of the effects with which they predict this step's."""
    scaled = step * _size(problem, step) ** -2
    for channel in range(missing.shape[1]):
        indices = [p for p, part in enumerate(problem.parts) if channel in part]
        length = float(step[indices] @ scaled[indices])
        if length > 0.0:
            jacobian[indices, :, channel] += np.outer(scaled[indices], missing[:, channel]) / length


def _information(jacobian: Array, sigma: Array) -> Array:
    weighted = (jacobian / sigma).reshape(len(jacobian), -1)
    product: Array = weighted @ weighted.T
    return product


def _scale(problem: Problem, theta: Array) -> Array:
    """What counts as a large change of each parameter."""
    return 10.0 * _size(problem, theta)


def _size(problem: Problem, theta: Array) -> Array:
    """The size of each parameter: its own or ten of its steps."""
    size: Array = np.maximum(np.abs(theta), 10.0 * np.abs(problem.steps))
    return size


def _inverse(information: Array, scale: Array) -> tuple[Array, Array, float]:
    """Covariance and correlation with a vague prior, and the condition of the scaled information.

    The prior keeps what the data do not show finite: its interval is then wider than any limit.
    """
    whole = information + np.diag(1.0 / scale**2)
    norm = np.sqrt(np.diag(whole))
    scaled = whole / np.outer(norm, norm)
    inverse = np.linalg.inv(scaled)
    covariance = inverse / np.outer(norm, norm)
    spread = np.sqrt(np.diag(inverse))
    return covariance, inverse / np.outer(spread, spread), float(np.linalg.cond(scaled))


def _newton(
    problem: Problem, jacobian: Array, simulated: Array, sigma: Array, theta: Array
) -> tuple[Array, Array]:
    """The step to the minimum of the linear model within the bounds, and standard errors.

    No parameter goes further than `FURTHEST`; the others then take what is best beside it.
    """
    residual = ((problem.measured - simulated) / sigma).reshape(-1)
    information = _information(jacobian, sigma)
    gradient = (jacobian / sigma).reshape(len(theta), -1) @ residual
    whole = information + np.diag(1.0 / _scale(problem, theta) ** 2)
    furthest = np.maximum(np.abs(theta), FURTHEST * np.abs(problem.steps))
    least = np.maximum(problem.lower - theta, -furthest)
    step, free = np.zeros_like(theta), np.ones(len(theta), bool)
    for _ in range(len(theta)):
        rest = gradient[free] - whole[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(whole[np.ix_(free, free)], rest)
        outside = free & ((step < least - 1e-15) | (step > furthest))
        step = np.clip(step, least, furthest)
        if not outside.any():
            break
        free &= ~outside
    covariance, _, _ = _inverse(information, _scale(problem, theta))
    return step, np.sqrt(np.diag(covariance))


def _walk(
    problem: Problem, theta: Array, step: Array, simulated: Array, sigma: Array
) -> tuple[Array, Array, bool]:
    """Go as far along the step as the squares fall."""

    now = _cost(problem, simulated, sigma)
    for share in (1.0, 0.3, 0.1, 0.03):
        there = np.maximum(theta + share * step, problem.lower)
        prediction = problem.simulate([there])[0]
        if _cost(problem, prediction, sigma) <= now:
            return there, prediction, True
    return theta, simulated, False


def _cost(problem: Problem, prediction: Array, sigma: Array) -> float:
    """The weighted squares of the residuals."""
    cost = float(np.sum(((problem.measured - prediction) / sigma) ** 2))
    return cost if np.isfinite(cost) else np.inf


def _judged(
    problem: Problem, theta: Array, jacobian: Array, simulated: Array, sigma: Array
) -> Estimate:
    from scipy import stats

    information = _information(jacobian, sigma)
    covariance, correlation, condition = _inverse(information, _scale(problem, theta))
    scores = _scores(problem, jacobian, simulated, sigma)
    count = len(scores)
    robust = covariance @ (scores.T @ scores) @ covariance * count / max(1, count - 1)
    error = np.sqrt(np.maximum(np.diag(robust), np.diag(covariance)))
    half = stats.t.ppf(0.975, max(1, count - 1)) * error
    influence = np.einsum("pq,qnc->pnc", covariance, jacobian / sigma)
    # (C,) weighted squares of the residuals that the noise does not explain.
    unexplained = np.maximum(1.0 - (NOISE_MARGIN * problem.noise / sigma) ** 2, 0.0)
    lacking = np.sqrt(np.sum(influence**2, axis=1) @ (len(problem.measured) * unexplained))
    lacking *= 2.0 / np.sqrt(DIRECTIONS)
    low, high = theta - half, theta + half
    return Estimate(
        theta, low, high, correlation, condition, sigma, simulated, jacobian, covariance, lacking
    )


def _scores(problem: Problem, jacobian: Array, simulated: Array, sigma: Array) -> Array:
    """(blocks, P): the sums of J^T W e over each block."""
    residual = (problem.measured - simulated) / sigma**2
    each = np.einsum("pnc,nc->np", jacobian, residual)
    numbers, at = np.unique(problem.blocks, return_inverse=True)
    scores = np.zeros((len(numbers), len(jacobian)))
    np.add.at(scores, at, each)
    return scores
