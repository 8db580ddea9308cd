"""Where the robot's files come from, and the steps that read its description."""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from assetbuild.engine.digest import digest_file
from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.engine.world import World
from assetbuild.errors import Where
from assetbuild.lock import GitPin, Lock, Pin
from assetbuild.recipe.models import Recipe
from assetbuild.recipe.source import Source
from assetbuild.recipe.validation import Key, KeyedError
from assetbuild.robot.model import Base
from assetbuild.source.get.fetch import (
    COMMIT,
    Fetch,
    FetchGit,
    FetchUrl,
    OnLine,
    commit_of,
    downloaded_wheel,
    export_commit,
    tree_digest,
)
from assetbuild.source.get.files import ArchiveFiles, FolderFiles
from assetbuild.source.patches import passages, patched
from assetbuild.source.urdf.expand_xacro import MOST_FILES, NOT_INCLUDED, ExpandXacro
from assetbuild.source.urdf.read_urdf import ReadUrdf

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


SourceFiles = ArchiveFiles | FolderFiles
"""A robot's files, each as a reference into the graph. Errors name who asked for a file."""


def open_source(named: Source, folder: Path, lock: Lock | None, p: Planner) -> SourceFiles:
    """The source that a recipe in a folder names. KeyedError when a folder is not there."""
    if named.path is not None and not p.world.is_file(folder / named.path):
        return FolderFiles(named, folder, p)
    return ArchiveFiles(_archive(named, folder, lock, p), named.root, named.description, p)


def _archive(source: Source, folder: Path, lock: Lock | None, p: Planner) -> Ref:
    """The zip or tar of a source that is no folder."""
    if source.path is not None:
        return p.source(p.world.plain(folder / source.path))
    step: FetchUrl | FetchGit | Fetch
    if source.url is not None:
        step = FetchUrl(url=source.url, sha256=str(source.sha256))
    else:
        pin = lock.pin_of(source) if lock else None
        assert pin is not None  # noqa: S101 # the pipeline pins moving sources first
        if isinstance(pin, GitPin):
            step = FetchGit(
                url=repository(source, folder, p.world), commit=pin.commit, sha256=pin.sha256
            )
        else:
            step = Fetch(name=pin.name, release=pin.version, filename=pin.file, sha256=pin.sha256)
    return p.add("fetch", step, {})["archive"]


def repository(source: Source, folder: Path, world: World) -> str:
    """`source.git` as git takes it: an address, or an absolute path."""
    git = str(source.git)
    if "://" in git or SCP_LIKE.match(git):
        return git
    return str(world.real(folder / Path(git).expanduser()))


def resolve(source: Source, folder: Path, world: World, on_line: OnLine) -> Pin | GitPin:
    """Download what a moving source is now, to learn what the lock pins of it.

    folder: of the recipe. on_line: gets pip's own lines while it works ("Downloading ... (131.1
    MB)"). Errors as those of `Fetch` and `FetchGit`.
    """
    with TemporaryDirectory(prefix=".fetch-") as temporary:
        scratch = Path(temporary)
        if source.git is None:
            name, _, version = str(source.pypi).partition("==")
            wheel = downloaded_wheel(name, version, scratch, on_line)
            size, digest = wheel.stat().st_size, digest_file(wheel)
            return Pin(pypi=str(source.pypi), file=wheel.name, sha256=digest, size=size)
        url, rev = repository(source, folder, world), str(source.rev)
        commit = rev if COMMIT.fullmatch(rev) else commit_of(url, rev, scratch)
        target = scratch / "archive.tar"
        export_commit(url, commit, scratch, target)
        size, digest = target.stat().st_size, tree_digest(target)
        return GitPin(git=source.git, rev=rev, commit=commit, sha256=digest, size=size)


def description_of(
    recipe: Source,
    folder: Path,
    where: Callable[[Key], Where],
    source: SourceFiles,
    p: Planner,
) -> Description | None:
    """The robot's description; None while the source is not listed yet.

    folder: of the recipe; where: its keys stand.
    """
    path = recipe.description
    key = "xacro" if recipe.xacro else "mjcf" if recipe.mjcf else "urdf"
    ref = source.description(path, where(("source", key)))
    if ref is None:
        return None
    beside = posixpath.dirname(path) or "."
    texts: dict[str, Ref] | None = {}
    if recipe.mjcf is not None:
        texts = _included(path, ref, source, p)
    elif recipe.xacro is not None:
        folders = (beside, *sorted(recipe.packages.values()))
        texts = source.below(folders, (), NOT_INCLUDED)
    if texts is None or not _are_missing(recipe.missing.visuals, source):
        return None
    if len(texts) > MOST_FILES:
        message = f"{len(texts)} files could be included, more than {MOST_FILES}"
        raise KeyedError(("source", key), message, "name smaller folders in `source.packages`")
    changes = passages(recipe.patches, folder, p.world)
    texts = patched(changes, {path: ref} | texts, p)
    if recipe.xacro is not None:
        step = ExpandXacro(
            file=path,
            args={name: argument_text(value) for name, value in sorted(recipe.args.items())},
            packages=dict(sorted(recipe.packages.items())),
            absent=tuple(sorted(recipe.missing.packages)),
        )
        made = p.add("expand_xacro", step, {f"tree/{name}": text for name, text in texts.items()})
        return Description(f"{path} (expanded)", made["robot.urdf"])
    own = (step for _, step in changes.values() if step.file == path)
    moved = any(step.find.count("\n") != step.replace.count("\n") for step in own)
    shown = f"{path} (patched)" if moved and recipe.urdf else path
    return Description(shown, texts.pop(path), texts)


