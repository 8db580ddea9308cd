"""Our Sobol points are scipy's, number by number."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from assetbuild.mesh.sobol import sobol


@pytest.mark.parametrize("seed", [0, 1, 123456])
@pytest.mark.parametrize("count", [1, 64, 16384])
def test_the_points_are_those_of_scipy(count, seed):
    lower, upper = np.array([-1.0, 0.0, 2.0]), np.array([1.0, 0.5, 7.0])
    theirs = qmc.Sobol(3, scramble=True, rng=np.random.default_rng(seed)).random(count)
    assert np.array_equal(sobol(count, lower, upper, seed), lower + theirs * (upper - lower))
