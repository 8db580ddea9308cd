"""What lies around a description: packages and what other file names mean, and its licence."""

from __future__ import annotations

import filecmp
import functools
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from assetbuild.errors import UsageError
from assetbuild.recipe.loader import shown_path
from assetbuild.recipe.source import Patch
from assetbuild.source.urdf.xml import Node, parse

LEVELS = 12
"""Folders above the URDF that are looked at for a package: a tree of files, not a disk."""

NEAR, DEEPEST, MOST_FOLDERS = 4, 5, 20_000
"""Folders above a file in no repository below which packages are looked for; how deep, and how many
folders below each."""

PACKAGE = re.compile(r"(?:package|model):/*([^/]+)/(.+)")
_NAMED = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
Uses = list[tuple[str, Node]]
"""(uri, element) of meshes and textures."""


def files_named(root: Node) -> Uses:
    """Every mesh and texture of a description."""
    elements = root.element.iter("mesh", "texture")
    named = [((element.get("filename") or "").strip(), element) for element in elements]
    return [(uri, Node(element, root.file)) for uri, element in named if uri]


def find_packages(uses: Uses, file: Path, known: Mapping[str, Path]) -> dict[str, Path]:
    """The folder of every package that a `package://` names: as known, else searched.

    SourceError with the line where one is not found.
    """
    inside: dict[str, Uses] = {}
    for uri, node in uses:
        if match := PACKAGE.fullmatch(uri):
            inside.setdefault(match[1], []).append((match[2], node))
    return {name: known.get(name) or _searched(name, inside[name], file) for name in inside}


def above(file: Path) -> list[Path]:
    """The folders above a file that are looked at, the nearest first."""
    return list(file.parents)[:LEVELS]


def stated_folder(name: str, folder: Path) -> Path:
    """The folder of a `--package`; UsageError when it is none."""
    if not folder.is_dir():
        message = f"--package {name}={folder}: there is no such folder"
        raise UsageError(message, hint="it is the folder that `package://" + name + "/` stands for")
    return Path(os.path.realpath(folder))


def package_folders(name: str, file: Path) -> Iterator[list[Path]]:
    """Where a package may lie, the likeliest first; several folders are equally likely.

    A folder above the file that has its name or declares it; one beside those of its name; one that
    declares it, anywhere below a folder above the file.
    """
    folders = above(file)
    for folder in folders:
        if folder.name == name or declared(folder) == name:
            yield [folder]
    for folder in folders:
        if (folder / name).is_dir():
            yield [folder / name]
    for folder in in_repository(folders, NEAR):
        if candidates := packages_below(folder).get(name):
            yield list(candidates)


def find_package(name: str, file: Path) -> Path | None:
    """The one folder of a package; None where there is none, or it is not clear which."""
    folders = next(package_folders(name, file), [])
    return Path(os.path.realpath(folders[0])) if len(folders) == 1 else None


def folders_inside(package: Path, path: str) -> list[Path]:
    """The folders of a package that hold a file: CMake may install what is in them one level up."""
    return [folder for folder in sorted(package.glob("*/")) if is_file(folder / path)]


def _searched(name: str, inside: Uses, file: Path) -> Path:
    """The likeliest folder that holds the files; at last one above the URDF under another name."""
    node = inside[0][1]
    uri = (node.element.get("filename") or "").strip()
    declaring = [*package_folders(name, file)]
    inner = [folders_inside(here, inside[0][0]) for folders in declaring for here in folders]
    for folders in (*declaring, *inner, *([folder] for folder in above(file))):
        # Under its name, or what that is percent-encoded from.
        named = {name for path, _ in inside for name in (path, unquote(path))}
        holding = [folder for folder in folders if any(is_file(folder / name) for name in named)]
        if len(holding) > 1:
            choices = " or ".join(f"`--package {name}={shown_path(f)}`" for f in holding)
            raise node.error(f"`{uri}`: {len(holding)} folders are package `{name}`", choices)
        if holding:
            return Path(os.path.realpath(holding[0]))
    known = next(package_folders(name, file), [])
    if len(known) == 1 and any(other_case(known[0], path) for path, _ in inside):
        return Path(os.path.realpath(known[0]))  # the names are patched when the meshes are read
    if known:
        lack, hint = lacking(known[0], inside[0][0])
        hint = hint or f"add the file, or say where the package is: `--package {name}=FOLDER`"
        raise node.error(
            f"`{uri}`: package `{name}` is `{shown_path(known[0])}`, which holds {lack}", hint
        )
    raise node.error(
        f"`{uri}`: no folder above the URDF holds the package `{name}`",
        f"say where it is: `--package {name}=FOLDER`",
    )