def _are_missing(stated: Sequence[str], source: SourceFiles) -> bool:
    """Whether that is known; KeyedError for a mesh that is stated as missing and is there."""
    present = source.present("missing meshes", stated) if stated else {}
    for path in present or ():
        key = ("source", "missing", "visuals", stated.index(path))
        raise KeyedError(key, f"`{path}` is in the source", "remove it from the list")
    return present is not None


def _included(path: str, ref: Ref, source: SourceFiles, p: Planner) -> dict[str, Ref] | None:
    """The XML files in the folder of an MJCF, and those that it includes from elsewhere."""
    from assetbuild.source.mjcf.includes import ListIncludes  # of robots from MJCF alone

    beside = posixpath.dirname(path) or "."
    texts = source.below((beside,), (".xml",))
    for number in count(1):
        if texts is None or beside == ".":
            break
        inputs = {f"tree/{name}": file for name, file in sorted({**texts, path: ref}.items())}
        step = p.add(f"list_includes {number}", ListIncludes(file=path), inputs)
        listed = p.ask(step["includes.json"])
        included = source.present(f"includes {number}", json.loads(listed)) if listed else None
        if included is None:
            return None
        if not included:
            break
        texts |= included
    return texts


def argument_text(value: str | float | bool) -> str:
    """An argument as xacro's command line would get it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


@dataclass(frozen=True)
class Reading:
    """What a reader made of the description.

    robot: `links.json` and `shapes.json`. meshes: listing of the files it names; files: those
        of an MJCF by path, which its reader has asked for already.
    control: `source_control.json` of an MJCF. urdf: the untouched description, when it is one.
    mjcf: `source.xml` and its meshes as a check finds them, by input name.
    """

    robot: Mapping[str, Ref]
    meshes: Ref
    files: Mapping[str, Ref] | None = field(default=None, kw_only=True)
    source_map: Ref
    control: Ref | None = None
    urdf: Ref | None = None
    mjcf: Mapping[str, Ref] = field(default_factory=dict)


def read_description(
    recipe: Recipe, source: SourceFiles, description: Description, p: Planner
) -> Reading | None:
    """The steps that read the robot; None while an answer is missing."""
    if recipe.source.mjcf is not None:
        return _read_mjcf(recipe, source, description, p)
    step = urdf_reader(recipe.source, description.path, recipe.base)
    read = p.add("read_urdf", step, {"robot.urdf": description.ref})
    return Reading(
        robot={port: read[port] for port in ("links.json", "shapes.json")},
        meshes=read["meshes.json"],
        source_map=read["source_map.json"],
        urdf=read["source.urdf"],
    )


def urdf_reader(origin: Source, file: str, base: Base) -> ReadUrdf:
    """The step that reads a URDF, or an expanded xacro, which messages call `file`."""
    return ReadUrdf(
        file=file,
        base=base,
        packages=dict(sorted(origin.packages.items())),
        relative_to=origin.relative_to,
        absolute=dict(sorted(origin.absolute.items())),
        missing=tuple(sorted(origin.missing.visuals)),
    )


def _read_mjcf(
    recipe: Recipe, source: SourceFiles, description: Description, p: Planner
) -> Reading | None:
    from assetbuild.source.mjcf.flatten_mjcf import FOLDER, FlattenMjcf  # as above
    from assetbuild.source.mjcf.read_mjcf import ReadMjcf

    tree = {description.path: description.ref} | dict(description.includes)
    inputs = {f"tree/{path}": ref for path, ref in sorted(tree.items())}
    step = FlattenMjcf(file=description.path, body=recipe.source.body)
    if "grammar" in recipe.stated("mjcf"):
        step = step.model_copy(update={"grammar": recipe.value("mjcf.grammar")})
    flat = p.add("flatten_mjcf", step, inputs)
    answer = p.ask(flat["meshes.json"])
    listed = json.loads(answer) if answer is not None else []
    source_meshes = [entry for entry in listed if not entry["path"].startswith(FOLDER)]
    files = source.meshes(source_meshes, description.path) if answer is not None else None
    if files is None:
        return None
    made = (entry["path"] for entry in listed if entry not in source_meshes)
    files = {**files, **{path: flat["inline/"] / path.removeprefix(FOLDER) for path in made}}
    given = {"source.xml": flat["source.xml"]}
    given |= {f"files/{path}": ref for path, ref in files.items()}
    # Without the key the source itself says whether its root floats.
    base = recipe.base if "base" in recipe.model_fields_set else None
    read = p.add("read_mjcf", ReadMjcf(base=base), {**given, "lines.json": flat["lines.json"]})
    return Reading(
        robot={port: read[port] for port in ("links.json", "shapes.json")},
        meshes=flat["meshes.json"],
        files=files,
        source_map=flat["source_map.json"],
        control=read["source_control.json"],
        mjcf=given,
    )
