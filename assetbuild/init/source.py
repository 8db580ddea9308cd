"""What file the user gave, where the robot's other files lie, and patches for what no build reads.

One folder holds them all. A xacro is expanded by the step of the build, in the same confined child.
"""

from __future__ import annotations

import itertools
import json
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from assetbuild.engine.scratch import scratch
from assetbuild.engine.world import World
from assetbuild.errors import SourceError, UsageError, Where, nearest, quoted
from assetbuild.findings import Finding
from assetbuild.init.packages import (
    NEAR,
    above,
    absolute_folders,
    common_folder,
    declared,
    files_named,
    find_package,
    find_packages,
    folders_inside,
    highest,
    in_repository,
    is_file,
    lacking,
    other_case,
    packages_below,
    relative_start,
    renamings,
    replaced,
    respelled,
    stated_folder,
)
from assetbuild.recipe.loader import read_small_file, shown_path
from assetbuild.recipe.source import Missing, Patch, Source
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import MeshFile, SourceShapes
from assetbuild.source.plan import urdf_reader
from assetbuild.source.urdf.expand_xacro import (
    ARGUMENT,
    MOST_FILES,
    NOT_INCLUDED,
    WHERE,
    ExpandXacro,
)
from assetbuild.source.urdf.joints import KINDS
from assetbuild.source.urdf.links import FORMATS
from assetbuild.source.urdf.xml import XACRO, Node, parse, read_xml


@dataclass(frozen=True)
class UrdfSource:
    """recipe: its section `source`, whose paths are below `root`: absolute, without links.

    data: the description, a xacro's expanded. defaults: of all arguments that the xacro declares,
    as it spells them.
    """

    root: Path
    recipe: Source
    data: bytes
    defaults: Mapping[str, str]

    @property
    def shown(self) -> str:
        """The description's name in messages, as a build would give it."""
        return f"{self.recipe.xacro} (expanded)" if self.recipe.xacro else str(self.recipe.urdf)

    def read(self) -> tuple[Tree, SourceShapes, tuple[Finding, ...], list[dict[str, str]]]:
        """Run the build's reader; return links, shapes, findings and the meshes that it lists."""
        step = urdf_reader(self.recipe, self.shown, "floating")
        with scratch() as ports:
            ports.put("robot.urdf", self.data)
            findings, robot = ports.run(step), RobotFiles(ports.folder)
            meshes = json.loads(ports.read("meshes.json"))
            return robot.links, robot.source_shapes, findings, meshes


def find_source(
    file: Path, packages: Mapping[str, Path], args: Mapping[str, str] | None = None
) -> UrdfSource:
    """Read the description and find what its file names mean.

    Raises SourceError where a package is not found, UsageError for a `--package` that is no
    folder and for `--arg` without a xacro.
    """
    packages_below.cache_clear()  # the files may have changed since another robot was read
    args, name = args or {}, shown_path(file)
    data = read_small_file(file, SourceError)
    folders = {name: stated_folder(name, folder) for name, folder in packages.items()}
    real = Path(os.path.realpath(file))
    by_xacro = file.suffix == ".xacro" or any(found[1] for found in _MACRO.finditer(data))
    patches = [] if by_xacro else respelled(real, data)
    data = replaced(data, patches)
    if args and not by_xacro:
        raise UsageError("`--arg` is for a xacro file", where=Where(name), hint="leave it out")
    made: Expanded = expand(real, folders, args) if by_xacro else (data, {}, {}, ())
    data, asked, defaults, absent = made
    uses = files_named(parse(data, name)[0])
    used = {**folders, **asked}
    used |= find_packages(uses, real, used)
    start, absolute = relative_start(uses, real), absolute_folders(uses, real)
    root = common_folder(real, (*used.values(), *absolute.values()), uses, start)
    path = real.relative_to(root).as_posix()
    stated = Source.model_construct(
        path=".",
        xacro=path if by_xacro else None,
        urdf=None if by_xacro else path,
        args=dict(args),
        packages={name: used[name].relative_to(root).as_posix() for name in sorted(used)},
        relative_to=start.relative_to(root).as_posix() if start else None,
        absolute={of: to.relative_to(root).as_posix() for of, to in sorted(absolute.items())},
        missing=Missing.model_construct(packages=absent),
        patches=tuple(patch.model_copy(update={"file": path}) for patch in patches),
    )
    return UrdfSource(root, stated, data, defaults)


