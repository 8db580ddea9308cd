"""Turns that no native engineer writes are found in the code and in the pages."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
BANNED = {
    r"\bas ever\b": "say what overrides what",
    r"\bskipped aloud\b": "skipped, and the report says so",
    r"\btaken? .{0,12}by (its|their) word\b": "taken literally",
    r"\b[Tt]old by\b": "reported by",
    r"\bthat is no news\b": "delete it",
    r"\b[Oo]f its node\b(?<!label of its node)": "return the ... of its node",
    r"\bsunflower\b": "points of a Fibonacci sphere",
    r"\bas its recipe wins\b": "the part's recipe overrides",
    r"\bfor_the_eye\b|\b_papered\b": "a name from the field: `visual_only`",
}
"""Pattern -> what to write."""


def test_a_banned_turn_stands_nowhere():
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]
    banned = re.compile("|".join(BANNED))
    found = [
        f"{file.relative_to(ROOT)}:{number}: {line.strip()}"
        for file in sorted([*(ROOT / "assetbuild").rglob("*.py"), *pages])
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        if banned.search(line)
    ]
    assert not found, "\n".join([*found, "write instead:", *map(": ".join, BANNED.items())])
