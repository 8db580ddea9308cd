"""A Python file as its syntax tree tells it: the digest of what it does, and what it imports."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import digest_bytes, digest_file
from assetbuild.errors import MachineError

SYNTAX_FORMAT = "syntax 2"
"""Raised when the digest of the same file, or what is found in it, changes."""
STATED = "BEYOND_IMPORTS"
VERSION = "__version__"
MUST = "!"
"""In the place of an imported name: the constant names the module or file, so it must be there."""


def read_data(path: str) -> str:
    """The digest of a file that is no Python source. OSError."""
    return digest_file(path)


def read_module(name: str, path: str) -> tuple[str, tuple[str, ...]]:
    """Digest and imports of a module; see `engine.code`. OSError.

    Comments, docstrings, blank lines, layout and `if TYPE_CHECKING:` do not change the digest, nor
    does `__version__`: whoever imports that leads to the bytes of the file that states it. A module
    without a statement has no digest. What Python cannot parse counts by its bytes.
    """
    data = Path(path).read_bytes()
    try:
        reader = _Reader(name, is_package=path.endswith("__init__.py"))
        reader.walk(ast.parse(data))
    except (SyntaxError, ValueError, RecursionError):
        return digest_bytes(data), ()
    text = " ".join(reader.words)
    digest = "" if text == "Module )" else digest_bytes(text.encode("utf-8", "surrogatepass"))
    return digest, tuple(dict.fromkeys(reader.imports))


class _Reader:
    """Walks a tree once. words: the tree as text, the same under each version of Python as far as
    their grammars agree."""

    def __init__(self, name: str, *, is_package: bool) -> None:
        self.name = name
        self.package = name if is_package else name.rpartition(".")[0]
        self.words: list[str] = []
        self.imports: list[str] = []

    def walk(self, node: ast.AST) -> None:
        """Note a node and what is below it."""
        words = self.words
        words.append(type(node).__name__)
        for field in node._fields:
            value = getattr(node, field, None)
            if isinstance(value, ast.AST):
                words.append(field)
                self.walk(value)
            elif isinstance(value, list):
                self._list(field, value)
            elif value is not None and field != "kind":
                words.append(f"{field}={value!r}")
        words.append(")")
        if isinstance(node, ast.Import | ast.ImportFrom):
            self._import(node)

    def _list(self, field: str, values: list[Any]) -> None:  # Any: nodes, names or None
        kept = [each for value in values for each in _counted(value)]
        if not kept:
            return
        self.words.append(f"{field}[")
        for value in kept:
            if isinstance(value, ast.AST):
                if field == "body":
                    self._stated(value)
                self.walk(value)
            else:
                self.words.append(repr(value))
        self.words.append("]")

    def _import(self, node: ast.Import | ast.ImportFrom) -> None:
        if isinstance(node, ast.Import):
            self.imports += [f"{alias.name}:" for alias in node.names]
            return
        base = node.module or ""
        if node.level:
            parts = self.package.split(".")
            parts = parts[: len(parts) - node.level + 1]
            base = ".".join([*parts, *filter(None, [node.module])])
        for alias in node.names:
            if alias.name == VERSION:
                path = base.replace(".", "/")
                self.imports += [f"{path}.py:", f"{path}/__init__.py:"]
            self.imports.append(f"{base}:{alias.name}")

    def _stated(self, node: ast.AST) -> None:
        """What the constant states, wherever it stands. MachineError when it is not a tuple."""
        targets: Iterable[ast.expr] = ()
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign):
            targets = (node.target,)
        if not any(isinstance(each, ast.Name) and each.id == STATED for each in targets):
            return
        try:
            stated = ast.literal_eval(node.value)  # type: ignore[attr-defined]  # of both kinds
        except ValueError:
            stated = None
        if not isinstance(stated, tuple) or not all(isinstance(each, str) for each in stated):
            raise MachineError(
                f"`{STATED}` of `{self.name}` is not a tuple of strings",
                hint="write out the names; they are read without running the module",
            )
        here = self.package.replace(".", "/")
        for each in stated:
            found = os.path.normpath(f"{here}/{each}") if "/" in each else each
            self.imports.append(f"{found}:{MUST}")


def _counted(value: Any) -> list[Any]:  # Any: as `_Reader._list`
    """A statement, unless it does nothing; what stands in the place of `if TYPE_CHECKING:`."""
    match value:
        case ast.Expr(value=ast.Constant(value=str())):
            return []
        case ast.If(test=ast.Name(id="TYPE_CHECKING") | ast.Attribute(attr="TYPE_CHECKING")):
            return [each for kept in value.orelse for each in _counted(kept)]
        case ast.Assign(targets=[ast.Name(id="__version__")], value=ast.Constant()):
            return []
    return [value]
