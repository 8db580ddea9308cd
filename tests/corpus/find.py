"""The file that a mesh's URI means, where any reader of the field would look for it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def resolved(uri: str, file: Path, folder: Path, packages: Mapping[str, Path]) -> Path | None:
    """The file of a mesh, where any reader of the field would look for it."""
    kind, _, rest = uri.rpartition("://")
    rest = rest.lstrip("/")
    places: list[Path] = []
    if kind == "file":
        places.append(Path("/") / rest)
    if kind in ("package", "model", "file"):
        package, _, inside = rest.partition("/")
        if package in packages:
            places.append(packages[package] / inside)
        places += [parent / inside for parent in above(file, folder) if parent.name == package]
        places += [parent / inside for parent in above(file, folder)]
    places += [parent / rest for parent in above(file, folder)]
    return next((place for place in places if place.is_file()), None)


def above(file: Path, folder: Path) -> list[Path]:
    return [parent for parent in file.parents if parent.is_relative_to(folder)]
