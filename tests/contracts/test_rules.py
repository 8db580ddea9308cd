"""Every rule that the code can name has an entry in the reference, and every entry a rule."""

from __future__ import annotations

import ast
import re
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "assetbuild"
REFERENCE = Path(__file__).parents[2] / "docs" / "reference" / "rules.md"


def named_in_code() -> set[str]:
    """Rule ids and, where a part is computed, their families: `equal.mjcf.*`."""
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.keyword) and node.arg == "rule":
                found |= rule_of(node.value)
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding":
                found |= rule_of(node.args[0]) if node.args else set()
    return found


def rule_of(value: ast.expr) -> set[str]:
    if isinstance(value, ast.Constant) and isinstance(value.value, str):
        return {value.value}
    if isinstance(value, ast.JoinedStr):
        parts = [p.value if isinstance(p, ast.Constant) else "*" for p in value.values]
        return {"".join(map(str, parts))}
    return set()


def documented() -> set[str]:
    return set(re.findall(r"^\| `([a-z_.*]+)` \|", REFERENCE.read_text(encoding="utf-8"), re.M))


def test_every_rule_of_the_code_is_documented():
    known = documented()
    families = {rule.removesuffix("*") for rule in known if rule.endswith("*")}
    missing = {
        rule
        for rule in named_in_code()
        if rule not in known and not any(rule.startswith(family) for family in families)
    }
    assert missing == set()
