"""Every single change of a Python module that could change what it does."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from assetbuild.facts.reader import Proof


def literals(text: str) -> Iterator[tuple[str, str]]:
    """(what was changed, text) for each literal that is no documentation."""
    tree = ast.parse(text)
    silent = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in list(ast.walk(tree)):
        if isinstance(node, ast.Constant) and id(node) not in silent:
            yield _changed(tree, node, "value", _other(node.value))


def names(text: str) -> Iterator[tuple[str, str]]:
    """(what was changed, text) for each name, attribute and keyword."""
    tree = ast.parse(text)
    for node in list(ast.walk(tree)):
        for part in ("id", "attr", "arg", "name"):
            said = getattr(node, part, None)
            if isinstance(said, str):
                yield _changed(tree, node, part, f"{said}x")


def _changed(tree: ast.Module, node: ast.AST, part: str, value: object) -> tuple[str, str]:
    before = getattr(node, part)
    setattr(node, part, value)
    text = ast.unparse(tree)
    setattr(node, part, before)
    return f"line {getattr(node, 'lineno', 0)}: {before!r} -> {value!r}", text


def _other(value: object) -> object:
    """One per cent more of a number."""
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return value * 1.01 if value else 0.01
        case str():
            return f"{value}x"
    return 1


def is_found(proof: Proof) -> bool:
    """Whether a finding names the subject, the quantity and both values."""
    return any(
        f.subject and ({"expected", "found"} <= set(f.data or ()) or "attribute" in (f.data or ()))
        for f in proof.findings
    )
