"""Where modules lie, and installed libraries: which distribution brings one, and what it requires.

Names and versions are read from the folders `numpy-2.1.0.dist-info` that installers leave; what
such a folder holds is read only when the set of these folders has changed.
"""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import canonical_json, digest_bytes

SUFFIXES = (".dist-info", ".egg-info")
_REQUIREMENT = re.compile(r"\s*([\w.-]+)\s*(?:\[([^\]]*)\])?[^;]*;?(.*)", re.DOTALL)
_EXTRA = re.compile(r"""\bextra\s*==\s*["']([^"']+)["']""")


@dataclass
class _Read:
    """What the metadata hold. owners: top-level module -> distributions; needs: by requirement."""

    owners: dict[str, list[str]] | None = None
    needs: dict[str, list[str]] = field(default_factory=dict)


_READ: dict[str, _Read] = {}
"""By the set of installed distributions."""


class Libraries:
    """The distributions on `sys.path`, as they are now.

    known: what `to_json` gave earlier; it is used only while the same distributions are installed.
    """

    def __init__(self, known: Mapping[str, Any] | None = None) -> None:  # Any: JSON
        self._folders = _metadata_folders()
        self._stamp = digest_bytes(canonical_json(sorted(map(str, self._folders.values()))))
        if self._stamp not in _READ:
            _READ[self._stamp] = _earlier(known, self._stamp)
        self._read = _READ[self._stamp]
        self._versions: dict[str, str] = {}
        self.is_new = False

    def to_json(self) -> dict[str, object]:
        """Plain data for the next process."""
        return {"stamp": self._stamp, "read": vars(self._read)}

    def owners(self, module: str) -> tuple[str, ...]:
        """Distributions that install a top-level module; () for the standard library and others.

        An editable installation owns nothing here: its files are code that anyone may edit.
        """
        if self._read.owners is None:
            owners: dict[str, list[str]] = {}
            for name, folder in sorted(self._folders.items()):
                for top in sorted(_tops(folder)):
                    owners.setdefault(top, []).append(name)
            self._read.owners, self.is_new = owners, True
        return tuple(self._read.owners.get(module, ()))

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
            versions[name] = self.version(name)
            if label not in self._read.needs:
                self._read.needs[label] = list(_requirements(self._folders[name], extra))
                self.is_new = True
            fresh = [each for each in self._read.needs[label] if each not in seen]
            seen.update(fresh)
            waiting += fresh
        return dict(sorted(versions.items()))

    def is_there(self, name: str) -> bool:
        """Whether a distribution is still installed in the version that it had."""
        return self._folders[name].exists()

    def version(self, name: str) -> str:
        """The version of an installed distribution, or `not installed`."""
        folder = self._folders.get(_normal(name))
        if folder is None:
            return "not installed"
        if name not in self._versions:
            stem = folder.name.removesuffix(".dist-info")
            _, dash, version = stem.partition("-")
            self._versions[name] = (
                version
                if dash and stem != folder.name
                else metadata.Distribution.at(folder).version
            )
        return self._versions[name]


def _earlier(known: Mapping[str, Any] | None, stamp: str) -> _Read:  # Any: JSON
    """What an earlier process read, if it was about these distributions."""
    try:
        if known is not None and known["stamp"] == stamp:
            read = known["read"]
            return _Read({k: list(v) for k, v in read["owners"].items()}, dict(read["needs"]))
    except (KeyError, TypeError, ValueError, AttributeError):
        pass
    return _Read()


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


def _requirements(folder: Path, extra: str) -> Iterator[str]:
    """`name` or `name[extra]` of what a distribution requires always, or for one of its extras."""
    for text in metadata.Distribution.at(folder).requires or ():
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
        self._paths: dict[str, str | None] = {}
        self._folders: dict[str, list[str]] = {}
        self._listings: dict[str, frozenset[str]] = {}

    def path(self, name: str) -> str | None:
        """The file of a module, or of `package/file.css`; None when there is none."""
        if name not in self._paths:
            if "/" in name:
                self._paths[name] = self._data(name)
            elif "." not in name:
                self._paths[name] = self._top(name)
            else:
                self._paths[name] = self._inside(*name.rsplit(".", 1)) or _loaded_from(name)
        return self._paths[name]

    def _top(self, name: str) -> str | None:
        module = sys.modules.get(name)
        if module is not None:
            self._folders[name] = [*getattr(module, "__path__", ())]
            return _loaded_from(name)
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            return None
        if spec is None:
            return None
        self._folders[name] = list(spec.submodule_search_locations or ())
        return spec.origin if spec.has_location else None

    def _inside(self, package: str, name: str) -> str | None:
        self.path(package)
        for folder in self._folders.get(package, ()):
            names, whole = self._listing(folder), f"{folder}/{name}"
            if name in names:
                inside = self._listing(whole)
                self._folders.setdefault(f"{package}.{name}", []).append(whole)
                if "__init__.py" in inside:
                    return f"{whole}/__init__.py"
            for suffix in (".py", *EXTENSION_SUFFIXES):
                if name + suffix in names:
                    return whole + suffix
        return None

    def _data(self, name: str) -> str | None:
        package, _, inside = name.partition("/")
        self.path(package)
        files = (f"{folder}/{inside}" for folder in self._folders.get(package, ()))
        return next(filter(os.path.isfile, files), None)

    def _listing(self, folder: str) -> frozenset[str]:
        if folder not in self._listings:
            try:
                self._listings[folder] = frozenset(os.listdir(folder))  # noqa: PTH208 - names
            except OSError:
                self._listings[folder] = frozenset()
        return self._listings[folder]


def _loaded_from(name: str) -> str | None:
    path = getattr(sys.modules.get(name), "__file__", None)
    return path if path and os.path.isfile(path) else None  # noqa: PTH113 - as above
