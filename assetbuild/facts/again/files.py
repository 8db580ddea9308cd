"""The comparer of a file, by its ending; those of Python, YAML, JSON, meshes and pictures."""

from __future__ import annotations

import ast
import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.errors import StepError
from assetbuild.facts.again.tree import Node, NotParsedError, Row, Words, same, tree_rows
from assetbuild.facts.again.xml import root_of, xml_rows
from assetbuild.facts.plain_yaml import plain_loader
from assetbuild.mesh.obj import parse_obj


def rows_of(again: Path, there: Path, stages: tuple[Path, ...] = ()) -> list[Row]:
    """What two files say differently; none where they mean the same. NotParsedError.

    Each lies in a folder of its own, among the same other files. stages: the files of USD that a
    layer may be part of, in the folder of `again`.
    """
    ending = there.suffix.lower()
    if ending in (".usda", ".usdc", ".usd"):
        from assetbuild.facts.again.usd import usd_rows  # pxr takes a second, which only USD needs

        roots = tuple(os.path.relpath(stage, again.parent) for stage in stages)
        return usd_rows(again, there, roots)
    if ending in (".obj", ".mtl"):
        return mesh_rows(again, there)
    if ending in (".xml", ".urdf"):
        if root_of(there).tag != "mujoco":
            return xml_rows(again, there)
        from assetbuild.facts.again.mjcf import mjcf_rows

        return mjcf_rows(again, there)
    if ending in TREES:
        return tree_rows(TREES[ending](again), TREES[ending](there))
    return tree_rows(_lines(again), _lines(there))[:1]


def _lines(path: Path) -> Node:
    """A kind of file that is known to nobody here; the first line that differs says enough."""
    lines = enumerate(path.read_bytes().splitlines(), start=1)
    parts = {f"line {n}": Node(line.decode("utf-8", "replace"), {}, n) for n, line in lines}
    return Node(None, parts, 0, ("file", path.name))


# --- YAML and JSON -------------------------------------------------------------------------------


NAMED = 2
"""Tables below so many keys are about a thing: `links`, `trunk`."""


def key_tree(path: Path) -> Node:
    """Comments and layout mean nothing; JSON is YAML, as far as bundles go."""
    import yaml

    try:
        root = yaml.compose(path.read_bytes(), Loader=plain_loader())
        return _key_node(root, ()) if root else Node()
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        raise NotParsedError(f"not readable as YAML: {error.problem}", line) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise NotParsedError(f"not readable as YAML: {error}") from None


def _key_node(node: Any, path: tuple[str, ...]) -> Node:  # Any: a node of PyYAML
    import yaml

    line = node.start_mark.line + 1
    if isinstance(node, yaml.MappingNode):
        keys = [str(key.value) for key, _ in node.value]
        items = [value for _, value in node.value]
    elif isinstance(node, yaml.SequenceNode) and any(
        not isinstance(item, yaml.ScalarNode) for item in node.value
    ):  # a list of plain values is one value
        keys, items = [f"[{index}]" for index in range(len(node.value))], node.value
    else:
        value = yaml.SafeLoader("").construct_object(node, deep=True)
        leaf = Node(tuple(value) if _is_row(value) else value, {}, line)
        return leaf if len(path) > 1 else Node(None, {path[-1] if path else "value": leaf})
    parts = {key: _key_node(item, (*path, key)) for key, item in zip(keys, items, strict=True)}
    is_named = 0 < len(path) <= NAMED
    subject = (path[0], "".join(path[1:])) if is_named else None
    return Node(None, parts, line, subject)


def _is_row(value: object) -> bool:
    if not isinstance(value, list):
        return False
    return all(isinstance(item, int | float) and not isinstance(item, bool) for item in value)


# --- Wavefront files -----------------------------------------------------------------------------


def mesh_rows(again: Path, there: Path) -> list[Row]:
    """The first line of each keyword that two meshes, or two libraries of materials, differ in.

    Lines locate, triangles with their looks decide.
    """
    first: dict[str, Row] = {}
    for row in tree_rows(_statements(again), _statements(there)):
        first.setdefault(row.attribute.partition("[")[0], row)
    return [] if there.suffix == ".obj" and _same_triangles(again, there) else [*first.values()]


