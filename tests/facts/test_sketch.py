"""A sketch tells which triangle of two meshes differs, whatever their order."""

from __future__ import annotations

import numpy as np
import pytest

from assetbuild.facts.sketch import sketch_of, told

DRAWN = np.random.default_rng(0)
CORNERS = DRAWN.normal(size=(3000, 3, 3)).astype(np.float32)
UV, NORMALS = DRAWN.normal(size=(3000, 3, 2)), DRAWN.normal(size=(3000, 3, 3))


def text(corners: np.ndarray) -> str:
    return " ".join("(" + " ".join(f"{v:.6g}" for v in corner) + ")" for corner in corners)


def test_the_order_of_triangles_means_nothing():
    order = DRAWN.permutation(len(CORNERS))
    one = sketch_of(CORNERS, UV, NORMALS)
    assert sketch_of(CORNERS[order], UV[order], NORMALS[order]) == one
    assert sketch_of(np.where(CORNERS == 0.0, -0.0, CORNERS), UV, NORMALS) == one
    assert len(one) < 3000


@pytest.mark.parametrize("index", range(0, 3000, 301))
def test_one_face_turned_over_is_told(index: int):
    other = CORNERS.copy()
    other[index] = other[index, ::-1]
    before, after = told(sketch_of(CORNERS), sketch_of(other))
    assert before != after
    if "one at" in before:
        assert before == f"3,000, one at {text(CORNERS[index])}"
        assert after == f"3,000, one at {text(other[index])}"


def test_of_ten_changes_nearly_all_are_told_with_their_place():
    named = 0
    for index in range(0, 3000, 300):
        other = CORNERS.copy()
        other[index, 1, 2] *= 1.01
        before, after = told(sketch_of(CORNERS), sketch_of(other))
        named += before.endswith(text(CORNERS[index])) and after.endswith(text(other[index]))
    assert named >= 8


def test_a_normal_that_differs_by_a_percent_is_told_at_its_place():
    found = []
    for index in range(8):
        other = NORMALS.copy()
        other[index, 0, 0] *= 1.01
        found.append(told(sketch_of(CORNERS, None, NORMALS), sketch_of(CORNERS, None, other)))
    assert all(before != after for before, after in found)
    assert (
        sum(before.startswith(f"at {text(CORNERS[i])}: ") for i, (before, _) in enumerate(found))
        > 5
    )


def test_other_numbers_of_triangles_and_no_sketch_are_told():
    assert told(sketch_of(CORNERS), sketch_of(CORNERS[1:]))[1].startswith("2,999")
    before, after = told(sketch_of(CORNERS), sketch_of(CORNERS, UV))
    assert (before, after) == ("3000, bare", "3000, with texture coordinates")
    assert told(sketch_of(CORNERS), None)[1] == "none"
    assert told(sketch_of(CORNERS), "unreadable") == ("3000", "none")
    assert sketch_of(CORNERS[:0])
