"""Examples in docstrings run, and say what they say they say."""

from __future__ import annotations

import doctest
import importlib
import re
from pathlib import Path

import assetbuild

PACKAGE = Path(assetbuild.__file__).parent


def test_examples_in_docstrings_are_true():
    tried = 0
    for path in PACKAGE.rglob("*.py"):
        if re.search(r"^ +>>> ", path.read_text(encoding="utf-8"), re.MULTILINE):
            name = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
            done = doctest.testmod(importlib.import_module(name))
            assert done.failed == 0, name
            tried += done.attempted
    assert tried >= 7
