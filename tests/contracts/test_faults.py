"""The list of faults names tests that exist; nothing is ever unpickled."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "tests/faults/faults.md"


def test_every_test_that_the_page_names_exists():
    named = re.findall(r"`(tests/[\w/.]+)::(\w+)`", PAGE.read_text())
    assert len(named) > 50
    for file, name in named:
        assert f"def {name}(" in (ROOT / file).read_text(), f"{file}::{name}"


def test_the_page_has_every_fault_and_names_a_test_or_a_reason():
    rows = re.findall(r"^\| (F\d+) \| (.+) \| (.*) \| (.*) \|$", PAGE.read_text(), re.MULTILINE)
    assert [row[0] for row in rows] == [f"F{n}" for n in range(1, 31)]
    assert all(tests or gap for _, _, tests, gap in rows)


def test_nothing_is_ever_unpickled():
    unsafe = re.compile(
        r"^\s*(import|from) (pickle|marshal|shelve|dill|joblib|cloudpickle)\b|allow_pickle=True",
        re.MULTILINE,
    )
    found = [p for p in (ROOT / "assetbuild").rglob("*.py") if unsafe.search(p.read_text())]
    assert found == []
