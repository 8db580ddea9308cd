"""Tolerances are written as people say them."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from assetbuild.pipeline.recipes import collision_rule


@pytest.mark.parametrize(
    ("written", "metres"),
    [("5 mm", 0.005), ("0.5 cm", 0.005), ("0.005 m", 0.005), (0.005, 0.005), ("20um", 2e-5)],
)
def test_a_length_is_in_metres_whatever_its_unit(written, metres):
    assert collision_rule(max_outside=written).max_outside == metres


@pytest.mark.parametrize(("written", "share"), [("2 %", 0.02), ("20%", 0.2), (0.2, 0.2)])
def test_a_share_may_be_percent(written, share):
    assert collision_rule(max_overcover=written).max_overcover == share


@pytest.mark.parametrize("written", ["5 parsec", "5", "mm", "1e5e5 mm", "-5 mm", "2 %", "nan mm"])
def test_another_unit_is_an_error_that_shows_a_right_one(written):
    with pytest.raises(ValidationError) as caught:
        collision_rule(max_outside=written)
    message = str(caught.value)
    assert "`5 mm`" in message or "greater than or equal to 0" in message or "finite" in message


def test_more_missing_than_there_is_cannot_be_asked_for():
    with pytest.raises(ValidationError):
        collision_rule(max_missing="120 %")
