"""The code of a step: the modules that it computes with, and the libraries that these import.

The modules are the import closure of the file that defines the step: imports inside functions
count, those below `if TYPE_CHECKING:` do not. What imports cannot show stands in a constant of the
module that needs it:

    BEYOND_IMPORTS = ("assetbuild.simulators.physx._child", "simcheck", "./page.css")

These are modules that it starts as programs, libraries that it finds by name, and files beside it
that it opens; a file's name has a slash.

`engine.step`, which defines what a step is, does not count: `KEY_FORMAT` stands for the code that
runs steps. Any other module of the engine counts where a step's own code imports it.
"""

from __future__ import annotations

import ast
import gc
import os
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import Signature, digest_bytes, digest_file, signature_of
from assetbuild.engine.libraries import Libraries, Places
from assetbuild.engine.stamps import Stamps
from assetbuild.errors import MachineError

FILES_KEPT = 4000
"""In one cache; several installations may share a store."""
DIGITS = 32
"""Hexadecimal digits of a module's digest in a key: 128 bits."""
PACKAGE = "assetbuild"
FRAME = "assetbuild.engine.step"
PYTHON = f"{sys.implementation.name} {sys.version_info.major}.{sys.version_info.minor}"


@dataclass(frozen=True)
class StepCode:
    """What a step computes with. modules: name -> digest; libraries: name -> version.

    files: (name, path) of the modules, and of the files that they open.
    """

    modules: dict[str, str]
    libraries: dict[str, str]
    files: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class _File:
    """What this process found in one file. digest: "" when it holds no code.

    imports: `module:name` for `from module import name`, `module:` for `import module`; a file is
    `package/name:`. What `BEYOND_IMPORTS` names ends in `:!`.
    """

    signature: Signature
    digest: str
    imports: tuple[str, ...]


_FIRST_SEEN: dict[tuple[str, str], _File] = {}
"""(name, path) -> file. A process keeps the code that it has loaded, so the digests stay, too."""


