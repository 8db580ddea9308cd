"""A step that makes other bytes of the same inputs has another `version` (design: CI table)."""

from __future__ import annotations

import pytest

from .digests import build, outdated, read_table, unraised

Rows = dict[str, dict]


@pytest.fixture(scope="module")
def now(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    return build(tmp_path_factory.mktemp("digests"))


def test_no_step_makes_other_bytes_under_its_old_version(now: Rows):
    wrong = unraised(read_table(), now)
    assert not wrong, f"raise the `version` of the steps behind {wrong}"


def test_the_table_knows_the_steps_as_they_are(now: Rows):
    old = outdated(read_table(), now)
    assert not old, f"renew the table for {old}: python -m tests.contracts.digests"


def row(key: str, output: str, tools: str = "1") -> dict:
    return {"key": key, "tools": {"t": tools}, "platform": "p", "outputs": {"out": output}}


def test_what_counts_as_what():
    table = {"it": row("k", "a")}
    assert unraised(table, {"it": row("k", "b")}) == ["it"]
    assert unraised(table, {"it": row("raised", "b")}) == []
    assert outdated(table, {"it": row("raised", "b")}) == ["it"]
    assert outdated(table, {"it": row("newer library", "b", tools="2")}) == []
    assert outdated(table, {"it": row("k", "a"), "new": row("n", "c")}) == ["new"]
    assert outdated(table, {"it": row("k", "a")}) == []


def test_steps_with_and_without_a_process_of_their_own_are_in_it(now: Rows):
    assert {"read_urdf", "merge_fixed_joints", "urdf", "mjcf", "usd"} <= now.keys()
