"""A bundle's files are proven by writing them again, from its own robot and meshes.

The targets run on `report/robot.json` as steps of a build, in a store of their own. Equal bytes are
equal; of all else the comparers of `facts.again` tell what differs.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from assetbuild.control.keep import KeepRatings
from assetbuild.engine.code import Code
from assetbuild.engine.digest import digest_bytes, digest_file
from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner, settle_all
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.errors import StepError
from assetbuild.facts.again.files import rows_of
from assetbuild.facts.again.tree import NotParsedError, Row, row_findings, same
from assetbuild.facts.again.written import Written, read_signed
from assetbuild.facts.compare import EQUAL
from assetbuild.facts.reader import UNREADABLE
from assetbuild.facts.reference import Assets, Reference
from assetbuild.findings import Finding, Rule
from assetbuild.geometry.measure_assets import ReadMeshes
from assetbuild.grouping import grouped
from assetbuild.pipeline.writers import StatedRecipe, code_of_writers, writer_kinds
from assetbuild.plugin_types import Target
from assetbuild.report.sides import stages_of
from assetbuild.robot.codec import encode

ROBOT = "report/robot.json"

UNPROVEN = Rule(
    "again.unproven",
    "info",
    "files were not written again, so that only their readers prove them: the bundle is an earlier "
    "version's, other code wrote it, or it holds no meshes",
    "build the bundle again with this version",
)
OTHERWISE = Rule(
    "again.otherwise",
    "info",
    "a file of the bundle is written differently and means the same",
    "nothing",
)
REFUSED = Rule(
    "again.refused",
    "error",
    "a target cannot write the robot of the bundle",
    "build the bundle again",
)


@dataclass(frozen=True)
class Again:
    """The bundle's files as their writers write them now.

    folder: holds them as the bundle does; writers: path in the bundle -> name of its writer.
    refused: what a writer could not write.
    """

    folder: Path
    writers: Mapping[str, str]
    refused: tuple[Finding, ...]


def prove_again(bundle: Path, robot: str, reference: Reference) -> Iterator[Finding]:
    """What the bundle's files say and their writers do not write; each finding has its file."""
    signed = read_signed(bundle)
    if signed is None:
        yield UNPROVEN("robot", "the bundle was built by an earlier version", where=ROBOT)
        return
    written, stated, digest = signed
    if stated != digest:
        # Everything would differ from a robot that was edited: one finding says so.
        data = {"attribute": "digest", "expected": stated, "found": digest}
        text = f"{ROBOT} was edited after the build: its digest is not the one that it states"
        yield EQUAL.named("robot.digest")("robot", text, data=data, where=ROBOT)
        return
    meshes = held_meshes(bundle, written.meshes)
    with (
        tempfile.TemporaryDirectory(prefix="assetbuild-again-") as folder,
        Session(Store(Path(folder, "store"))) as session,
    ):
        steps, left = _steps(robot, reference, written, meshes, session.code)
        yield from left
        yield from _edited_meshes(meshes, reference)
        again = _write(Path(folder), reference, meshes, steps, session)
        yield from again.refused
        for path in again.writers:
            yield from _compared(path, bundle, again)


# --- what can be written ----------------------------------------------------------------------


def _steps(
    robot: str, reference: Reference, written: Written, meshes: Mapping[str, Held], known: Code
) -> tuple[dict[str, Target], list[Finding]]:
    """The writers whose code, sections and meshes are those of the build; why others do not run."""
    stated = StatedRecipe(robot, tuple(written.writers), reference)
    kinds = writer_kinds(written.writers)
    code = code_of_writers(kinds, known)
    lost = [file for file in written.meshes if file not in meshes]
    steps: dict[str, Target] = {}
    left: list[Finding] = []
    for name, digest in written.writers.items():
        if why := _hindrance(kinds.get(name), code.get(name) == digest, lost):
            text = f"{why}, so that only their readers prove its files"
            left.append(UNPROVEN(f"target {name}", text, where=ROBOT))
            continue
        try:
            steps[name] = kinds[name].configure(stated)
        except (ValueError, LookupError, TypeError) as error:
            why = " ".join(str(error).split())
            left.append(REFUSED(f"target {name}", f"its section: {why}", where=ROBOT))
    return steps, left


