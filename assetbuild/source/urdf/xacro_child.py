"""The program that runs xacro: its own process, its own folder, then no rights at all.

A xacro file is a program, and the check of its expressions is no sandbox. So everything that
xacro needs is imported first; then the process gives up its rights (see `confine`), and
an audit hook refuses and *names* what leads outside, which a kernel's "permission denied" would
not. The job comes as JSON on the standard input, the answer goes to the standard output.
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass, field
from typing import Any, NoReturn

from assetbuild.engine.confine import LISTING, REFUSED, confine, do_one_job

MEMORY_BYTES = 2 << 30
ABSENT = ".absent"
"""Folder below the tree, which does not exist, for packages that the source does not have."""
READING = os.O_ACCMODE | os.O_CREAT | os.O_TRUNC | os.O_APPEND
"""Bits of `open`'s flags that are all 0 (`O_RDONLY`) for reading."""
NEVER = ("sys.", "gc.")
"""Audit events that no robot description needs, besides `REFUSED`."""


class RefusedError(Exception):
    """The file asks for something that it may not have. Not an OSError: xacro excuses those."""


@dataclass
class Guard:
    """The audit hook. tree: the folder of the declared files; used: those that were opened;
    packages: those that `$(find)` was asked for."""

    tree: str
    used: set[str] = field(default_factory=set)
    packages: set[str] = field(default_factory=set)
    refused: list[str] = field(default_factory=list)

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:  # Any: the event's own
        """Called by the interpreter for every open, listing, socket, process, ..."""
        if event == "open":
            path, _, flags = arguments
            if not isinstance(path, int):
                self.opened(os.fsdecode(path), flags)
        elif event in LISTING:
            path = arguments[0]
            if isinstance(path, int) or not self.inside(os.fsdecode(path or ".")):
                self.refuse(
                    f"lists the folder `{printable(path)}`, which is not below the packages"
                )
        elif event.startswith((*REFUSED, *NEVER)):
            self.refuse(f"wants to use `{event}`, which no robot description needs")

    def opened(self, path: str, flags: int) -> None:
        """Reading below the tree is fine; a file that is not there says so itself."""
        if flags & READING:
            self.refuse(f"wants to write the file `{printable(path)}`")
        inside = self.inside(path)
        if not inside:
            self.refuse(
                f"wants to read `{printable(path)}`, which is outside the declared packages"
            )
        self.used.add(str(inside))

    def inside(self, path: str) -> str:
        """The path below the tree, "" when it leads outside. Without asking the disk."""
        full = os.path.normpath(os.path.join(self.tree, path))  # noqa: PTH118 - strings
        if full == self.tree:
            return "."
        return full[len(self.tree) + 1 :] if full.startswith(self.tree + "/") else ""

    def refuse(self, what: str) -> NoReturn:
        """Remember it, so that no `except` of xacro can hide it."""
        self.refused.append(what)
        raise RefusedError(what)


def printable(path: object) -> str:
    """A path for a message: short and printable."""
    text = str(path)
    return (text if text.isprintable() else ascii(text))[:200]


def main() -> None:
    """Expand one file as the job says."""
    do_one_job(_run, MEMORY_BYTES)


def _run(job: dict[str, Any]) -> dict[str, object]:  # Any: JSON
    import xacro

    guard = Guard(os.path.realpath(job["tree"]))
    os.chdir(guard.tree)
    packages = {name: _joined(guard.tree, folder) for name, folder in job["packages"].items()}
    packages |= {name: _joined(guard.tree, f"{ABSENT}/{name}") for name in job["absent"]}
    warnings = _prepare(packages, guard)
    confine([guard.tree, *_linked(guard.tree)])
    sys.addaudithook(guard)
    path = _joined(guard.tree, job["file"])
    try:
        xacro.init_stacks(path)
        document = xacro.parse(None, path)
        xacro.process_doc(document, mappings=dict(job["args"]))
        text = document.toprettyxml(indent="  ")
    except Exception as error:
        return _error_data(error, guard) | _stacks(guard)
    if guard.refused:  # and excused by xacro, as in an optional include
        return {"error": guard.refused[0]} | _stacks(guard)
    used = {"files": _read_by(guard), "packages": sorted(guard.packages)}
    return {
        "urdf": _portable(text, guard.tree, packages, job["file"]),
        "used": used,
        "said": warnings,
    }


def _joined(tree: str, folder: str) -> str:
    return os.path.normpath(os.path.join(tree, folder))  # noqa: PTH118 - strings


def _linked(tree: str) -> list[str]:
    """The files that the links in the tree point to: Landlock knows files, not names."""
    return [
        os.path.realpath(os.path.join(folder, name))  # noqa: PTH118 - many names
        for folder, _, names in os.walk(tree)
        for name in names
    ]


