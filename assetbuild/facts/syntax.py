"""A Python module as values and words, by its syntax tree: nothing is imported or executed.

`Module.value` resolves an expression as far as it stands in the file: literals, tuples, maps, names
that the module assigns at its top, arithmetic, `math.pi`, f-strings and paths below the module. A
call is a `Call`; what is not resolved is a `Text`.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from assetbuild.errors import UsageError
from assetbuild.facts.table import Value

OPERATORS: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
LARGEST_EXPONENT, LARGEST = 64, 1e300
DEEPEST = 50
"""Names that lead to names: more of them are a circle."""
MOST = 150_000
"""Expressions of one file; a real one has a few thousand."""


class Text(str):
    """The text of an expression that stands for no value in the file."""


@dataclass
class Call:
    """What is called, its arguments and keywords, resolved; `take` leaves what nobody asked for."""

    name: str
    arguments: list[Any]  # Any: values, calls, texts, tuples and maps of them
    fields: dict[str, Any]
    line: int

    @property
    def last(self) -> str:
        """`RigidBodyPropertiesCfg` of `sim_utils.RigidBodyPropertiesCfg`."""
        return self.name.rsplit(".", 1)[-1]

    def take(self, name: str) -> Any:  # Any: as above
        """A keyword's value, which is then read; None where it is not stated."""
        return self.fields.pop(name, None)

    def left(self) -> Iterator[tuple[str, Any]]:
        """(name, value) of arguments and keywords that nobody took."""
        yield from ((f"[{index}]", value) for index, value in enumerate(self.arguments))
        yield from self.fields.items()