def _hindrance(kind: type[Target] | None, same_code: bool, lost: Sequence[str]) -> str:
    """Why a writer cannot write the bundle again; "" where it can."""
    if kind is None:
        return "the target is not installed"
    if not same_code:
        return "the target's code has changed since the build"
    if lost and "meshes/" in kind.reads:
        return f"no folder of the bundle holds `{lost[0]}`"
    return ""


def _edited_meshes(meshes: Mapping[str, Held], reference: Reference) -> Iterator[Finding]:
    """Report meshes and pictures of which no copy is as it was built."""
    for file, held in meshes.items():
        if not held.edited:
            continue
        try:
            rows = [*edited_rows(file, held.data, reference.assets)]
        except StepError as error:
            yield UNREADABLE("robot", error.message, where=held.path)
            continue
        yield from row_findings(rows, "mesh", held.path)
        if not rows:
            yield _otherwise(file, held.path)


def _otherwise(subject: str, path: str) -> Finding:
    return OTHERWISE(f"file {subject}", "written differently, and it means the same", where=path)


# --- writing ----------------------------------------------------------------------------------


def _write(
    folder: Path,
    reference: Reference,
    meshes: Mapping[str, Held],
    steps: Mapping[str, Target],
    session: Session,
) -> Again:
    """Run the steps as a build does, in a store that knows nothing."""
    parts = ("links", "tree", "shapes", "control")
    files = {f"{name}.json": encode(getattr(reference, name)) for name in parts}
    files |= {f"meshes/{file}": mesh.data for file, mesh in meshes.items()}
    for name, data in files.items():
        path = folder / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)

    def add(p: Planner) -> None:
        held: dict[str, dict[str, Ref]] = {"meshes/": {}}
        for name in files:
            port = "meshes/" if name.startswith("meshes/") else name
            held.setdefault(port, {})[name] = p.source(folder / "in" / name)
        rated = p.add("ratings", KeepRatings(), held["tree.json"] | held["control.json"])
        held["ratings.json"] = {"ratings.json": rated["ratings.json"]}
        prepared = [step.preparation for step in steps.values() if step.preparation is not None]
        if prepared:
            shown = held["shapes.json"] | held["meshes/"]
            read = p.add("read_meshes", ReadMeshes(), shown)
            held["triangles.npz"] = {"triangles.npz": read["triangles.npz"]}
        for before in prepared:
            made = p.add(before.step_name(), before(), _inputs(before.reads, held))
            held |= {output: {output: made[output]} for output in before.outputs}
        for name, step in steps.items():
            own = step.preparation.outputs if step.preparation is not None else ()
            p.add(name, step, _inputs((*step.reads, *own), held))

    done = settle_all({"": add}, session, keep_going=True)[""]
    writers: dict[str, str] = {}
    refused = []
    for name, step in steps.items():
        result = done.results[name]
        if result.error is not None:
            refused.append(REFUSED(f"target {name}", result.error.message, where=ROBOT))
        for file, digest in _made(result.outputs or {}, session):
            there = step.place(name, file)
            if writers.setdefault(there, name) == name:
                session.store.restore(digest, folder / "again" / there)
    return Again(folder / "again", writers, tuple(refused))


def _inputs(ports: Iterable[str], held: Mapping[str, Mapping[str, Ref]]) -> dict[str, Ref]:
    return {name: ref for port in ports for name, ref in held[port].items()}


def _made(outputs: Mapping[str, str], session: Session) -> Iterator[tuple[str, str]]:
    """(path, digest) of each file that a step wrote, in its one folder or beside it."""
    for output, digest in outputs.items():
        if output.endswith("/"):
            yield from ((path, held) for path, (held, _) in sorted(session.tree(digest).items()))
        else:
            yield output, digest


# --- comparing --------------------------------------------------------------------------------


