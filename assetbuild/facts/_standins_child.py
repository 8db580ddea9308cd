"""Executes a trainer's module with stand-ins for everything that it imports beyond Python itself.

A module of a bundle is a program that anybody may have edited: before it runs, this process gives
up its rights (see `confine`), and an audit hook refuses what a configuration never needs. The job
comes as JSON on the standard input, the record goes to the standard output.
"""

from __future__ import annotations

import builtins
import json
import os
import pathlib  # noqa: F401 - our modules import it after the rights are gone
import resource
import sys
import types
from collections.abc import Iterator, Sequence
from typing import Any

from assetbuild.engine.confine import LISTING, REFUSED, confine, do_one_job

MEMORY_BYTES = 1 << 30
CPU_S = 10
FOLDER = "/bundle/python"
"""Where the module believes to lie: a record holds no paths of this machine."""
PYTHON = os.path.dirname(os.__file__)  # noqa: PTH120 - strings
CLASS, ARGUMENTS, LINE = "()", "*", "@"
"""Keys of a recorded call beside its keyword arguments: whose, its other arguments, its line."""
MODULE = "module"
IMPORT = builtins.__import__
IMPORTED: list[str] = []
"""What the module imports beyond Python itself."""


class Recorded:
    """Stands for anything of a trainer, and keeps what is called and set on it.

    Attributes, keyword arguments and items are one table: `cfg.actions["joint"].scale = 1` is
    {"actions": {"joint": {"scale": 1}}}.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[object] = (),
        fields: dict[str, Any] | None = None,  # Any: whatever the module states
        line: int = 0,
    ) -> None:
        vars(self).update(_name=name, _arguments=arguments, _fields=fields or {}, _line=line)

    def __call__(self, *arguments: object, **fields: object) -> object:
        if len(arguments) == 1 and isinstance(arguments[0], type | types.FunctionType):
            return arguments[0]  # a decorator
        return Recorded(self._name, arguments, fields, sys._getframe(1).f_lineno)

    def __getattr__(self, name: str) -> Any:  # Any: as above
        if name.startswith("__"):
            raise AttributeError(name)
        return self._fields.setdefault(name, Recorded(f"{self._name}.{name}"))

    def __setattr__(self, name: str, value: object) -> None:
        self._fields[name] = value

    def __getitem__(self, key: object) -> object:
        return getattr(self, str(key))

    def __setitem__(self, key: object, value: object) -> None:
        self._fields[str(key)] = value

    def __delitem__(self, key: object) -> None:
        self._fields[str(key)] = None

    def pop(self, key: str, default: object = None) -> object:
        """Record null for what is taken out, as from a dictionary."""
        self._fields[key] = None
        return default

    def __ior__(self, other: dict[str, Any]) -> Recorded:  # Any: as above
        self._fields.update(other)
        return self

    def replace(self, **changes: object) -> Recorded:
        """Return a copy with other fields, as a `configclass` does."""
        return Recorded(self._name, self._arguments, {**self._fields, **changes}, self._line)

    def copy(self) -> Recorded:
        """Return a copy, as a `configclass` does."""
        return self.replace()

    def __iter__(self) -> Iterator[object]:
        return iter(())

    def __str__(self) -> str:
        return str(self._name)


def stand_in(
    name: str, scope: Any = None, local: Any = None, words: Any = (), level: int = 0
) -> Any:
    """`__import__`: what Python itself does not have is a stand-in. Any: as Python calls it."""
    if (scope or {}).get("__name__") != MODULE:
        return IMPORT(name, scope, local, words, level)
    try:
        return IMPORT(name, scope, local, words, level)
    except ModuleNotFoundError:
        IMPORTED.append(name)
        return Recorded(name if words else name.partition(".")[0])


def guard(event: str, arguments: tuple[Any, ...]) -> None:  # Any: the event's own
    """The audit hook: only files of Python itself are read, and nothing else is done."""
    if event == "open":
        path, _, flags = arguments
        is_read = not flags & (os.O_ACCMODE | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
        allowed = is_read and os.path.normpath(str(path)).startswith(PYTHON)
    else:
        allowed = event in LISTING or not event.startswith(REFUSED)
    if not allowed:
        raise PermissionError(f"it wants `{event}`, which no configuration needs")


def main() -> None:
    """Execute one module as the job says."""
    do_one_job(_answer, MEMORY_BYTES)


def _answer(job: dict[str, Any]) -> dict[str, object]:  # Any: JSON
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
    sys.path[:] = [path for path in sys.path if path.startswith(PYTHON)]
    builtins.__import__ = stand_in  # type: ignore[assignment] # it returns stand-ins, too
    confine([PYTHON])
    sys.addaudithook(guard)
    try:
        return {"record": _record(f"{FOLDER}/{job['name']}", job["text"], job["calls"])}
    except BaseException as error:  # a module may raise anything
        return {
            "error": f"{type(error).__name__}: {error}"[:400],
            "line": _line(error, job["name"]),
        }


def _record(file: str, text: str, calls: Sequence[str]) -> dict[str, object]:
    """Constants by name, `name()` -> what its function returns, `imports` -> modules."""
    known: dict[str, Any] = {"__name__": MODULE, "__file__": file, "__package__": MODULE}
    exec(compile(text, file, "exec", dont_inherit=True), known)  # noqa: S102 - that is the job
    called = {f"{call}()": known[call]() for call in calls if call in known}
    kept = {name: value for name, value in known.items() if _is_constant(name, value)}
    record: dict[str, object] = plain({**kept, **called, "imports": sorted(set(IMPORTED))})
    json.dumps(record)
    return record


def _is_constant(name: str, value: object) -> bool:
    """Whether the module says it, instead of importing it."""
    if isinstance(value, Recorded):
        return bool(value._line)
    if isinstance(value, type):
        return value.__module__ == MODULE
    return not (name.startswith("__") or isinstance(value, types.ModuleType | types.FunctionType))


def plain(value: Any) -> Any:  # Any: whatever the module states; JSON
    """A value as JSON. A call is its keyword arguments, with CLASS, ARGUMENTS and LINE."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Recorded):
        call = {CLASS: value._name, LINE: value._line}
        call |= {ARGUMENTS: plain(value._arguments)} if value._arguments else {}
        return call | plain(value._fields)
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(item) for item in value]
    if isinstance(value, type):
        attributes = {key: item for key, item in vars(value).items() if not key.startswith("__")}
        return {CLASS: value.__name__} | plain(attributes)
    return {CLASS: value.__name__} if callable(value) else str(value)


def _line(error: BaseException, name: str) -> int:
    """The line of the module that failed; 0 where none is known."""
    line = int(getattr(error, "lineno", 0) or 0)
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == f"{FOLDER}/{name}":
            line = trace.tb_lineno
        trace = trace.tb_next
    return line