def other_case(root: Path, path: str) -> PurePosixPath | None:
    """The one file of that name but for case and percent-encoding, below a root."""
    paths = [PurePosixPath()]
    for part in PurePosixPath(unquote(path)).parts:
        paths = [
            here / entry.name
            for here in paths
            if (root / here).is_dir()
            for entry in (root / here).iterdir()
            if entry.name.lower() == part.lower()
        ]
    return paths[0] if len(paths) == 1 else None


def lacking(root: Path, path: str) -> tuple[str, str]:
    """The first part of a path below a folder that is not there; where such a file is, or ""."""
    here, (*folders, name) = root, PurePosixPath(path).parts
    lack = f"no file `{name}`"
    for folder in folders:
        if not (here / folder).is_dir():
            lack = f"no folder `{folder}`"
            break
        here = here / folder
    if here != root:
        lack += f" in `{here.relative_to(root).as_posix()}`"
    circles = [here, *(above for above in here.parents if above.is_relative_to(root))]
    for top in circles[:NEAR]:
        walked = ((at, one) for at, names in _walk(top) for one in names)
        if files := [at / one for at, one in walked if one.lower() == name.lower()]:
            others = f", and {len(files) - 1} more of that name" if len(files) > 1 else ""
            return lack, f"is `{files[0].relative_to(root).as_posix()}` meant{others}?"
        if declared(top):
            break  # what another package calls alike is another robot's
    return lack, ""


def in_repository(folders: Sequence[Path], otherwise: int) -> Sequence[Path]:
    """Cut the folders above a file off at its repository; `otherwise` counts them without one."""
    tops = [number for number, folder in enumerate(folders, 1) if (folder / ".git").exists()]
    return folders[: tops[0] if tops else otherwise]


@functools.lru_cache(maxsize=64)
def packages_below(top: Path) -> Mapping[str, tuple[Path, ...]]:
    """Every package that a `package.xml` below a folder declares; nothing behind links."""
    packages: dict[str, tuple[Path, ...]] = {}
    for here, names in _walk(top):
        if "package.xml" in names and (name := declared(here)):
            packages[name] = (*packages.get(name, ()), here)
    return packages


def _walk(top: Path) -> Iterator[tuple[Path, list[str]]]:
    """The folders at most `DEEPEST` below one, with the names of their files; no links."""
    for count, (here, folders, names) in enumerate(os.walk(top)):
        deep = len(Path(here).relative_to(top).parts)
        folders[:] = [] if deep >= DEEPEST else sorted(f for f in folders if f[0] != ".")
        yield Path(here), names
        if count > MOST_FOLDERS:
            break


def declared(folder: Path) -> str | None:
    """The name in its package.xml."""
    manifest = folder / "package.xml"
    match = _NAMED.search(start_of(manifest, 1 << 16)) if is_file(manifest) else None
    return match and match[1]


def start_of(path: Path, most: int) -> str:
    """The first bytes of a file as text; none of one that cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(most).decode("utf-8", "replace")
    except OSError:
        return ""


def is_file(path: Path) -> bool:
    """A name that is too long for the disk is that of no file; pathlib raises."""
    try:
        return path.is_file()
    except OSError:
        return False


def common_folder(
    file: Path, folders: Iterable[Path], uses: Uses, start: Path | None = None
) -> Path:
    """The lowest folder that holds the URDF, its packages and what relative names lead to.

    start: where relative names begin, if not at the URDF's folder.
    """
    begin = start or file.parent
    names = [uri for uri, _ in uses if ":" not in uri and not uri.startswith("/")]
    ways = [highest(begin, PurePosixPath(name)) for name in names]
    return Path(os.path.commonpath([file.parent, begin, *folders, *ways]))


def highest(folder: Path, name: PurePosixPath) -> Path:
    """The highest folder on the way: `../../pkg/a.stl` leaves `pkg` and comes back to it."""
    way = [folder]
    for part in name.parts:
        way.append(way[-1].parent if part == ".." else way[-1] / part)
    return min(way, key=lambda each: len(each.parts))


SHORTEST = 2
"""Names at the end of an absolute path that must agree: a file's name alone proves nothing."""

_FIND = re.compile(r"^(?:(?:file|package):/*)?\$\(\s*find\s+([^)\s]+)\s*\)/*")
SPELLINGS: tuple[tuple[str, Callable[[str], str]], ...] = (
    (
        "xacro and ROS 1 launch files know `$(find ...)`, readers of URDF do not",
        lambda uri: _FIND.sub(r"package://\1/", uri),
    ),
    (
        "no package is named: pinocchio reads such names from each package's folder",
        lambda uri: re.sub("^package:///(?=[^/]*$)", "", uri),
    ),
    ("only Windows reads a backslash as the end of a folder", lambda uri: uri.replace("\\", "/")),
)
"""Names of files as a URDF's readers spell them, and why."""