def _prepare(packages: dict[str, str], guard: Guard) -> list[str]:
    """Everything xacro imports late, `$(find)` by the recipe's map, XML without a DOCTYPE."""
    import encodings.cp1252
    import encodings.latin_1
    import encodings.utf_16
    import encodings.utf_32
    import glob
    import xml.dom.expatbuilder
    import xml.dom.minidom

    import defusedxml.minidom
    import xacro
    import yaml  # noqa: F401 - before the rights go
    from xacro import substitution_args

    def find(name: str) -> str:
        if name not in packages:
            guard.refuse(f"`$(find {name})`: no package named `{printable(name)}`")
        guard.packages.add(name)
        return packages[name]

    substitution_args._eval_find = find
    substitution_args._eval_dict["find"] = find

    def parse(file: Any) -> Any:  # Any: a file in, a document out
        return defusedxml.minidom.parse(file, forbid_dtd=True)

    xml.dom.minidom.parse = parse  # type: ignore[assignment] # this process only
    warnings: list[str] = []

    def warning(*words: object, **_: object) -> None:
        warnings.append(" ".join(map(str, words)))

    xacro.warning = warning
    xacro.print_location = lambda: None
    _ = (encodings.cp1252, encodings.latin_1, encodings.utf_16, encodings.utf_32, glob)
    return warnings


def _stacks(guard: Guard) -> dict[str, object]:
    """The file that was being read, and the macros that were being expanded, innermost last."""
    import xacro

    files = [guard.inside(str(file)) for file in xacro.filestack or [] if file]
    macros = [macro.body.getAttribute("name") for macro in xacro.macrostack or []]
    return {"files": [file for file in files if file], "macros": macros, "read": _read_by(guard)}


def _read_by(guard: Guard) -> list[str]:
    return sorted(path for path in guard.used if os.path.isfile(path))  # noqa: PTH113


def _error_data(error: Exception, guard: Guard) -> dict[str, object]:
    """An exception as plain data: message, and the line where one is known."""
    cause = _innermost(error)
    line = int(getattr(cause, "lineno", 0) or 0)
    mark = getattr(cause, "problem_mark", None)
    if mark is not None:
        line = mark.line + 1
        text = f"not readable as YAML: {getattr(cause, 'problem', None) or cause}"
        return {"error": text, "line": line, "file": guard.inside(str(mark.name))}
    if guard.refused:
        return {"error": guard.refused[0], "line": line}
    if isinstance(cause, MemoryError):
        return {"error": f"it ran over its memory limit of {MEMORY_BYTES >> 20} MB", "line": 0}
    if isinstance(cause, RecursionError):
        return {"error": "a macro, property or include uses itself without end", "line": line}
    if isinstance(cause, UnicodeDecodeError):
        line = cause.object.count(b"\n", 0, cause.start) + 1
        return {"error": f"byte 0x{cause.object[cause.start]:02x} is no UTF-8", "line": line}
    if isinstance(cause, FileNotFoundError):
        path = guard.inside(str(cause.filename)) or printable(cause.filename)
        if path.startswith(f"{ABSENT}/"):
            _, name, inside = path.split("/", 2)
            wants = f"wants to read `{inside}` of the package `{name}`, which is stated as missing"
            return {"error": wants, "line": line}
        return {"error": f"no file `{path}` among the readable files of the packages", "line": line}
    if type(cause).__name__ in ("DTDForbidden", "EntitiesForbidden"):
        return {"error": "a DOCTYPE is not allowed", "line": line}
    words = " ".join(str(error).split()) or type(error).__name__
    words = re.sub(r"^<class '[^']*'>: (.*) \1$", r"\1", words)  # xacro's own, said twice
    return {"error": words.replace(f"{guard.tree}/", "")[:400], "line": line}


def _innermost(error: BaseException) -> BaseException:
    seen = {id(error)}
    while True:
        inner = getattr(error, "exc", None) or error.__cause__ or error.__context__
        if not isinstance(inner, BaseException) or id(inner) in seen:
            return error
        seen.add(id(inner))
        error = inner


def _portable(text: str, tree: str, packages: dict[str, str], file: str) -> str:
    """Paths of this process, as `package://` or relative to the file: the same everywhere.

    `$(find NAME)` gives a path that begins with a slash; a scheme may stand before it, with as
    many slashes as the author thought right.
    """
    end, scheme = r"(?=[/\"'\s<&]|$)", "(?:(?:file|package|model):/{0,3})?"
    for name, folder in sorted(packages.items(), key=lambda item: (-len(item[1]), item[0])):
        text = re.sub(rf"{scheme}{re.escape(folder)}{end}", f"package://{name}", text)
    beside = os.path.dirname(file) or "."  # noqa: PTH120 - strings

    def relative(match: re.Match[str]) -> str:
        return os.path.relpath("." + (match[1] or ""), beside)

    return re.sub(rf"{scheme}{re.escape(tree)}(/[^\"'\s<&]*)?", relative, text)
