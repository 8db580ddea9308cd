"""Each test file opens with a sentence that says what of the program it holds."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
FILES = sorted(str(path.relative_to(TESTS)) for path in TESTS.rglob("test_*.py"))


def opening(text: str) -> str | None:
    """The first line of a module's docstring; None where there is none."""
    told = ast.get_docstring(ast.parse(text))
    return told.splitlines()[0] if told else None


@pytest.mark.parametrize("file", FILES)
def test_each_test_file_opens_with_a_sentence(file: str):
    said = opening((TESTS / file).read_text(encoding="utf-8"))
    assert said, f"tests/{file} has no docstring: say in a sentence what it tests"
    assert len(said.split()) > 2, f"tests/{file}: `{said}` is no sentence"


def test_a_file_without_one_is_found():
    assert opening("import numpy\n") is None