def replaced(data: bytes, patches: Iterable[Patch]) -> bytes:
    """The text behind its patches."""
    for patch in patches:
        data = data.replace(str(patch.find).encode(), str(patch.replace).encode())
    return data


def respelled(file: Path, data: bytes) -> list[Patch]:
    """Patches for the names of a URDF that none of its readers follow as they stand."""
    made = list[Patch]()
    for uri in dict.fromkeys(uri for uri, _ in files_named(parse(data, shown_path(file))[0])):
        for because, spelled in SPELLINGS:
            if (named := spelled(uri)) != uri:
                made += renamings(file.name, data, uri, named, because)
                break
    return made


def renamings(file: str, data: bytes, old: str, new: str, because: str) -> Iterator[Patch]:
    """A patch of a name wherever it stands in quotes."""
    text = data.decode("utf-8", "replace")
    for mark in "\"'":
        if times := text.count(f"{mark}{old}{mark}"):
            find, replace = f"{mark}{old}{mark}", f"{mark}{new}{mark}"
            yield Patch(file=file, find=find, replace=replace, times=times, because=because)


def relative_start(uses: Uses, file: Path) -> Path | None:
    """The folder above the URDF that relative names start from; None: its own folder.

    The nearest that holds the most of them. SourceError where two folders hold other bytes.
    """
    names = {uri: node for uri, node in uses if ":" not in uri and not uri.startswith("/")}
    folders = above(file)
    held = {folder: [uri for uri in names if is_file(folder / uri)] for folder in folders}
    best = max(folders, key=lambda folder: len(held[folder]))  # of equals the first
    if best == file.parent:
        return None
    for folder in folders:
        for uri in held[folder]:
            if is_file(best / uri) and not filecmp.cmp(folder / uri, best / uri, shallow=False):
                first, second = (shown_path(one / uri) for one in (folder, best))
                raise names[uri].error(
                    f"relative names are taken from a folder above the URDF, where `{uri}` is two "
                    f"files: `{first}` and `{second}`",
                    "remove the one that is not meant, or write the names from the URDF's folder",
                )
    return best


def absolute_folders(uses: Uses, file: Path) -> dict[str, Path]:
    """Folder of the author's machine -> the folder here, for absolute names of files.

    Found by the longest end of the name that is a file here. SourceError with the line where none
    is, or several files are.
    """
    roots: dict[str, Path] = {}
    lost: Uses = []
    for uri, node in uses:
        path = absolute_path(uri)
        begun = [of for of in roots if path is not None and path.startswith(f"{of}/")]
        if path is None or any(is_file(roots[of] / path[len(of) + 1 :]) for of in begun):
            continue
        hits = list(_hits(path, file))
        if not hits:
            lost.append((path, node))
            continue
        length = max(length for length, _ in hits)
        longest = [here for count, here in hits if count == length]
        if any(not filecmp.cmp(longest[0], other, shallow=False) for other in longest):
            choices = " or ".join(f"`{shown_path(here)}`" for here in longest)
            raise node.error(f"`{uri}` may be {choices}", "remove the one that is not meant")
        # The same file may be reached from several folders above: the nearest says the least.
        near = min(count for count, here in hits if here == longest[0])
        roots[str(PurePosixPath(*PurePosixPath(path).parts[:-near]))] = longest[0].parents[near - 1]
    for path, node in lost:
        if not any(path.startswith(f"{known}/") for known in roots):
            raise node.error(
                f"`{path}` is on the author's machine, and no folder above the URDF holds the end "
                "of it",
                "add the file, or write `package://NAME/path` (and `--package NAME=FOLDER`)",
            )
    return roots


def absolute_path(uri: str) -> str | None:
    """`/home/me/arm.stl` of that name or of `file:///home/me/arm.stl`; None for others.

    `file://meshes/arm.stl` has two slashes and starts from the URDF.
    """
    match = re.fullmatch(r"(?:file:(?://(?=/)|(?!//)))?(/.*)", uri)
    return None if match is None else os.path.normpath("/" + match[1].lstrip("/"))


def _hits(path: str, file: Path) -> Iterator[tuple[int, Path]]:
    """(names that agree, file here) of every end of the path that is a file here."""
    parts = PurePosixPath(path).parts[1:]
    for count in range(len(parts) - 1, SHORTEST - 1, -1):
        tail = PurePosixPath(*parts[-count:])
        for folder in above(file):
            if is_file(folder / tail):
                yield count, Path(os.path.realpath(folder)) / tail
        package = find_package(parts[-count], file) if count > SHORTEST else None
        if package is not None and is_file(package.joinpath(*parts[-count + 1 :])):
            yield count - 1, package.joinpath(*parts[-count + 1 :])
