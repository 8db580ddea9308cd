"""Mutations of Python modules: every literal, and every element of a call, list or table."""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator
from pathlib import Path

from tests.mutations.change import Mutation, number_changes, other_text, pools

Container = ast.Tuple | ast.List | ast.Dict | ast.Call


def walk(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """All mutations of one module."""
    nodes = _nodes(ast.parse(path.read_text(encoding="utf-8")))
    names = _names(nodes)
    constants = [(names[n], n.value) for n in nodes if isinstance(n, ast.Constant)]
    texts = pools([(name, value) for name, value in constants if isinstance(value, str)])
    for index, node in enumerate(nodes):
        label = names.get(node, "")
        where = f"line {getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Constant):
            for what, new in _values(node.value, texts.get(label, []), random_):
                key = ("set", index, new)
                yield Mutation(file, where, label, what, repr(node.value), repr(new), key)
        elif isinstance(node, ast.Tuple | ast.List):
            yield from _swaps(node, index, file, where, label)
        if isinstance(node, Container):
            for number, part in enumerate(_parts(node)):
                text, key = ast.unparse(part), ("delete", index, number)
                own = names.get(part, label)
                yield Mutation(file, where, own, "element deleted", text, "", key)


def _swaps(
    node: ast.Tuple | ast.List, index: int, file: str, where: str, label: str
) -> Iterator[Mutation]:
    texts = [ast.unparse(item) for item in node.elts]
    for number in range(1, len(texts)):
        if texts[number] != texts[0]:
            key, before = ("swap", index, number), ast.unparse(node)
            after = f"{texts[number]}, ..., {texts[0]}"
            yield Mutation(file, where, label, "swapped", before, after, key)
            return


def _values(value: object, pool: list[str], random_: random.Random) -> Iterator[tuple[str, object]]:
    if isinstance(value, bool):
        yield "flipped", not value
    elif isinstance(value, int | float):
        yield from number_changes(value).items()
    elif isinstance(value, str):
        yield "another text", other_text(value, pool, random_)
    elif value is None:
        yield "stated", 1.0


def apply(path: Path, key: tuple[object, ...]) -> None:
    """Makes the change of a mutation's key in the file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    what, index, how = key
    node = _nodes(tree)[int(str(index))]
    if what == "set":
        assert isinstance(node, ast.Constant)
        node.value = how  # type: ignore[assignment] # a plain value
    elif what == "swap":
        assert isinstance(node, ast.Tuple | ast.List)
        number = int(str(how))
        node.elts[0], node.elts[number] = node.elts[number], node.elts[0]
    else:
        assert isinstance(node, Container)
        _delete(node, int(str(how)))
    path.write_text(f"{ast.unparse(tree)}\n", encoding="utf-8")


def _parts(node: Container) -> list[ast.AST]:
    if isinstance(node, ast.Dict):
        return list(node.values)
    if isinstance(node, ast.Call):
        return [keyword.value for keyword in node.keywords]
    return list(node.elts)


def _delete(node: Container, number: int) -> None:
    if isinstance(node, ast.Dict):
        del node.keys[number], node.values[number]
    elif isinstance(node, ast.Call):
        del node.keywords[number]
    else:
        del node.elts[number]


def _nodes(tree: ast.Module) -> list[ast.AST]:
    """All nodes but docstrings, in a fixed order."""
    dropped = {
        statement.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
        for statement in node.body
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
    }
    return [node for node in ast.walk(tree) if node not in dropped]


def _names(nodes: list[ast.AST]) -> dict[ast.AST, str]:
    """Node -> the keyword, key or variable that it is the value of, through lists and tables."""
    names: dict[ast.AST, str] = {}
    for node in nodes:  # parents first
        for child in ast.iter_child_nodes(node):
            names[child] = names.get(node, "")
        if isinstance(node, ast.keyword):
            names[node.value] = node.arg or ""
        elif isinstance(node, ast.Dict):
            _name_entries(node, names)
        elif isinstance(node, ast.Assign):
            names[node.value] = ast.unparse(node.targets[0])
        elif isinstance(node, ast.FunctionDef):
            names |= dict.fromkeys((*node.args.defaults, *node.args.kw_defaults), node.name)  # type: ignore[arg-type] # None is harmless
    return names


def _name_entries(node: ast.Dict, names: dict[ast.AST, str]) -> None:
    own = names.get(node, "")
    for key, value in zip(node.keys, node.values, strict=True):
        if key is None:
            continue
        text = key.value if isinstance(key, ast.Constant) else ""
        plain = isinstance(text, str) and text.isidentifier() and "joint" not in text
        names[key] = f"{own} key"
        names[value] = str(text) if plain else own