# --- a xacro --------------------------------------------------------------------------------

MOST_TRIES = 60
"""Packages that are asked for, one after another."""

_MACRO = re.compile(rb"<!--.*?-->|(<xacro:|=\s*[\"'][^\"'<>]*\$\{)", re.DOTALL)
"""Comments, and as its group a tag or an attribute that xacro alone understands."""
_ASKED = re.compile(r"`\$\(find ([^`]+)\)`: no package")
_OUTSIDE = re.compile(r"wants to read `[^`]*?/tree/([^`]+)`")
_MISSING = re.compile(r"no file `([^`]+)` among the readable files")
_ABSENT = re.compile(r"of the package `([^`]+)`, which is stated as missing")

Expanded = tuple[bytes, Mapping[str, Path], Mapping[str, str], tuple[str, ...]]
"""The URDF, the folders of the packages in use, `defaults` of `UrdfSource`, absent packages."""


def expand(file: Path, stated: Mapping[str, Path], args: Mapping[str, str]) -> Expanded:
    """Expand a file with its arguments. Raises SourceError as the build would, in words of `init`.

    file: real path. A package that it asks for is found by expanding it again and again. One that
    is found nowhere is an error only where the robot needs its files.
    """
    folders, absent = dict(stated), list[str]()
    for _ in range(MOST_TRIES):
        try:
            return _expanded(file, folders, args, absent)
        except SourceError as error:
            _mend(error, file, folders, absent)
    raise SourceError(f"it asks for more than {MOST_TRIES} things by computed names")


def _expanded(
    file: Path, folders: Mapping[str, Path], args: Mapping[str, str], missing: Collection[str]
) -> Expanded:
    """One expansion. missing: packages that were found nowhere."""
    root = common_folder(file, folders.values(), [])
    step = ExpandXacro(
        file=file.relative_to(root).as_posix(),
        args=dict(sorted(args.items())),
        packages={name: f.relative_to(root).as_posix() for name, f in sorted(folders.items())},
        absent=tuple(sorted(missing)),
    )
    with scratch() as ports:
        ports.link(f"tree/{step.file}", file)
        for folder in (file.parent, *folders.values()):
            for path in itertools.islice(World().below(folder, (), NOT_INCLUDED), MOST_FILES):
                if path.is_file() and not path.is_symlink():
                    ports.link(f"tree/{path.relative_to(root)}", path)
        for finding in ports.run(step):
            if finding.rule == ARGUMENT.id:
                name = finding.data["argument"]
                raise SourceError(f"--arg {name}: {finding.message}", hint=finding.hint)
        urdf = ports.read("robot.urdf")
        used = json.loads(ports.read("used.json"))
    text, files = urdf.decode("utf-8"), [root / name for name in used["files"]]
    needed = {
        name: folder
        for name, folder in folders.items()
        if f"package://{name}/" in text
        or name in used["packages"]
        or any(path.is_relative_to(folder) for path in files)
    }
    absent = tuple(sorted({*missing} & {*used["packages"]}))
    return urdf, needed, _defaults([file, *files]), absent