def _statements(path: Path) -> Node:
    """Statements by their keyword, comments left out."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise NotParsedError(f"not readable as text: {error}") from None
    parts: dict[str, Node] = {}
    seen: Counter[str] = Counter()
    for number, line in enumerate(lines, start=1):
        word, _, rest = line.strip().partition(" ")
        if word and not word.startswith("#"):
            parts[f"{word}[{seen[word]}]"] = Node(Words(rest.strip()), {}, number)
            seen[word] += 1
    return Node(None, parts, 0, ("mesh", path.stem))


def _same_triangles(again: Path, there: Path) -> bool:
    """Whether all corners have the same place, texture coordinates, normal and look."""
    try:
        ours, theirs = (parse_obj(path.read_bytes(), path.name) for path in (again, there))
    except StepError:
        return False
    looks = [(obj.libraries, [look for look, _ in obj.parts]) for obj in (ours, theirs)]
    return looks[0] == looks[1] and all(
        same(one.corners, other.corners) and same(one.uv, other.uv)
        and same(one.normals, other.normals)
        for (_, one), (_, other) in zip(ours.parts, theirs.parts, strict=True)
    )  # fmt: skip


# --- pictures ------------------------------------------------------------------------------------


def picture_tree(path: Path) -> Node:
    """Kind, size and pixels."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            pixels = np.array(picture.convert("RGBA") if picture.mode == "P" else picture)
            values = {"mode": picture.mode, "size": picture.size, "pixels": pixels}
    except (OSError, ValueError, SyntaxError) as error:
        raise NotParsedError(f"not readable as a picture: {error}") from None
    parts = {name: Node(value) for name, value in values.items()}
    return Node(None, parts, 0, ("picture", path.name))


# --- Python: docstrings and layout mean nothing ---


UNWRAPPED = (ast.Return, ast.Expr, ast.Assign, ast.AnnAssign, ast.keyword)
"""Nodes that are their value, under a name that says the rest."""
ANNOTATIONS = ("annotation", "returns")
IMPORTS = (ast.Import, ast.ImportFrom)


def python_tree(path: Path) -> Node:
    """Statements by their names, calls by their keywords, dictionaries by their keys."""
    try:
        module = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError) as error:
        line = error.lineno or 0 if isinstance(error, SyntaxError) else 0
        raise NotParsedError(f"not readable as Python: {error}", line) from None
    used = {node.id for node in ast.walk(module) if isinstance(node, ast.Name)}
    imports = [one for one in module.body if isinstance(one, IMPORTS)]
    rest = [one for one in module.body if not isinstance(one, IMPORTS)]
    parts = {
        "module": Node(None, dict(_imports(imports, used)), 0, ("module", "")),
        **_block(rest, ""),
    }
    return Node(None, parts, 0, ("module", ""), ordered=True)


def _imports(
    statements: Sequence[ast.Import | ast.ImportFrom], used: set[str]
) -> Iterator[tuple[str, Node]]:
    """Yield each imported name with its origin.

    Unused imports of the standard library are left out, except those from `__future__`.
    """
    for one in statements:
        package = f"{'.' * one.level}{one.module or ''}." if isinstance(one, ast.ImportFrom) else ""
        for each in one.names:
            name, origin = each.asname or each.name, f"{package}{each.name}"
            is_used = name in used or package == "__future__."
            if is_used or origin.partition(".")[0] not in sys.stdlib_module_names:
                yield f"import {origin if name == '*' else name}", Node(origin, {}, one.lineno)


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
    # The annotation of a field makes it one; of all else annotations are for people.
    is_field = isinstance(node, ast.AnnAssign) and inside
    if isinstance(node, UNWRAPPED) and node.value is not None and not is_field:
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
        if name in ANNOTATIONS and not isinstance(node, ast.AnnAssign):
            continue
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


TREES = {
    ".py": python_tree, ".yaml": key_tree, ".yml": key_tree, ".json": key_tree,
    ".xrdf": key_tree,
    ".png": picture_tree, ".jpg": picture_tree, ".jpeg": picture_tree,
}  # fmt: skip
"""Ending of a file -> what it states."""
