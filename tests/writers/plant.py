"""One small bug in one file of Python, of a kind that people write: a sign, an index, a swap."""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip
Change = Callable[[ast.AST], ast.AST | None]


@dataclass(frozen=True)
class Bug:
    """The `index`th place of a file where a bug of one kind can be planted.

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
    found = []
    for kind, change in KINDS.items():
        places = [node for node in _meant(tree) if change(copy.deepcopy(node)) is not None]
        for index, node in enumerate(places):
            text = ast.unparse(node).splitlines()[0][:70]
            found.append(Bug(file, kind, index, getattr(node, "lineno", 0), text))
    return found


def planted(package: Path, bug: Bug) -> str:
    """The file's text with the bug."""
    tree = ast.parse((package / bug.file).read_text(encoding="utf-8"))
    change = KINDS[bug.kind]
    places = [node for node in _meant(tree) if change(copy.deepcopy(node)) is not None]
    old = places[bug.index]
    new = change(copy.deepcopy(old))
    assert new is not None
    return ast.unparse(ast.fix_missing_locations(_Put(old, new).visit(tree)))


class _Put(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self.new if node is self.old else super().visit(node)


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


# --- kinds of bugs: what stands in the place of a node, None where it has none --------------------


def _sign(node: ast.AST) -> ast.AST | None:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return node.operand
    return None


def _operator(node: ast.AST) -> ast.AST | None:
    other = OPERATORS.get(type(node.op)) if isinstance(node, ast.BinOp) else None
    if isinstance(node, ast.BinOp) and other is not None:
        node.op = other()
        return node
    return None


def _constant(node: ast.AST) -> ast.AST | None:
    if isinstance(node, ast.Constant) and type(node.value) is float:
        node.value = node.value * 1.5 + 0.25
        return node
    return None


def _index(node: ast.AST) -> ast.AST | None:
    at = node.slice if isinstance(node, ast.Subscript) else None
    if isinstance(at, ast.Constant) and type(at.value) is int:
        at.value += -1 if at.value > 0 else 1
        return node
    return None


def _flag(node: ast.AST) -> ast.AST | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        node.value = not node.value
        return node
    return None


def _condition(node: ast.AST) -> ast.AST | None:
    if isinstance(node, ast.If | ast.IfExp):
        node.test = ast.UnaryOp(ast.Not(), node.test)
        return node
    return None


def _swapped(node: ast.AST) -> ast.AST | None:
    plain = isinstance(node, ast.Call) and len(node.args) > 1
    if plain and isinstance(node, ast.Call) and not isinstance(node.args[1], ast.Starred):
        node.args[0], node.args[1] = node.args[1], node.args[0]
        return node
    return None


def _dropped(node: ast.AST) -> ast.AST | None:
    stores = isinstance(node, ast.AugAssign) or (
        isinstance(node, ast.Assign) and not isinstance(node.targets[0], ast.Name | ast.Tuple)
    )
    calls = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    return ast.Pass() if stores or calls else None


KINDS: dict[str, Change] = {
    "sign": _sign, "operator": _operator, "constant": _constant, "index": _index,
    "flag": _flag, "condition": _condition, "swapped arguments": _swapped,
    "dropped store": _dropped,
}  # fmt: skip