@dataclass(frozen=True)
class Module:
    """A parsed file. name: its path below the bundle, for what it says of its own place."""

    tree: ast.Module
    name: str = "module.py"
    known: dict[str, ast.expr] = field(default_factory=dict)
    resolved: list[None] = field(default_factory=list)
    """One for each expression resolved so far: a file may not ask for too many."""

    @classmethod
    def parsed(cls, text: str | bytes, name: str = "module.py") -> Module:
        """Parse a text; UsageError where it is no Python."""
        try:
            tree = ast.parse(text, name)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise UsageError(f"`{name}` is no Python: {error}") from None
        return cls(tree, name, dict(_assigned(tree.body)))

    @classmethod
    def of_file(cls, path: Path) -> Module:
        """Parse a file of a bundle, or any other; UsageError where it is not readable."""
        try:
            text = path.read_bytes()
        except OSError as error:
            raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
        return cls.parsed(text, f"{path.absolute().parent.name}/{path.name}")

    # --- values -------------------------------------------------------------------------------

    def constant(self, name: str) -> Any:  # Any: as in `Call`
        """What the module assigns to a name at its top; None where it assigns nothing."""
        return self.value(self.known[name]) if name in self.known else None

    def returned(self, name: str) -> Any:  # Any: as in `Call`
        """What a function returns that does nothing else; None for any other."""
        found = [n for n in self.tree.body if isinstance(n, ast.FunctionDef) and n.name == name]
        stated = _only_return(found[-1]) if found else None
        return None if stated is None else self.value(stated)

    def attributes(self, name: str) -> dict[str, Any] | None:  # Any: as in `Call`
        """What a class assigns to its names, if it does nothing else; None for any other."""
        found = [n for n in self.tree.body if isinstance(n, ast.ClassDef) and n.name == name]
        if not found or not _only_assigns(found[-1]):
            return None
        return {key: self.value(value) for key, value in _assigned(found[-1].body)}

    def value(self, node: ast.expr, deep: int = 0) -> Any:  # Any: as in `Call`
        """A value, a `Call`, or the `Text` of the expression."""
        if deep > DEEPEST:
            return Text(ast.unparse(node))
        self.resolved.append(None)
        if len(self.resolved) > MOST:
            raise UsageError(f"`{self.name}` asks for more than {MOST} values")
        found = self._value(node, deep + 1)
        return Text(ast.unparse(node)) if found is None and not _is_none(node) else found

    def _value(self, node: ast.expr, deep: int) -> Any:  # Any: as above
        match node:
            case ast.Constant(value=constant):
                return _plain(constant)
            case ast.Name(id="__file__"):
                return self.name
            case ast.Name(id=name) if name in self.known and self.known[name] is not node:
                return self.value(self.known[name], deep)
            case ast.List(elts=items) | ast.Tuple(elts=items):
                if not any(isinstance(item, ast.Starred) for item in items):
                    return tuple(self.value(item, deep) for item in items)
            case ast.Dict(keys=keys, values=values):
                return self._map(keys, values, deep)
            case ast.Call():
                return self._path(node, deep) or self._call(node, deep)
            case ast.JoinedStr(values=parts):
                return self._formatted(parts, deep)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                number = _number(self.value(operand, deep))
                return None if number is None else -number
            case ast.BinOp(left=left, op=op, right=right):
                path = self._path(node, deep)
                sides = self.value(left, deep), self.value(right, deep)
                return _calculated(op, *sides) if path is None else path
            case ast.Attribute(value=ast.Name(id="math"), attr="pi"):
                return math.pi
            case ast.Attribute() | ast.Subscript():
                return self._path(node, deep)
        return None

    def _map(
        self, keys: list[ast.expr | None], values: list[ast.expr], deep: int
    ) -> dict[Any, Any] | None:  # Any: as above
        """None where a key is spread, no plain value, or stands there twice."""
        names = [self.value(key, deep) if key else None for key in keys]
        plain = all(isinstance(name, str | float | int) for name in names)
        if not plain or len(set(names)) < len(names):
            return None
        return {name: self.value(value, deep) for name, value in zip(names, values, strict=True)}

    def _call(self, node: ast.Call, deep: int) -> Call:
        arguments = [self.value(item, deep) for item in node.args]
        fields = {
            f"**{i}" if k.arg is None else k.arg: k.value for i, k in enumerate(node.keywords)
        }
        return Call(
            ast.unparse(node.func),
            arguments,
            {name: self.value(value, deep) for name, value in fields.items()},
            node.lineno,
        )

    def _formatted(self, parts: list[ast.expr], deep: int) -> str | None:
        found = []
        for part in parts:
            if isinstance(part, ast.FormattedValue):
                if part.format_spec is not None or part.conversion != -1:
                    return None
                part = part.value
            value = self.value(part, deep)
            if isinstance(value, Text) or not isinstance(value, str | float | int):
                return None
            found.append(str(value))
        return "".join(found)

    def _path(self, node: ast.expr, deep: int) -> PurePosixPath | str | None:
        """A path below the bundle; None for what is none. `str(path)` is its text."""
        match node:
            case ast.Call(func=ast.Name(id="str"), args=[inner], keywords=[]):
                path = self._inner_path(inner, deep)
                return None if path is None else str(path)
            case ast.Call(func=ast.Name(id="Path"), args=[inner], keywords=[]):
                value = self.value(inner, deep)
                is_text = isinstance(value, str) and not isinstance(value, Text)
                return PurePosixPath(value) if is_text else None
            case ast.Call(
                func=ast.Attribute(value=inner, attr="absolute" | "resolve"), args=[], keywords=[]
            ):
                return self._inner_path(inner, deep)
            case ast.Attribute(value=inner, attr="parent"):
                path = self._inner_path(inner, deep)
                return None if path is None else path.parent
            case ast.Subscript(
                value=ast.Attribute(value=inner, attr="parents"),
                slice=ast.Constant(value=int(level)),
            ):
                path = self._inner_path(inner, deep)
                above = () if path is None else tuple(path.parents)
                return above[level] if 0 <= level < len(above) else None
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                path, name = self._inner_path(left, deep), self.value(right, deep)
                is_text = isinstance(name, str) and not isinstance(name, Text)
                return path / name if path is not None and is_text else None
        return None

    def _inner_path(self, node: ast.expr, deep: int) -> PurePosixPath | None:
        value = self.value(node, deep + 1)
        return value if isinstance(value, PurePosixPath) else None


