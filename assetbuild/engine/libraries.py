"""Where modules lie, and installed libraries: which distribution brings one, and what it requires.

Names and versions are read from the folders `numpy-2.1.0.dist-info` that installers leave; what
such a folder holds is read only when the folder has changed.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import pkgutil
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from importlib import metadata
from importlib.machinery import ModuleSpec
from pathlib import Path

from assetbuild.engine.stamps import Stamps

SUFFIXES = (".dist-info", ".egg-info")
_REQUIREMENT = re.compile(r"\s*([\w.-]+)\s*(?:\[([^\]]*)\])?[^;]*;?(.*)", re.DOTALL)
_EXTRA = re.compile(r"""\bextra\s*==\s*["']([^"']+)["']""")


class Libraries:
    """The distributions on `sys.path`, as they are now.

    stamps: keeps what the metadata of each say.
    """

    def __init__(self, stamps: Stamps) -> None:
        self._folders = _metadata_folders()
        self._stamps = stamps

    def owners(self, module: str) -> tuple[str, ...]:
        """Distributions that install a top-level module; () for the standard library and others.

        An editable installation owns nothing here: its files are code that anyone may edit.
        """
        return tuple(self._owners.get(module, ()))

    @functools.cached_property
    def _owners(self) -> dict[str, list[str]]:
        owners: dict[str, list[str]] = {}
        for name in sorted(self._folders):
            for top in self._metadata(name)[0].split("\t"):
                owners.setdefault(top, []).append(name)
        return owners

    def _metadata(self, name: str) -> list[str]:
        """Its top-level modules in one line, then a line for each of its requirements."""
        folder = self._folders[name]
        try:
            text = self._stamps.find(str(folder), folder.stat(), lambda: _metadata_text(folder))
        except OSError:
            text = ""
        return text.split("\n")

    def with_requirements(self, names: Iterable[str]) -> dict[str, str]:
        """Name -> version of these distributions, if installed, and of what they require."""
        versions: dict[str, str] = {}
        waiting = list(names)
        seen = set(waiting)
        while waiting:
            label = waiting.pop()
            name, _, extra = label.rstrip("]").partition("[")
            name = _normal(name)
            if name not in self._folders:
                continue
            versions[name] = _version(self._folders[name])
            needs = _requirements(self._metadata(name)[1:], extra)
            fresh = [each for each in needs if each not in seen]
            seen.update(fresh)
            waiting += fresh
        return dict(sorted(versions.items()))

    def is_there(self, name: str) -> bool:
        """Whether a distribution is still installed in the version that it had."""
        return self._folders[name].exists()


def _version(folder: Path) -> str:
    stem = folder.name.removesuffix(".dist-info")
    _, dash, version = stem.partition("-")
    is_stated = dash and stem != folder.name
    return version if is_stated else metadata.Distribution.at(folder).version


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _metadata_folders() -> dict[str, Path]:
    """Normalised name of a distribution -> its metadata; the first on `sys.path` wins."""
    folders: dict[str, Path] = {}
    for folder in dict.fromkeys(sys.path):
        try:
            names = sorted(os.listdir(folder or "."))  # noqa: PTH208 - names are enough
        except OSError:
            continue
        for name in names:
            if name.endswith(SUFFIXES):
                folders.setdefault(
                    _normal(name.rpartition(".")[0].partition("-")[0]), Path(folder, name)
                )
    return folders


@functools.cache
def _metadata_text(folder: Path) -> str:
    """Return the text that `Libraries._metadata` splits; a process reads each folder once."""
    requires = metadata.Distribution.at(folder).requires or ()
    return "\n".join(["\t".join(sorted(_tops(folder))), *(" ".join(r.split()) for r in requires)])


def _tops(folder: Path) -> set[str]:
    """Top-level modules that a distribution installs, and names that are none."""
    try:
        lines = (folder / "RECORD").read_text("utf-8", "replace").splitlines()
    except OSError:
        try:
            return set((folder / "top_level.txt").read_text("utf-8", "replace").split())
        except OSError:
            return set()
    # Some distributions install below a prefix: `cmeel.prefix/lib/.../site-packages/pinocchio/`.
    paths = (line.rpartition("-packages/")[2] for line in lines)
    return {path.split("/", 1)[0].split(",", 1)[0].split(".", 1)[0] for path in paths}


def _requirements(requires: Iterable[str], extra: str) -> Iterator[str]:
    """`name` or `name[extra]` of what a distribution requires always, or for one of its extras."""
    for text in requires:
        match = _REQUIREMENT.match(text)
        if match is None:
            continue
        name, extras, marker = match.groups()
        asked = _EXTRA.findall(marker)
        if asked and extra not in asked:
            continue
        yield name
        for each in (extras or "").split(","):
            if each.strip():
                yield f"{name}[{each.strip()}]"


class Places:
    """Where modules lie, and the files of packages, by name."""

    def __init__(self) -> None:
        importlib.invalidate_caches()  # of what Python's finders saw earlier
        self._paths: dict[str, str | None] = {}
        self._folders: dict[str, list[str]] = {}

    def path(self, name: str) -> str | None:
        """The file of a module, or of `package/file.css`; None when there is none."""
        if name not in self._paths:
            self._paths[name] = self._data(name) if "/" in name else self._module(name)
        return self._paths[name]

    def _module(self, name: str) -> str | None:
        """Python's own search, but that it imports no package to look into it."""
        package = name.rpartition(".")[0]
        folders = self._folders.setdefault(name, [])
        specs: list[ModuleSpec | None] = []
        if package:
            self.path(package)
            finders = filter(None, map(pkgutil.get_importer, self._folders[package]))
            specs = [finder.find_spec(name) for finder in finders]
        elif name in sys.modules:
            folders += getattr(sys.modules[name], "__path__", ())
        else:
            with suppress(ImportError, ValueError):
                specs = [importlib.util.find_spec(name)]
        for spec in filter(None, specs):
            folders += spec.submodule_search_locations or ()
            if spec.has_location:
                return spec.origin
        path = getattr(sys.modules.get(name), "__file__", None)
        return path if path and os.path.isfile(path) else None  # noqa: PTH113 - as above

    def _data(self, name: str) -> str | None:
        package, _, inside = name.partition("/")
        self.path(package)
        files = (f"{folder}/{inside}" for folder in self._folders[package])
        return next(filter(os.path.isfile, files), None)