def _mend(error: SourceError, file: Path, folders: dict[str, Path], absent: list[str]) -> None:
    """Find what an expansion lacked; raise the error, in words of `init`, where that cannot be."""
    if asked := _ASKED.search(error.message):
        folder = find_package(asked[1], file)
        if folder is None:
            absent.append(asked[1])
        else:
            folders[asked[1]] = folder
    elif own := _own_package(error, file, folders) or _inner_package(error, file, folders):
        folders |= own
    elif absent_package := _ABSENT.search(error.message):  # stated as missing by no recipe yet
        name = absent_package[1]
        message = f"`$(find {name})`: no package named `{name}`"
        raise SourceError(message, where=error.where, hint=WHERE)
    else:
        raise error


def _own_package(error: SourceError, file: Path, folders: Mapping[str, Path]) -> dict[str, Path]:
    """The package that the file lies in, where it includes from there by a relative name.

    Where no package.xml says so, it is the highest folder on the way, in the file's repository.
    """
    if "readable files" not in error.message and "declared packages" not in error.message:
        return {}
    here, name = next(((f, name) for f in above(file) if (name := declared(f))), (file, ""))
    if not name and (outside := _OUTSIDE.search(error.message)):
        start = common_folder(file, folders.values(), [])
        here = highest(start, PurePosixPath(outside[1]))
        if is_file(start / outside[1]) and here in in_repository(above(file), NEAR):
            name = here.name
    known = here in folders.values() or name in folders
    return {name: here} if name and not known else {}


def _inner_package(error: SourceError, file: Path, folders: Mapping[str, Path]) -> dict[str, Path]:
    """The one folder of a package that holds what was looked for beside its `package.xml`."""
    missing = _MISSING.search(error.message)
    path = common_folder(file, folders.values(), []) / missing[1] if missing else file
    for name, folder in folders.items():
        if missing and path.is_relative_to(folder):
            inner = folders_inside(folder, path.relative_to(folder).as_posix())
            if len(inner) == 1:
                return {name: inner[0]}
    return {}


def _defaults(files: list[Path]) -> dict[str, str]:
    """Every `<xacro:arg>` of the files that were read, in that order; "" without a default."""
    defaults: dict[str, str] = {}
    for path in files:
        try:
            root, _ = read_xml(path.read_bytes(), path.name, "xacro")
        except SourceError:
            continue  # xacro has read it; only the list of arguments is shorter
        for element in root.iter(*(f"{{{uri}}}arg" for uri in XACRO)):
            if name := element.get("name"):
                defaults.setdefault(name, element.get("default", ""))
    return defaults


# --- a URDF ---------------------------------------------------------------------------------

NO_LIMIT = (
    "it states no <limit>, which urdfdom and PyBullet refuse; MuJoCo and Isaac Sim let it turn "
    "without end: give it a range where it has one"
)
SPELLED = "readers know this type in small letters alone"


def patched(source: UrdfSource, patches: Iterable[Patch]) -> UrdfSource:
    """The source behind the patches; only a URDF says its names in its own text."""
    made = tuple(patches)
    recipe = source.recipe.model_copy(update={"patches": (*source.recipe.patches, *made)})
    return replace(source, data=replaced(source.data, made), recipe=recipe)


def retyped(source: UrdfSource) -> Iterator[Patch]:
    """A patch for each joint whose type no build takes as it stands; none of a xacro."""
    for joint in parse(source.data, source.shown)[0].all("joint") if source.recipe.urdf else ():
        kind = joint.get("type") or ""
        if kind == "revolute" and joint.only("limit") is None:
            yield from _of_type(source, joint, "continuous", NO_LIMIT)
        elif kind not in KINDS and kind.strip().lower() in KINDS:
            yield from _of_type(source, joint, kind.strip().lower(), SPELLED)


