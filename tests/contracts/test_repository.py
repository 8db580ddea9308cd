"""What the repository says of itself is so: openings of tests, named faults, examples in docs."""

from __future__ import annotations

import doctest
import importlib
import re
from pathlib import Path

from .conftest import PACKAGE

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"


def test_each_test_file_opens_with_a_sentence():
    for file in TESTS.rglob("test_*.py"):
        first = file.read_text(encoding="utf-8").partition("\n")[0]
        assert first.startswith('"""'), f"{file} has no docstring: say in a sentence what it tests"
        assert len(first.split()) > 2, f"{file}: `{first}` is no sentence"


BESIDE_THE_ROOMS = {"contracts", "corpus", "docs", "mutations", "writers"}
"""Folders of tests that are about more than one room."""


def test_the_folders_of_tests_are_the_rooms_of_the_package():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    tested = {path.parent.name for path in TESTS.glob("*/test_*.py")}
    assert tested <= rooms | BESIDE_THE_ROOMS


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
    found = [path for path in PACKAGE.rglob("*.py") if unsafe.search(path.read_text())]
    assert found == []


def test_examples_in_docstrings_are_true():
    tried = 0
    for path in PACKAGE.rglob("*.py"):
        if re.search(r"^ +>>> ", path.read_text(encoding="utf-8"), re.MULTILINE):
            name = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
            done = doctest.testmod(importlib.import_module(name))
            assert done.failed == 0, name
            tried += done.attempted
    assert tried >= 7
