"""Python modules: their syntax trees; docstrings and layout mean nothing."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path

from assetbuild.facts.again.row import NotParsedError
from assetbuild.facts.again.tree import Node

UNWRAPPED = (ast.Return, ast.Expr, ast.Assign, ast.keyword)
"""Nodes that are their value, under a name that says the rest."""


def python_tree(path: Path) -> Node:
    """Statements by their names, calls by their keywords, dictionaries by their keys."""
    try:
        module = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError) as error:
        line = error.lineno or 0 if isinstance(error, SyntaxError) else 0
        raise NotParsedError(f"not readable as Python: {error}", line) from None
    return Node(None, _block(module.body, ""), 0, ("module", ""), ordered=True)


def _block(statements: Sequence[ast.stmt], inside: str) -> dict[str, Node]:
    """Statements by their names; those without one by their order. inside: name of the class."""
    parts: dict[str, Node] = {}
    for number, statement in enumerate(one for one in statements if not _is_docstring(one)):
        kind, name = _named(statement)
        subject = (kind, f"{inside}{name}") if kind else None
        key = name if name and name not in parts else f"{type(statement).__name__.lower()} {number}"
        parts[key] = _node(statement, subject, inside)
    return parts


def _named(statement: ast.stmt) -> tuple[str, str]:
    """(kind, name) of a statement."""
    match statement:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
            return "function", name
        case ast.ClassDef(name=name):
            return "class", name
        case ast.Assign(targets=[target]) | ast.AnnAssign(target=target):
            return "constant", ast.unparse(target)
        case ast.Return():
            return "", "return"
    return "", ""


def _is_docstring(statement: ast.stmt) -> bool:
    value = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def _node(node: ast.AST, subject: tuple[str, str] | None = None, inside: str = "") -> Node:
    line = int(getattr(node, "lineno", 0))
    if isinstance(node, UNWRAPPED) and node.value is not None:
        value = _node(node.value)
        return Node(value.value, value.parts, line, subject)
    literal = _literal(node)
    if literal is not None:
        return Node(literal, {}, line, subject)
    if isinstance(node, ast.Name | ast.Attribute):
        return Node(ast.unparse(node), {}, line, subject)
    kind = None if isinstance(node, ast.Call) else type(node).__name__
    is_block = isinstance(node, ast.stmt)
    return Node(kind, _parts(node, inside), line, subject, ordered=is_block)


def _literal(node: ast.AST) -> object:
    """A number, a text or a truth that stands there as such, and `None` as its name."""
    try:
        value = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError):
        return None
    return value if isinstance(value, bool | int | float | str) else None


def _parts(node: ast.AST, inside: str) -> dict[str, Node]:
    match node:
        case ast.Call():
            named = {word.arg or "**": _node(word) for word in node.keywords}
            return {"call": _node(node.func), **_items(node.args), **named}
        case ast.Dict():
            pairs = zip(node.keys, node.values, strict=True)
            return {f"[{ast.unparse(k)}]" if k else "**": _node(v) for k, v in pairs}
        case ast.Tuple() | ast.List() | ast.Set():
            return _items(node.elts)
    parts: dict[str, Node] = {}
    for name, value in ast.iter_fields(node):
        if name in ("body", "orelse", "finalbody") and isinstance(value, list):
            parts |= _block(value, inside)
        elif isinstance(value, ast.AST):
            parts[name] = _node(value)
        elif isinstance(value, list) and value:
            parts[name] = Node(None, _items(value))
        elif value is not None:
            parts[name] = Node(str(value))
    return parts


def _items(nodes: Sequence[object]) -> dict[str, Node]:
    return {
        f"[{index}]": _node(node) if isinstance(node, ast.AST) else Node(str(node))
        for index, node in enumerate(nodes)
    }
