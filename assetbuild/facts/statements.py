"""Every import and statement of a module as words, to compare a module with what it must say.

Comments and docstrings are left out, because nothing that they say has an effect.
"""

from __future__ import annotations

import ast
from collections.abc import Collection

from assetbuild.facts.syntax import Module, is_plain, meant
from assetbuild.facts.table import Writer


def put_words(
    module: Module, form: str, book: Writer, read: Collection[str] = (), part: str = ""
) -> None:
    """Every import and statement as a word `<form>:...` of a subject `code ...`.

    read: names of constants, functions and classes whose values are facts already.
    part: which of several modules it is.
    """
    scope = f"{part} " if part else ""
    labels = []
    for node in meant(module.tree.body):
        if isinstance(node, ast.Import | ast.ImportFrom):
            origin = _origin(node)
            for alias in node.names:
                subject = f"{scope}import {alias.asname or alias.name}"
                said = f"{origin} {alias.name}".strip()
                book.put("code", subject, {f"{form}:from": said})
                book.place("code", subject, f"{module.name}:{node.lineno}")
            continue
        label = _label(node)
        labels.append(label)
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            subject = f"{scope}{node.name}"
            book.put("code", subject, {f"{form}:signature": _signature(node)})
            book.place("code", subject, f"{module.name}:{node.lineno}")
            if node.name not in read or not is_plain(node):
                _statements(module, node.body, subject, form, book)
        elif label not in read:
            _statement(module, node, f"{scope}{label}", form, book)
    book.put("code", f"{scope}module", {f"{form}:order": tuple(labels)})


def _statements(module: Module, body: list[ast.stmt], scope: str, form: str, book: Writer) -> None:
    seen: dict[str, int] = {}
    labels = []
    for node in meant(body):
        label = _label(node)
        seen[label] = seen.get(label, 0) + 1
        label += f" ({seen[label]})" if seen[label] > 1 else ""
        labels.append(label)
        _statement(module, node, f"{scope}: {label}", form, book)
    book.put("code", scope, {f"{form}:order": tuple(labels)})


def _statement(module: Module, node: ast.stmt, subject: str, form: str, book: Writer) -> None:
    book.place("code", subject, f"{module.name}:{node.lineno}")
    match node:
        case ast.Assign(value=value) | ast.AugAssign(value=value):
            said = module.value(value) if _is_number(value) else ast.unparse(value)
        case ast.Expr(value=ast.Call() as call):
            arguments = [*call.args, *(k for k in call.keywords)]
            said = ", ".join(map(ast.unparse, arguments))
        case ast.Return(value=ast.expr() as value):
            said = ast.unparse(value)
        case ast.For(iter=over, body=body, orelse=[]):
            said = ast.unparse(over)
            _statements(module, body, subject, form, book)
        case ast.If(test=test, body=body, orelse=orelse):
            said = ast.unparse(test)
            _statements(module, body, subject, form, book)
            if orelse:
                _statements(module, orelse, f"{subject} else", form, book)
        case _:
            said = ast.unparse(node)
    book.put("code", subject, {f"{form}:statement": said})


def _origin(node: ast.Import | ast.ImportFrom) -> str:
    """`..package` of `from ..package import name`; "" of `import name`."""
    if isinstance(node, ast.Import):
        return ""
    return "." * node.level + (node.module or "")


def _label(node: ast.stmt) -> str:
    """What a statement is about: the name that it assigns, calls or defines."""
    match node:
        case ast.Assign(targets=targets):
            return " = ".join(map(ast.unparse, targets)).strip("()")
        case ast.AugAssign(target=target, op=op):
            return f"{ast.unparse(target)} {type(op).__name__}"
        case ast.Expr(value=ast.Call(func=func)):
            return ast.unparse(func)
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return name
        case ast.For(target=target):
            return f"for {ast.unparse(target)}"
    return type(node).__name__.lower()


def _signature(node: ast.FunctionDef | ast.ClassDef) -> str:
    """Decorators, parameters with their defaults, and what comes out; the bases of a class."""
    above = " ".join(f"@{ast.unparse(decorator)}" for decorator in node.decorator_list)
    if isinstance(node, ast.ClassDef):
        bases = ", ".join(ast.unparse(part) for part in (*node.bases, *node.keywords))
        return f"{above} class({bases})".strip()
    result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"{above} ({ast.unparse(node.args)}){result}".strip()


def _is_number(node: ast.expr) -> bool:
    match node:
        case ast.Constant(value=str()):
            return False
        case ast.Constant():
            return True
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant()):
            return True
    return False
