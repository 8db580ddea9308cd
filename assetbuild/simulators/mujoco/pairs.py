"""Which shapes of a compiled MuJoCo model may touch each other."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator

import numpy as np

from assetbuild.simulators.mujoco import Model, mj


def passes(model: Model, a: int, b: int) -> bool:
    """Whether MuJoCo lets two bodies (by number) pass through each other by its own rule.

    One rigid piece never touches itself, and neither do parent and child, unless the parent is
    part of the world or the model switches that filter off.
    """
    weld_a, weld_b = int(model.body_weldid[a]), int(model.body_weldid[b])
    if weld_a == weld_b:
        return True
    if model.opt.disableflags & mj.mjtDisableBit.mjDSBL_FILTERPARENT or 0 in (weld_a, weld_b):
        return False
    above_a = int(model.body_weldid[model.body_parentid[weld_a]])
    above_b = int(model.body_weldid[model.body_parentid[weld_b]])
    return weld_a == above_b or weld_b == above_a


def touching_geoms(model: Model) -> Iterator[tuple[int, int]]:
    """Pairs of geoms that masks, excludes and MuJoCo's own filter let touch."""
    excluded = set(np.asarray(model.exclude_signature).tolist())
    kinds, others, bodies = (
        np.asarray(column).tolist()
        for column in (model.geom_contype, model.geom_conaffinity, model.geom_bodyid)
    )
    apart = functools.cache(functools.partial(passes, model))
    for a, b in itertools.combinations([i for i in range(model.ngeom) if kinds[i] or others[i]], 2):
        first, second = sorted((bodies[a], bodies[b]))
        meets = kinds[a] & others[b] or kinds[b] & others[a]
        if meets and (first << 16) + second not in excluded and not apart(first, second):
            yield a, b


def explicit_pairs(model: Model) -> Iterator[tuple[int, int]]:
    """Pairs of geoms that touch whatever filters say: the elements `<pair>`."""
    for index in range(model.npair):
        yield int(model.pair_geom1[index]), int(model.pair_geom2[index])
