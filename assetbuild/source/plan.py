"""Where the robot's files come from, as references into the graph."""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Protocol

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import Where
from assetbuild.lock import GitPin, Lock
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.source.get.fetch import Fetch
from assetbuild.source.get.fetch_git import FetchGit
from assetbuild.source.get.fetch_url import FetchUrl
from assetbuild.source.get.from_archive import ArchiveFiles
from assetbuild.source.get.from_folder import FolderFiles
from assetbuild.source.mjcf.includes import ListIncludes
from assetbuild.source.urdf.expand_xacro import INCLUDED, ExpandXacro

SCP_LIKE = re.compile(r"[A-Za-z0-9._-]+@[A-Za-z0-9.-]+:")
"""`git@host:path`, which ssh understands."""


@dataclass(frozen=True)
class Description:
    """The robot's description as URDF or MJCF: its path below the source's root, for errors and
    for relative paths in it, and its file. includes: files that an MJCF may include, by path.
    """

    path: str
    ref: Ref
    includes: Mapping[str, Ref] = field(default_factory=dict)


class SourceFiles(Protocol):
    """A robot's files, each as a reference into the graph. Errors name who asked for a file."""

    def description(self, path: str, where: Where) -> Ref | None:
        """The description below the root; None while that is not known yet."""
        ...

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        """The files that `meshes.json` of the reader lists, by path; None: not known yet."""
        ...

    def below(self, folders: tuple[str, ...], suffixes: tuple[str, ...]) -> dict[str, Ref] | None:
        """All files below the folders with one of the suffixes, by path; None: not known yet."""
        ...

    def present(self, what: str, paths: Collection[str]) -> dict[str, Ref] | None:
        """Those of the paths that are files of the source; None: not known yet.

        what: they are, in two words; each question has its own.
        """
        ...

    def licenses(self) -> dict[str, Ref]:
        """Licence texts that come with the robot, by path."""
        ...


def open_source(loaded: LoadedRecipe, lock: Lock | None, p: Planner) -> SourceFiles:
    """The source that the recipe names. RecipeError when a folder is not there."""
    source = loaded.recipe.source
    if source.path is not None and not p.world.is_file(loaded.path.parent / source.path):
        return FolderFiles(loaded, p)
    return ArchiveFiles(_archive(loaded, lock, p), source.root, source.description, p)


def _archive(loaded: LoadedRecipe, lock: Lock | None, p: Planner) -> Ref:
    """The zip or tar of a source that is no folder."""
    source = loaded.recipe.source
    if source.path is not None:
        return p.source(p.world.plain(loaded.path.parent / source.path))
    step: FetchUrl | FetchGit | Fetch
    if source.url is not None:
        step = FetchUrl(url=source.url, sha256=str(source.sha256))
    else:
        pin = lock.pin_of(source) if lock else None
        assert pin is not None  # noqa: S101 # the pipeline pins moving sources first
        if isinstance(pin, GitPin):
            step = FetchGit(url=repository(loaded), commit=pin.commit, sha256=pin.sha256)
        else:
            step = Fetch(name=pin.name, release=pin.version, filename=pin.file, sha256=pin.sha256)
    return p.add("fetch", step, {})["archive"]


def repository(loaded: LoadedRecipe) -> str:
    """`source.git` as git takes it: an address, or an absolute path."""
    git = str(loaded.recipe.source.git)
    if "://" in git or SCP_LIKE.match(git):
        return git
    return str(loaded.world.real(loaded.path.parent / Path(git).expanduser()))


def description_of(loaded: LoadedRecipe, source: SourceFiles, p: Planner) -> Description | None:
    """The robot's description; None while the source is not listed yet."""
    recipe = loaded.recipe.source
    path = recipe.description
    key = "xacro" if recipe.xacro else "mjcf" if recipe.mjcf else "urdf"
    ref = source.description(path, loaded.where(("source", key)))
    if ref is None:
        return None
    beside = posixpath.dirname(path) or "."
    if recipe.mjcf is not None:
        return _mjcf(path, ref, source, p)
    if recipe.xacro is None:
        return Description(path, ref)
    declared = source.below((beside, *sorted(recipe.packages.values())), INCLUDED)
    if declared is None:
        return None
    step = ExpandXacro(
        file=path,
        args={name: argument_text(value) for name, value in sorted(recipe.args.items())},
        packages=dict(sorted(recipe.packages.items())),
    )
    inputs = {f"tree/{name}": file for name, file in ({path: ref} | declared).items()}
    expanded = p.add("expand_xacro", step, inputs)
    return Description(f"{path} (expanded)", expanded["robot.urdf"])


def _mjcf(path: str, ref: Ref, source: SourceFiles, p: Planner) -> Description | None:
    """With the XML files of its folder, and all further ones that it includes."""
    beside = posixpath.dirname(path) or "."
    includes = source.below((beside,), (".xml",))
    if includes is None or beside == ".":
        return None if includes is None else Description(path, ref, includes)
    for number in count(1):
        inputs = {f"tree/{name}": file for name, file in sorted({path: ref, **includes}.items())}
        listed = p.ask(
            p.add(f"list_includes {number}", ListIncludes(file=path), inputs)["includes.json"]
        )
        found = source.present(f"includes {number}", json.loads(listed)) if listed else None
        if found is None:
            return None
        if not found:
            break
        includes |= found
    return Description(path, ref, includes)


def argument_text(value: str | float | bool) -> str:
    """An argument as xacro's command line would get it."""
    return str(value).lower() if isinstance(value, bool) else str(value)
