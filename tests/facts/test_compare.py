"""The comparison of two tables: what rounding explains, and what it does not."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from assetbuild.facts.compare import EXACT, FLOAT32, Precision, differences
from assetbuild.facts.surface import measure
from assetbuild.facts.table import Key, Table
from assetbuild.facts.vocabulary import Comparison
from assetbuild.robot.pose import Array, Pose

STEP_M, ROWS = 3e-4, 150


def far_grille() -> Array:
    """(n, 3, 3) corners of many small triangles that lean, 26 cm from the origin, m."""
    u, v = np.meshgrid(np.arange(ROWS) * STEP_M, np.arange(ROWS) * STEP_M, indexing="ij")
    x = 0.26 + STEP_M * (np.arange(ROWS)[:, None] % 2)
    points = np.stack([np.broadcast_to(x, u.shape), u, v], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)


def table_of(corners: Array) -> Table:
    facts = measure(corners).facts()
    return Table({Key("shape", "grille", quantity): value for quantity, value in facts.items()})


def test_small_triangles_far_out_keep_their_area_when_rounded_to_float32() -> None:
    exact, rounded = far_grille(), far_grille().astype(np.float32).astype(np.float64)
    relative = measure(rounded).area / measure(exact).area - 1.0
    assert abs(relative) > 10.0 * FLOAT32["length"]  # rounding is not small here
    assert differences(table_of(exact), table_of(rounded), Precision(FLOAT32)) == []


@pytest.mark.parametrize("tolerances", [EXACT, FLOAT32])
def test_an_area_off_by_a_thousandth_is_found(tolerances: Mapping[Comparison, float]) -> None:
    exact = table_of(far_grille())
    area = Key("shape", "grille", "area")
    more = (1.001 * measure(far_grille()).area,)
    (found,) = differences(exact, Table({**exact.facts, area: more}), Precision(tolerances))
    assert found.key == area


def test_a_part_drawn_far_from_the_origin_of_its_file_is_the_same_in_float32() -> None:
    """A cap of 0.3 mm, 0.37 m from the origin of its file and 0.3 mm from that of its body."""
    rng = np.random.default_rng(4)
    corners = rng.uniform(-1.5e-4, 1.5e-4, (40, 3, 3)) + np.array((0.3, 0.2, 0.1))
    back = Pose((-0.3003, -0.2, -0.1))
    exact, rounded = (
        measure(points).moved(back)
        for points in (corners, corners.astype(np.float32).astype(np.float64))
    )
    tables = [
        Table({Key("shape", "cap", q): v for q, v in one.facts().items()})
        for one in (exact, rounded)
    ]
    assert differences(*tables, Precision(FLOAT32)) == []
    size = 1.5e-4
    moved = Key("shape", "cap", "mean corner")
    off = tuple(v + 1e-2 * size for v in tables[1].facts[moved])  # type: ignore[union-attr] # a vector
    assert differences(tables[0], Table({**tables[1].facts, moved: off}), Precision(FLOAT32))