class Code:
    """The code of step classes. A file is read once per installation, then known by its stamp.

    folder: holds one file for each version of Python; None = the next process reads all again.
    """

    def __init__(self, folder: Path | None = None) -> None:
        kept = folder and folder / f"{PYTHON.replace(' ', '-')}.json"
        self._stamps = Stamps(kept, form=SYNTAX_FORMAT, limit=FILES_KEPT)
        self._libraries = Libraries(self._stamps)
        self._packages = Places()
        self._targets: dict[tuple[str, str], tuple[list[str], set[str]]] = {}
        self._closures: dict[str, StepCode] = {}
        self._lock = threading.Lock()

    def of(self, step: type) -> StepCode:
        """The code of a step class. MachineError when its source is not to be found."""
        module = step.__module__
        with self._lock:
            if module not in self._closures:
                collects = gc.isenabled()
                gc.disable()  # it would take most of the time: syntax trees are many small objects
                try:
                    self._closures[module] = self._closure(module)
                finally:
                    if collects:
                        gc.enable()
            code = self._closures[module]
            stated = getattr(step, "tools", ())  # of a plug-in that was written for assetbuild 0.1
            if not stated:
                return code
            libraries = self._libraries.with_requirements([*code.libraries, *stated])
            return StepCode(code.modules, libraries, code.files)

    def check(self, step: type) -> None:
        """MachineError when the code of a step has changed since this process looked at it.

        A child process loads it later than that, so what it made may be that of either.
        """
        code = self.of(step)
        for library in code.libraries:
            if not self._libraries.is_there(library):
                raise _changed(f"the library `{library}`")
        for name, path in code.files:
            seen = _FIRST_SEEN[name, path]
            try:
                if signature_of(os.stat(path)) == seen.signature:  # noqa: PTH116 - on a hot path
                    continue
                digest = _read(name, path)[0]
            except OSError:
                digest = "gone"
            if digest != seen.digest:
                raise _changed(f"`{path}`")

    def save(self) -> None:
        """Write what was learnt; OSError passes."""
        with self._lock:
            self._stamps.save()

    def _closure(self, start: str) -> StepCode:
        step_package = start.partition(".")[0]
        if self._packages.path(start) is None:
            raise MachineError(
                f"the source of `{start}`, which defines a step, cannot be found",
                hint="define the step in a module that can be imported",
            )
        files: dict[str, str] = {}
        libraries: set[str] = set()
        seen, waiting = {start, FRAME}, [start]
        while waiting:
            name = waiting.pop()
            path = self._packages.path(name)
            if path is None:
                continue
            files[name] = path
            targets, tops = self._leads_to(name, step_package, self._file(name, path))
            libraries |= tops
            fresh = [target for target in targets if target not in seen]
            seen.update(fresh)
            waiting += fresh
        digests = ((name, _FIRST_SEEN[name, path].digest) for name, path in sorted(files.items()))
        owners = {owner for top in libraries for owner in self._libraries.owners(top)}
        return StepCode(
            {name: digest[:DIGITS] for name, digest in digests if digest},
            self._libraries.with_requirements(sorted(owners)),
            tuple(sorted(files.items())),
        )

    def _leads_to(self, name: str, step_package: str, file: _File) -> tuple[list[str], set[str]]:
        """Modules and files that a module leads to, and top-level modules of libraries."""
        known = self._targets.get((name, step_package))
        if known is not None:
            return known
        targets: list[str] = []
        libraries: set[str] = set()
        if "." in name and "/" not in name:
            targets.append(name.rpartition(".")[0])  # a package runs before what is in it
        for each in file.imports:
            module, _, member = each.partition(":")
            top = module.partition("/")[0].partition(".")[0]
            if top in sys.stdlib_module_names:
                continue
            if not self._is_code(top, step_package):
                libraries.add(top)
                continue
            targets.append(module)
            if member and member != MUST:
                targets.append(f"{module}.{member}")
            elif member and top in (PACKAGE, step_package) and self._packages.path(module) is None:
                raise MachineError(
                    f"`{name}` names `{module}` in `BEYOND_IMPORTS`, which is not there",
                    hint="name a module, or a file beside it as `./page.css`",
                )
        self._targets[name, step_package] = targets, libraries
        return targets, libraries

    def _is_code(self, top: str, step_package: str) -> bool:
        """Is a top-level module part of what the step belongs to, rather than a library?

        What no distribution installs is code as well: anyone may edit it under its version.
        """
        if top in (PACKAGE, step_package):
            return True
        owners = self._libraries.owners(top)
        return not owners or not set(owners).isdisjoint(self._libraries.owners(step_package))

    def _file(self, name: str, path: str) -> _File:
        if (name, path) not in _FIRST_SEEN:
            status = os.stat(path)  # noqa: PTH116 - on a hot path
            text = self._stamps.find(f"{name} {path}", status, lambda: "\n".join(_read(name, path)))
            digest, *imports = text.split("\n")
            _FIRST_SEEN[name, path] = _File(signature_of(status), digest, tuple(imports))
        return _FIRST_SEEN[name, path]


def notes_folder(store: Path) -> Path:
    """Where `Code` keeps what it found: beside the package, where Python keeps its bytecode.

    In the store where Python writes no bytecode, or may not write it there.
    """
    beside = Path(__file__).parents[1] / "__pycache__"
    if sys.dont_write_bytecode or not os.access(beside, os.W_OK):
        return store / "code"
    return beside / "syntax"


def _changed(what: str) -> MachineError:
    return MachineError(
        f"{what} was changed while a step ran that uses it", hint="start the program again"
    )


SYNTAX_FORMAT = "syntax 4"
"""Raised when the digest of the same file, or what is found in it, changes."""
SAID_BY_OTHERS = frozenset({"ctx", "kind"})
"""Fields that say nothing: whether a name is read or written follows from where it stands, and
`u"a"` is `"a"`."""
STATED = "BEYOND_IMPORTS"
_PARSER = threading.Lock()
"""Python 3.11 counts the depth of all threads' trees together and fails where two parse at once."""
VERSION = "__version__"
MUST = "!"
"""In the place of an imported name: the constant names the module or file, so it must be there."""


