"""The fit on problems whose answers are known: exact, honest about coloured noise, sceptical."""

import numpy as np
import pytest

from assetbuild.identify.estimate import Problem, estimate


def line(noise, seed=0, twin=False, samples=2000):
    """y = a x1 + b x2 (+ c x2 again, which nobody can tell from b); truth 2, -1."""
    random = np.random.default_rng(seed)
    t = np.arange(samples) / 100.0
    x = np.stack([np.sin(t), np.cos(3 * t)] + [np.cos(3 * t)] * twin)
    e = noise(random, samples)
    measured = (2.0 * x[0] - 1.0 * x[1] + e)[:, None]
    count = len(x)
    return Problem(
        simulate=lambda vectors: np.stack([(v @ x)[:, None] for v in vectors]),
        measured=measured,
        blocks=(t // 1.0).astype(int),
        start=np.zeros(count),
        lower=np.full(count, -np.inf),
        steps=np.full(count, 1e-3),
        parts=(frozenset({0}),) * count,
        noise=np.array([0.1]),
    )


def white(random, samples):
    return random.normal(0.0, 0.1, samples)


def coloured(random, samples):
    """A first-order process that forgets within 0.2 s."""
    e = np.zeros(samples)
    for n in range(1, samples):
        e[n] = 0.95 * e[n - 1] + random.normal(0.0, 0.03)
    return e


def test_a_record_without_noise_gives_the_truth():
    found = estimate(line(lambda random, samples: np.zeros(samples)))
    assert found.theta == pytest.approx([2.0, -1.0], abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [white, coloured])
def test_nineteen_of_twenty_intervals_hold_the_truth_also_in_coloured_noise(noise):
    held = []
    for seed in range(150):
        found = estimate(line(noise, seed))
        held += [low <= true <= high for low, true, high in
                 zip(found.low, (2.0, -1.0), found.high, strict=True)]  # fmt: skip
    assert np.mean(held) > 0.91


def test_two_parameters_that_do_the_same_are_correlated_and_have_wide_intervals():
    found = estimate(line(white, twin=True))
    assert abs(found.correlation[1, 2]) > 0.99
    assert found.high[1] - found.low[1] > 1.0
    assert found.high[0] - found.low[0] < 0.05


def test_a_bound_holds():
    problem = line(white)
    bounded = Problem(**{**vars(problem), "lower": np.array([0.0, 0.0])})
    assert estimate(bounded).theta[1] == 0.0


def test_parameters_of_disjoint_parts_share_a_simulation():
    asked = []

    def simulate(vectors):
        asked.append(len(vectors))
        return np.stack([np.stack([v[0] * np.ones(50), v[1] * np.ones(50)], 1) for v in vectors])

    problem = Problem(
        simulate,
        np.ones((50, 2)),
        np.arange(50) // 5,
        np.zeros(2),
        np.zeros(2),
        np.full(2, 1e-3),
        (frozenset({0}), frozenset({1})),
        np.ones(2),
    )
    assert estimate(problem).theta == pytest.approx([1.0, 1.0], abs=1e-5)
    assert set(asked) == {1}


def test_a_residual_above_the_noise_of_the_sensors_widens_the_intervals():
    quiet = line(white)
    doubtful = Problem(**{**vars(quiet), "noise": np.array([0.01])})
    narrow, wide = (estimate(problem) for problem in (quiet, doubtful))
    assert np.all(wide.lacking > 2.0 * (narrow.high - narrow.low))
    assert np.all(narrow.lacking == 0.0)
