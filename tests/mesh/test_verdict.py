"""What is reported about pieces that were left out or that leave most of a mesh bare."""

from __future__ import annotations

import pytest

from assetbuild.mesh.cover import Reference, measure
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.verdict import verdict
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box

CUBE = Reference(tessellate(Box((1.0, 1.0, 1.0))))


@pytest.mark.parametrize(
    ("width", "flat", "rules"),
    [
        (1.0, 0, []),
        (0.51, 0, []),
        (0.49, 0, ["collision.missing"]),
        (1.0, 2, ["collision.flat_piece"]),
    ],
)
def test_a_slab_of_a_cube_covers_its_width(width: float, flat: int, rules: list[str]):
    """1 m - `width` of the cube's 1 m is missing; half of it is the limit."""
    slab = ConvexPiece(Box((width, 1.0, 1.0)), Pose((width / 2 - 0.5, 0.0, 0.0)))
    quality = measure(CUBE, [slab], flat=flat)
    found = verdict(
        "mesh a", CUBE, [slab], quality,
        how="hull", tolerances={}, places=(), max_hulls=None, usual={},
    )  # fmt: skip
    told = {f.rule: f.data for f in found if f.rule != "collision.gap"}
    assert list(told) == rules
    if flat:
        assert told["collision.flat_piece"] == {"flat": 2, "pieces": 3}
