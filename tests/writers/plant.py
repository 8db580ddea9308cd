"""One small bug in one file of Python, of a kind that people write: a sign, an index, a swap."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Bug:
    """The `index`th bug that can be planted in a file.

    file: below the package. line: of the place. text: what stands there, in short.
    """

    file: str
    kind: str
    index: int
    line: int
    text: str


def bugs(package: Path, file: str) -> list[Bug]:
    """Every bug that can be planted in a file."""
    tree = ast.parse((package / file).read_text(encoding="utf-8"))
    return [
        Bug(file, kind, index, getattr(node, "lineno", 0), ast.unparse(node).splitlines()[0][:70])
        for index, (node, kind, _) in enumerate(_changes(tree))
    ]


def planted(package: Path, bug: Bug) -> str:
    """The file's text with the bug."""
    tree = ast.parse((package / bug.file).read_text(encoding="utf-8"))
    old, _, new = list(_changes(tree))[bug.index]
    return ast.unparse(ast.fix_missing_locations(_Put(old, new).visit(tree)))


class _Put(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self.new if node is self.old else super().visit(node)


def _changes(tree: ast.Module) -> Iterator[tuple[ast.AST, str, ast.AST]]:
    """(node, kind of bug, what stands in its place then) of all that does something."""
    for node in _meant(tree):
        for kind, new in _others(node):
            yield node, kind, new


def _meant(tree: ast.Module) -> Iterator[ast.AST]:
    """Nodes that do something when a function runs: no rules, docstrings or types."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                if not _is_text(statement):
                    yield from _walk(statement)


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """A nested function is walked once, by itself; what an exception says is no writing."""
    if isinstance(node, ast.FunctionDef | ast.Raise | ast.Assert):
        return
    yield node
    skipped = node.annotation if isinstance(node, ast.AnnAssign) else None
    for child in ast.iter_child_nodes(node):
        if child is not skipped:
            yield from _walk(child)


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _others(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Kinds of bugs that a node may have, and the node with each."""
    match node:
        case ast.UnaryOp(ast.USub(), operand):
            yield "sign", operand
        case ast.BinOp(left, op, right) if type(op) in OPERATORS:
            yield "operator", ast.BinOp(left, OPERATORS[type(op)](), right)
        case ast.Constant(bool(value)):
            yield "flag", ast.Constant(not value)
        case ast.Constant(float(value)):
            yield "constant", ast.Constant(value * 1.5 + 0.25)
        case ast.Subscript(value, ast.Constant(int(at)), ctx):
            yield "index", ast.Subscript(value, ast.Constant(at - 1 if at > 0 else at + 1), ctx)
        case ast.If(test) | ast.IfExp(test):
            new = copy.copy(node)
            new.test = ast.UnaryOp(ast.Not(), test)
            yield "condition", new
        case ast.Call(func, [first, second, *rest], words) if not isinstance(second, ast.Starred):
            yield "swapped arguments", ast.Call(func, [second, first, *rest], words)
        case ast.AugAssign() | ast.Expr(ast.Call()):
            yield "dropped store", ast.Pass()
        case ast.Assign([target, *_]) if not isinstance(target, ast.Name | ast.Tuple):
            yield "dropped store", ast.Pass()
