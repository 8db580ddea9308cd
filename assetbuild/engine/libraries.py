"""Installed libraries: which distribution brings a module, its version, and what it requires.

Names and versions are read from the folders `numpy-2.1.0.dist-info` that installers leave; what
such a folder holds is read only when the set of these folders has changed.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import canonical_json, digest_bytes

SUFFIXES = (".dist-info", ".egg-info")
_REQUIREMENT = re.compile(r"\s*([\w.-]+)\s*(?:\[([^\]]*)\])?[^;]*;?(.*)", re.DOTALL)
_EXTRA = re.compile(r"""\bextra\s*==\s*["']([^"']+)["']""")


class Libraries:
    """The distributions on `sys.path`, as they are now.

    known: what `to_json` gave earlier; it is used only while the same distributions are installed.
    """

    def __init__(self, known: Mapping[str, Any] | None = None) -> None:  # Any: JSON
        self._folders = _metadata_folders()
        self._stamp = digest_bytes(canonical_json(sorted(map(str, self._folders.values()))))
        known = known if known and known.get("stamp") == self._stamp else {}
        self._owners: dict[str, list[str]] | None = known.get("owners")
        self._needs: dict[str, list[str]] = dict(known.get("needs", {}))
        self._versions: dict[str, str] = {}
        self.is_new = False

    def to_json(self) -> dict[str, object]:
        """Plain data for the next process."""
        return {"stamp": self._stamp, "owners": self._owners, "needs": self._needs}

    def owners(self, module: str) -> tuple[str, ...]:
        """Distributions that install a top-level module; () for the standard library and others.

        An editable installation owns nothing here: its files are code that anyone may edit.
        """
        if self._owners is None:
            self._owners, self.is_new = {}, True
            for name, folder in sorted(self._folders.items()):
                for top in sorted(_tops(folder)):
                    self._owners.setdefault(top, []).append(name)
        return tuple(self._owners.get(module, ()))

    def with_requirements(self, names: Iterable[str]) -> dict[str, str]:
        """Name -> version of these distributions, if installed, and of what they require."""
        found: dict[str, str] = {}
        waiting = list(names)
        while waiting:
            name, _, extra = waiting.pop().partition("[")
            name = _normal(name)
            label = f"{name}[{extra}"
            if name not in self._folders or (name in found and not extra):
                continue
            if label not in self._needs:
                self._needs[label] = list(_requirements(self._folders[name], extra.rstrip("]")))
                self.is_new = True
            found[name] = self.version(name)
            waiting += self._needs[label]
        return dict(sorted(found.items()))

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


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _metadata_folders() -> dict[str, Path]:
    """Normalised name of a distribution -> its metadata; the first on `sys.path` wins."""
    found: dict[str, Path] = {}
    for folder in dict.fromkeys(sys.path):
        try:
            names = sorted(os.listdir(folder or "."))  # noqa: PTH208 - names are enough
        except OSError:
            continue
        for name in names:
            if name.endswith(SUFFIXES):
                found.setdefault(
                    _normal(name.rpartition(".")[0].partition("-")[0]), Path(folder, name)
                )
    return found


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
