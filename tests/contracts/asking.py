"""Build recipes and print what this process asked the world that the builds' record lacks.

A program of its own: `python asking.py OUT RECIPE...`. Audit hooks tell of opened files and listed
folders; `stat`, `readlink` and the environment tell nobody, so they are wrapped before anything
of assetbuild is imported.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

OPENS, LISTS = ("open",), ("os.listdir", "os.scandir", "glob.glob")
WRAPPED = ("stat", "lstat", "readlink", "access")
SETTINGS = {"ASSETBUILD_CACHE", "XDG_CACHE_HOME", "TMPDIR", "TEMP", "TMP"}
"""Variables that say where the store and private files lie."""

asked: set[tuple[str, str, str]] = set()
"""(what was done, path or variable, which function of assetbuild did it)."""


def main(out: Path, recipes: list[Path]) -> None:
    """Build, and print what the record lacks as JSON."""
    sys.addaudithook(_hear)
    for name in WRAPPED:
        setattr(os, name, _wrapped(name, getattr(os, name)))
    environ: Any = type(os.environ)  # Any: a method is replaced
    plain = environ.__getitem__

    def lookup(self: Any, name: str) -> str:
        _note("variable", name)
        return str(plain(self, name))

    environ.__getitem__ = lookup

    from assetbuild.engine.world import World
    from assetbuild.pipeline.building import Request, build_all

    world = World()
    requests = [Request(r, out=out / r.stem, jobs=2, fail_on="never") for r in recipes]
    outcomes = build_all(requests, lambda _: None, lambda _: None, world)
    result = {
        "errors": [str(error) for outcome in outcomes for error in outcome.errors],
        "whole": all(outcome.report is not None for outcome in outcomes),
        "lacking": sorted(_lacking(world.record, out)),
        "recorded": [list(question) for question in world.record],
    }
    sys.stdout.write(json.dumps(result))


def _lacking(record: Any, out: Path) -> set[tuple[str, str, str]]:
    known: dict[str, set[str]] = {}
    for kind, subject, _ in record:
        known.setdefault(kind, set()).add(subject)
    everything = set().union(*known.values())
    enough = {"open": known["bytes"], "list": known["names"], "variable": known["variable"]}
    return {
        (how, subject, who)
        for how, subject, who in asked
        if subject not in enough.get(how, everything)
        and not (_is_ours(subject, out) if how != "variable" else subject in SETTINGS)
    }


def _is_ours(path: str, out: Path) -> bool:
    """Code, Python and its libraries, the system's own folders, the store, what is built."""
    import assetbuild

    places = [*sys.path, sys.prefix, sys.base_prefix, os.environ["ASSETBUILD_CACHE"]]
    places += [str(Path(assetbuild.__file__).parent), "/proc", "/dev/null", "/sys"]
    if out.is_relative_to(path) or path.startswith(str(out)):
        return True
    return any(place and f"{path}/".startswith(f"{place.rstrip('/')}/") for place in places)


def _wrapped(name: str, plain: Callable[..., Any]) -> Callable[..., Any]:
    def wrapped(path: Any, *arguments: Any, **named: Any) -> Any:
        if not isinstance(path, int) and named.get("dir_fd") is None:
            _note("look", os.fsdecode(path))
        return plain(path, *arguments, **named)

    return wrapped


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event not in (*OPENS, *LISTS) or isinstance(arguments[0], int) or arguments[0] is None:
        return
    if event in OPENS and isinstance(arguments[2], int) and arguments[2] & os.O_ACCMODE:
        return  # to write
    _note("open" if event in OPENS else "list", os.fsdecode(arguments[0]))


def _note(how: str, subject: str) -> None:
    """Unless Python imports a module; named after the innermost function of assetbuild.

    What of the environment is handed on to children is not asked by the build.
    """
    frame: FrameType | None = sys._getframe(2)
    who = ""
    while frame is not None:
        file, name = frame.f_code.co_filename, frame.f_code.co_name
        if file.startswith("<frozen importlib") or "/importlib/" in file:
            return
        if not who and "/assetbuild/" in file:
            who = f"{file.partition('/assetbuild/')[2]}:{name}"
        elif not who and how == "variable" and "-packages/" in file:
            return  # a library's own
        frame = frame.f_back
    if who and not (how == "variable" and who.startswith("engine/doors.py")):
        asked.add((how, subject if how == "variable" else os.path.abspath(subject), who))  # noqa: PTH100 # no links


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(word) for word in sys.argv[2:]])