def _read(name: str, path: str) -> list[str]:
    """The digest and the imports of a module; the digest of the bytes of another file. OSError.

    Comments, docstrings, blank lines, layout and `if TYPE_CHECKING:` do not change the digest, nor
    does `__version__`: whoever imports that leads to the bytes of the file that states it. A module
    without a statement has no digest. What Python cannot parse counts by its bytes.
    """
    if "/" in name or not path.endswith(".py"):
        return [digest_file(path)]
    data = Path(path).read_bytes()
    package = name if path.endswith("__init__.py") else name.rpartition(".")[0]
    leading: list[ast.stmt] = []
    try:
        with _PARSER:
            tree = ast.parse(data)
        text = _text(tree, leading)
    except (SyntaxError, ValueError, RecursionError):
        return [digest_bytes(data)]
    imports: dict[str, None] = {}
    for node in leading:
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports |= dict.fromkeys(_imports(node, package))
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            imports |= dict.fromkeys(_stated(node, name, package))
    digest = "" if text == "Module([] [])" else digest_bytes(text.encode("utf-8", "surrogatepass"))
    return [digest, *imports]


def _text(value: Any, leading: list[ast.stmt]) -> str:  # Any: a node, a list of them, or plain
    """The tree as text. leading: gets the statements that may lead to other modules."""
    if isinstance(value, ast.AST):
        fields = [
            getattr(value, name, None) for name in value._fields if name not in SAID_BY_OTHERS
        ]
        return f"{type(value).__name__}({' '.join([_text(each, leading) for each in fields])})"
    if not isinstance(value, list):
        return repr(value)
    if value and isinstance(value[0], ast.stmt):
        value = [each for one in value for each in _counted(one)]
        leading += value
    return f"[{' '.join([_text(each, leading) for each in value])}]"


def _imports(node: ast.Import | ast.ImportFrom, package: str) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (f"{alias.name}:" for alias in node.names)
        return
    base = node.module or ""
    if node.level:
        parts = package.split(".")
        parts = parts[: len(parts) - node.level + 1]
        base = ".".join([*parts, *filter(None, [node.module])])
    for alias in node.names:
        if alias.name == VERSION:
            path = base.replace(".", "/")
            yield from (f"{path}.py:", f"{path}/__init__.py:")
        yield f"{base}:{alias.name}"


def _stated(node: ast.Assign | ast.AnnAssign, name: str, package: str) -> Iterator[str]:
    """What the constant states, wherever it stands. MachineError when it is not a tuple."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    if not any(isinstance(each, ast.Name) and each.id == STATED for each in targets):
        return
    try:
        stated = ast.literal_eval(node.value or "None")
    except ValueError:
        stated = None
    if not isinstance(stated, tuple) or not all(isinstance(each, str) for each in stated):
        raise MachineError(
            f"`{STATED}` of `{name}` is not a tuple of strings",
            hint="write out the names; they are read without running the module",
        )
    here = package.replace(".", "/")
    for each in stated:
        target = os.path.normpath(f"{here}/{each}") if "/" in each else each
        yield f"{target}:{MUST}"


def _counted(value: Any) -> list[Any]:  # Any: a statement
    """A statement, unless it does nothing; what stands in the place of `if TYPE_CHECKING:`."""
    match value:
        case ast.Expr(value=ast.Constant(value=str())):
            return []
        case ast.If(test=ast.Name(id="TYPE_CHECKING") | ast.Attribute(attr="TYPE_CHECKING")):
            return [each for kept in value.orelse for each in _counted(kept)]
        case ast.Assign(targets=[ast.Name(id="__version__")], value=ast.Constant()):
            return []
    return [value]