def _of_type(source: UrdfSource, joint: Node, kind: str, because: str) -> Iterator[Patch]:
    """A patch of the joint's start tag; none where the text has no such tag, or several."""
    text, name = source.data.decode("utf-8", "replace"), re.escape(joint.get("name") or "")
    tag = rf"<joint\b(?=[^<>]*\sname\s*=\s*[\"']{name}[\"'])[^<>]*\stype\s*=\s*[\"'][^<>\"']*[\"']"
    tags = re.findall(tag, text)
    if len(tags) == 1 and text.count(tags[0]) == 1:
        new = re.sub(r"(\stype\s*=\s*)([\"'])[^\"']*\2", rf"\g<1>\g<2>{kind}\g<2>", tags[0])
        yield Patch(file=source.recipe.urdf, find=tags[0], replace=new, because=because)


CASE = "upper and lower case and percent-encoding count: this is how the file is called"


def mended(source: UrdfSource) -> UrdfSource:
    """The source with patches for names and types, and what it lacks stated as missing.

    A visual mesh may be missing, a collision mesh may not. SourceError with file and line for what
    no recipe can mend.
    """
    source = patched(source, retyped(source))
    _, shapes, _, meshes = source.read()
    if cases := tuple(_cases(source, meshes)):
        source = patched(source, cases)
        _, shapes, _, meshes = source.read()
    collide = [shape.geometry for shape in shapes.of("collision")]
    solid = {mesh.path for mesh in collide if isinstance(mesh, MeshFile)}
    absent = [mesh for mesh in meshes if not is_file(source.root / mesh["path"])]
    needed = [mesh for mesh in absent if mesh["path"] in solid]
    if needed or (absent and len(absent) == len(meshes)):
        raise _refused(source, needed or absent, {mesh["path"] for mesh in meshes})
    visuals = tuple(mesh["path"] for mesh in absent)
    missing = source.recipe.missing.model_copy(update={"visuals": visuals})
    return replace(source, recipe=source.recipe.model_copy(update={"missing": missing}))


def _refused(
    source: UrdfSource, absent: list[dict[str, str]], named: Collection[str]
) -> SourceError:
    """A build would stop there too, at the first; here all are named.

    named: the paths of all meshes; what the source names elsewhere is not what was meant here.
    """
    first, others = absent[0], [mesh["path"] for mesh in absent[1:]]
    near = (source.root / first["path"]).parent
    beside = sorted(near.iterdir()) if near.is_dir() else ()
    meshes = [file.name for file in beside if file.suffix[1:].lower() in FORMATS]
    names = [str(PurePosixPath(first["path"]).parent / name) for name in meshes]
    parts = {name for name in names if _unnumbered(name) != _unnumbered(first["path"])}
    close = nearest(first["path"], parts - set(named))
    lack, meant = lacking(source.root, first["path"])
    more = f" (and {len(others)} more: {quoted(others, 3)})" if others else ""
    return SourceError(
        f"{first['subject']}: no file `{first['path']}`{more}",
        where=Where(source.shown, int(first["line"])),
        hint=f"did you mean `{close}`?"
        if close
        else meant or f"the source holds {lack}: copy or clone all of it",
    )


def _unnumbered(name: str) -> str:
    """The name without its numbers: `link_3` is no misspelt `link_2`, but another part."""
    return re.sub(r"\d+", "", name)


# --- patches --------------------------------------------------------------------------------


def _cases(source: UrdfSource, meshes: Sequence[dict[str, str]]) -> Iterator[Patch]:
    """A patch for each mesh that is there under one other name: see `other_case`."""
    for mesh in meshes if source.recipe.urdf else ():
        stated = PurePosixPath(mesh["path"])
        actual = None if is_file(source.root / stated) else other_case(source.root, mesh["path"])
        if actual is not None:
            uri_parts = mesh["uri"].split("/")
            pairs = zip(reversed(stated.parts), reversed(uri_parts), strict=False)
            same = len(list(itertools.takewhile(lambda pair: pair[0] == pair[1], pairs)))
            if same and actual.parts[:-same] == stated.parts[:-same]:
                named = "/".join((*uri_parts[:-same], *actual.parts[-same:]))
                yield from renamings(source.shown, source.data, mesh["uri"], named, CASE)
