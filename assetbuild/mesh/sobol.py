"""Points that fill a box evenly, the same on every machine: a scrambled Sobol sequence.

Direction numbers of S. Joe and F. Y. Kuo (2008), scrambled by J. Matousek's linear matrices and a
digital shift (1998): number by number what `scipy.stats.qmc.Sobol` gives, whose import takes
longer than most robots' collision geometry.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from assetbuild.robot.pose import Array

Numbers = NDArray[np.uint32]

BITS = 30
BIT = np.arange(BITS, dtype=np.uint32)


def sobol(count: int, lower: Array, upper: Array, seed: int = 0) -> Array:
    """(count, 3) scrambled Sobol points in a box; count: a power of two."""
    return np.asarray(lower + _unit_points(count, seed) * (upper - lower), dtype=np.float64)


@lru_cache(4)
def _unit_points(count: int, seed: int) -> Array:
    """(count, 3) in [0, 1)."""
    random = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    shift = random.integers(2, size=(3, BITS), dtype=np.uint32) @ (np.uint32(1) << BIT)
    lower = np.tril(random.integers(2, size=(3, BITS, BITS), dtype=np.uint32))
    lower[:, BIT, BIT] = 1
    digits = _directions()[:, None, :] >> BIT[::-1, None] & np.uint32(1)  # the highest come first
    scrambled = lower @ digits % 2
    directions = (np.uint32(1) << BIT[::-1]) @ scrambled
    index = np.arange(count, dtype=np.uint32)
    gray = index ^ (index >> np.uint32(1))
    numbers = np.tile(shift, (count, 1))
    for bit in range(count.bit_length()):
        chosen = gray >> np.uint32(bit) & np.uint32(1)
        numbers ^= chosen[:, None] * directions[:, bit]
    return numbers / 2.0**BITS


def _directions() -> Numbers:
    """(3, 30) direction numbers; in the third dimension of the polynomial x^2 + x + 1."""
    found: Numbers = np.ones((3, BITS), dtype=np.uint32)
    found[2, 1] = 3
    for n in range(1, BITS):
        found[1, n] = found[1, n - 1] ^ found[1, n - 1] << np.uint32(1)
    for n in range(2, BITS):
        one, two = found[2, n - 1], found[2, n - 2]
        found[2, n] = two ^ one << np.uint32(1) ^ two << np.uint32(2)
    return found << BIT[::-1]
