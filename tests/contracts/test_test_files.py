"""Each test file opens with a sentence that says what of the program it holds."""

from __future__ import annotations

import ast
from pathlib import Path

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
