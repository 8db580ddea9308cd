"""What the repository says of itself is so: openings of tests, named faults, examples in docs."""

from __future__ import annotations

import ast
import doctest
import importlib
import re
from pathlib import Path

import assetbuild

TESTS = Path(__file__).parents[1]
PACKAGE = TESTS.parent / "assetbuild"
FILES = sorted(str(path.relative_to(TESTS)) for path in TESTS.rglob("test_*.py"))


def opening(text: str) -> str | None:
    """The first line of a module's docstring; None where there is none."""
    told = ast.get_docstring(ast.parse(text))
    return told.splitlines()[0] if told else None


def test_each_test_file_opens_with_a_sentence():
    for file in FILES:
        said = opening((TESTS / file).read_text(encoding="utf-8"))
        assert said, f"tests/{file} has no docstring: say in a sentence what it tests"
        assert len(said.split()) > 2, f"tests/{file}: `{said}` is no sentence"


def test_a_file_without_one_is_found():
    assert opening("import numpy\n") is None


BESIDE_THE_ROOMS = {"contracts", "corpus", "docs", "mutations", "writers"}
"""Folders of tests that are about more than one room."""


def test_the_folders_of_tests_are_the_rooms_of_the_package():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    tested = {path.parent.name for path in TESTS.glob("*/test_*.py")}
    assert tested <= rooms | BESIDE_THE_ROOMS


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


OURS = Path(assetbuild.__file__).parent


def test_examples_in_docstrings_are_true():
    tried = 0
    for path in OURS.rglob("*.py"):
        if re.search(r"^ +>>> ", path.read_text(encoding="utf-8"), re.MULTILINE):
            name = ".".join(path.relative_to(OURS.parent).with_suffix("").parts)
            done = doctest.testmod(importlib.import_module(name))
            assert done.failed == 0, name
            tried += done.attempted
    assert tried >= 7