# --- parts ------------------------------------------------------------------------------------


def _assigned(body: list[ast.stmt]) -> Iterator[tuple[str, ast.expr]]:
    """(name, expression) of every assignment to a plain name; `A, B = 1, 2` are two."""
    for node in body:
        match node:
            case ast.Assign(targets=targets, value=value):
                for target in targets:
                    yield from _pairs(target, value)
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                yield name, value


def _pairs(target: ast.expr, value: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    match target, value:
        case ast.Name(id=name), _:
            yield name, value
        case ast.Tuple(elts=names), ast.Tuple(elts=values) if len(names) == len(values):
            for inner, part in zip(names, values, strict=True):
                yield from _pairs(inner, part)


def is_plain(node: ast.FunctionDef | ast.ClassDef) -> bool:
    """Whether it is a value with a name: `returned` or `attributes` gives all of it."""
    if isinstance(node, ast.ClassDef):
        return _only_assigns(node)
    return _only_return(node) is not None


def _only_return(node: ast.FunctionDef) -> ast.expr | None:
    match meant(node.body):
        case [ast.Return(value=ast.expr() as value)]:
            return value
    return None


def _only_assigns(node: ast.ClassDef) -> bool:
    body = meant(node.body)
    names = [name for name, _ in _assigned(body)]
    return len(body) == len(names) == len(set(names))


def meant(body: list[ast.stmt]) -> list[ast.stmt]:
    """The statements that have an effect: a text that stands alone is documentation."""
    return [node for node in body if not _is_documentation(node)]


def _is_documentation(node: ast.stmt) -> bool:
    match node:
        case ast.Expr(value=ast.Constant(value=str())):
            return True
    return False


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _plain(constant: object) -> object:
    """None for what no table can hold."""
    if isinstance(constant, bool | str):
        return constant
    if isinstance(constant, int | float) and abs(constant) < LARGEST:
        return constant
    return None


def _number(value: object) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return value if is_number else None  # type: ignore[return-value] # narrowed in `is_number`


def _calculated(op: ast.operator, left: object, right: object) -> float | str | None:
    """Sums and products of numbers; two texts put together."""
    if isinstance(op, ast.Add) and type(left) is str and type(right) is str:
        return left + right
    a, b = _number(left), _number(right)
    if a is None or b is None or type(op) not in OPERATORS:
        return None
    if isinstance(op, ast.Pow) and abs(b) > LARGEST_EXPONENT:
        return None
    try:
        found = float(OPERATORS[type(op)](float(a), float(b)))
    except (ArithmeticError, ValueError, TypeError):
        return None
    return found if math.isfinite(found) else None


def flat(value: object, path: str) -> Iterator[tuple[str, Value]]:
    """(path, value) of a value and all that is inside: `props[0].linear_damping`.

    Tuples of numbers and of texts are values; a call is its name, then its parts.
    """
    match value:
        case Call():
            yield path, value.name
            for name, inner in value.left():
                yield from flat(inner, f"{path}{name}" if name[0] == "[" else f"{path}.{name}")
        case dict():
            for key, inner in value.items():
                yield from flat(inner, f"{path}.{key}")
        case tuple() if not (is_vector(value) or all(type(item) is str for item in value)):
            for index, inner in enumerate(value):
                yield from flat(inner, f"{path}[{index}]")
        case bool() | str() | int() | float() | tuple() | None:
            yield path, value
        case _:
            yield path, str(value)


def is_vector(value: object) -> bool:
    """Whether it is a tuple of numbers, at least one."""
    return isinstance(value, tuple) and bool(value) and all(_number(v) is not None for v in value)