def _compared(path: str, bundle: Path, again: Again) -> Iterator[Finding]:
    """One file of the bundle with what its writer writes. A lost file is the manifest's."""
    ours, theirs = again.folder / path, bundle / path
    if not theirs.is_file() or digest_file(ours) == digest_file(theirs):
        return
    with _among_others(path, bundle, again) as there:
        try:
            rows = rows_of(ours, there, stages_of(again.folder, path))
        except NotParsedError as error:
            # Nothing can be compared with what is not of its kind; the parser names the line.
            expected = {"attribute": "statement", "expected": "a file that parses"}
            where = f"{path}:{error.line}" if error.line else path
            rule = EQUAL.named(f"{again.writers[path]}.statement")
            data = expected | {"found": error.message}
            yield rule(f"file {path}", error.message, data=data, where=where)
            return
    yield from row_findings(rows, again.writers[path], path)
    if not rows:
        yield _otherwise(path, path)


@contextmanager
def _among_others(path: str, bundle: Path, again: Again) -> Iterator[Path]:
    """The bundle's file in a folder with all other files as their writers write them.

    So a model that includes it, or a stage that it is a layer of, differs by this file alone, and
    by the files beside it that no writer writes: it may include them.
    """
    with tempfile.TemporaryDirectory(prefix="there-", dir=again.folder.parent) as name:
        shutil.copytree(again.folder, name, copy_function=os.link, dirs_exist_ok=True)
        there = Path(name, path)
        there.unlink()
        shutil.copyfile(bundle / path, there)
        for file in (bundle / path.partition("/")[0]).rglob("*"):
            copy = Path(name, file.relative_to(bundle))
            if file.is_file() and not copy.exists():
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, copy)
        yield there


LOOKS = (b"mtllib ", b"usemtl ")
"""First words of the lines that a URDF's copy of a mesh has before the mesh."""


@dataclass(frozen=True)
class Held:
    """One file. path: in the bundle, of the copy; edited: no copy is as it was built."""

    path: str
    data: bytes
    edited: bool


def held_meshes(bundle: Path, wanted: Mapping[str, str]) -> dict[str, Held]:
    """File -> the copy that is as it was built, else any. wanted: file -> its SHA-256."""
    paths = sorted(path for path in bundle.rglob("*") if path.name in wanted)
    copies = grouped(paths, lambda path: path.name)
    return {
        name: _best(bundle, paths, wanted[name])
        for name, paths in copies.items()
        if paths and all(path.is_file() for path in paths)
    }


def _best(bundle: Path, copies: list[Path], digest: str) -> Held:
    for path in copies:
        data = path.read_bytes()
        for content in (data, _without_looks(data)):
            if digest_bytes(content) == digest:
                return Held(path.relative_to(bundle).as_posix(), content, edited=False)
    first = copies[0]
    content = _without_looks(first.read_bytes())
    return Held(first.relative_to(bundle).as_posix(), content, edited=True)


def _without_looks(data: bytes) -> bytes:
    while data.startswith(LOOKS):
        data = data.partition(b"\n")[2]
    return data


def edited_rows(file: str, data: bytes, assets: Assets) -> Iterator[Row]:
    """What an edited mesh or picture shows otherwise than the one that was measured."""
    if file.endswith(".obj"):
        yield from _mesh_rows(file, data, assets)
        return
    from assetbuild.facts.surface import pixels_of

    expected, actual = dict(assets.pixels).get(file, ""), pixels_of(data)
    if expected != actual:
        yield Row("picture", file, "pixels", expected, actual)


def _mesh_rows(file: str, data: bytes, assets: Assets) -> Iterator[Row]:
    from assetbuild.facts.surface import measure
    from assetbuild.mesh.obj import read_triangles

    name = file.removesuffix(".obj")
    mesh = read_triangles(data, file)
    theirs = measure(mesh.corners, mesh.uv).facts()
    ours = dict(assets.surfaces)[name].facts()
    for quantity in dict.fromkeys((*ours, *theirs)):
        one, other = ours.get(quantity), theirs.get(quantity)
        if not same(one, other):
            yield Row("mesh", name, quantity, one, other)
