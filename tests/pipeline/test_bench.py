"""Which levels of collision geometry no other one beats."""

from __future__ import annotations

from assetbuild.cli.bench import front


def test_what_another_beats_in_both_is_not_on_the_front():
    points = {"hull": (4e4, 0.5), "good": (2e4, 0.9), "bad": (1.5e4, 0.8), "slow": (5e3, 0.9)}
    assert front(points) == {"hull", "good"}
    assert front({"a": (1.0, 1.0), "b": (1.0, 1.0)}) == {"a", "b"}
