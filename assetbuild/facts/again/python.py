"""Python modules: paths in the syntax tree; docstrings and layout mean nothing."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from assetbuild.facts.again.row import LONGEST, NotParsedError, Row, same_number
from assetbuild.facts.table import Value

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class _At:
    """A place. kind, name: the named statement around it; path: from there."""

    kind: str
    name: str
    path: str = ""

    def __truediv__(self, part: str) -> _At:
        return _At(self.kind, self.name, f"{self.path} {part}".strip())

    def __matmul__(self, index: str) -> _At:
        return _At(self.kind, self.name, f"{self.path}[{index}]")


def python_rows(again: bytes, there: bytes) -> list[Row]:
    """What two modules say differently."""
    module = _At("module", "")
    return list(_block(_parsed(again).body, _parsed(there).body, module))


def _parsed(data: bytes) -> ast.Module:
    try:
        return ast.parse(data)
    except (SyntaxError, ValueError) as error:
        line = error.lineno or 0 if isinstance(error, SyntaxError) else 0
        raise NotParsedError(f"not readable as Python: {error}", line) from None


def _block(again: Sequence[ast.stmt], there: Sequence[ast.stmt], at: _At) -> Iterator[Row]:
    """Statements by their names; those without one by their order."""
    ours, theirs = _by_name(again, at), _by_name(there, at)
    for key in dict.fromkeys((*ours, *theirs)):
        one, other = ours.get(key), theirs.get(key)
        if one is None or other is None:
            yield _one_sided(one, other, key)
        else:
            yield from _nodes(one, other, key)
    if list(ours) != list(theirs) and ours.keys() == theirs.keys():
        names = [", ".join(str(key.name or key.path) for key in some) for some in (ours, theirs)]
        yield _row(at / "order", names[0], names[1])


def _one_sided(one: ast.stmt | None, other: ast.stmt | None, at: _At) -> Row:
    if other is not None:
        return _row(at / "extra", None, _text(other), other.lineno)
    return _row(at / "missing", _text(one) if one else None, None)


def _by_name(block: Sequence[ast.stmt], at: _At) -> dict[_At, ast.stmt]:
    found: dict[_At, ast.stmt] = {}
    for number, statement in enumerate(one for one in block if not _is_docstring(one)):
        key = _named(statement, at)
        found[key if key and key not in found else at / _word(statement, number)] = statement
    return found


def _named(statement: ast.stmt, at: _At) -> _At | None:
    """The place of a statement that has a name of its own."""
    inside = f"{at.name}." if at.name else ""
    match statement:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
            return _At("function", inside + name)
        case ast.ClassDef(name=name):
            return _At("class", inside + name)
        case ast.Assign(targets=[target]) | ast.AnnAssign(target=target):
            # Inside a function it is a step, not a thing of its own.
            name = ast.unparse(target)
            return at / name if at.kind == "function" else _At("constant", inside + name)
    return None


def _word(statement: ast.stmt, number: int) -> str:
    """What a statement without a name is called: `return`, or `if 3`, the fourth of its block."""
    word = type(statement).__name__.lower()
    return word if isinstance(statement, ast.Return) else f"{word} {number}"


def _is_docstring(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def _nodes(again: ast.AST, there: ast.AST, at: _At) -> Iterator[Row]:
    if ast.dump(again) == ast.dump(there):
        return
    one, other = _literal(again), _literal(there)
    if one is not None and other is not None:
        if not _same(one, other):
            yield _row(at, one, other, _line(there))
    elif type(again) is not type(there):
        yield _row(at, _text(again), _text(there), _line(there))
    else:
        yield from _fields(again, there, at)


def _fields(again: ast.AST, there: ast.AST, at: _At) -> Iterator[Row]:
    """Nodes of one type: calls by their keywords, dictionaries by their keys, else by field."""
    if isinstance(again, ast.Dict) and isinstance(there, ast.Dict):
        ours, theirs = _entries(again), _entries(there)
    elif isinstance(again, ast.Call) and isinstance(there, ast.Call):
        yield from _nodes(again.func, there.func, at / "call")
        ours, theirs = _arguments(again), _arguments(there)
    elif isinstance(again, ast.Tuple | ast.List | ast.Set):
        ours, theirs = _items(again.elts), _items(getattr(there, "elts", ()))
    else:
        yield from _plain_fields(again, there, at)
        return
    for key in dict.fromkeys((*ours, *theirs)):
        one, other = ours.get(key), theirs.get(key)
        place = at @ key[1:-1] if key.startswith("[") else at / key
        if one is None or other is None:
            line = _line(other or there)
            yield _row(place, _text(one) if one else None, _text(other) if other else None, line)
        else:
            yield from _nodes(one, other, place)


def _plain_fields(again: ast.AST, there: ast.AST, at: _At) -> Iterator[Row]:
    for field in again._fields:
        one, other = getattr(again, field, None), getattr(there, field, None)
        if isinstance(one, ast.AST) and isinstance(other, ast.AST):
            yield from _nodes(one, other, at)
        elif field in ("body", "orelse", "finalbody") and isinstance(one, list):
            yield from _block(one, other or [], at)
        elif _dumped(one) != _dumped(other):
            yield _row(at / field, _text(again), _text(there), _line(there))


def _entries(node: ast.Dict) -> dict[str, ast.AST]:
    pairs = zip(node.keys, node.values, strict=True)
    return {f"[{ast.unparse(key)}]" if key else "**": value for key, value in pairs}


def _arguments(node: ast.Call) -> dict[str, ast.AST]:
    keywords = {keyword.arg or "**": keyword.value for keyword in node.keywords}
    return {**_items(node.args), **keywords}


def _items(nodes: Sequence[ast.AST]) -> dict[str, ast.AST]:
    return {f"[{index}]": node for index, node in enumerate(nodes)}


def _literal(node: ast.AST) -> bool | float | str | None:
    """A number, text or truth that stands there as such."""
    try:
        value = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError):
        return None
    return value if isinstance(value, bool | int | float | str) else None


def _same(one: bool | float | str, other: bool | float | str) -> bool:
    if type(one) is not type(other):
        return False
    if isinstance(one, bool | str) or isinstance(other, bool | str):
        return one == other
    return same_number(one, other)


def _dumped(value: object) -> str:
    if isinstance(value, list):
        return " ".join(map(_dumped, value))
    return ast.dump(value) if isinstance(value, ast.AST) else repr(value)


def _row(at: _At, expected: Value, found: Value, line: int = 0) -> Row:
    return Row(at.kind, at.name, at.path or "value", expected, found, line)


def _line(node: ast.AST) -> int:
    return int(getattr(node, "lineno", 0))


def _text(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())[:LONGEST]
