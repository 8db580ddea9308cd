"""The files of a bundle, and the swap that puts them in place."""

from __future__ import annotations

import datetime
import json
import os
import platform
from collections.abc import Mapping
from pathlib import Path

from assetbuild import __version__
from assetbuild.engine.digest import digest_bytes
from assetbuild.engine.graph import Graph
from assetbuild.engine.keys import tool_version
from assetbuild.engine.make import NodeResult
from assetbuild.engine.publish import (
    PROVENANCE,
    discard,
    heal,
    lies_there,
    new_staging,
    publish,
)
from assetbuild.engine.session import Session
from assetbuild.engine.store import machine_error
from assetbuild.errors import StepError, UsageError
from assetbuild.lock import GitPin, Lock, lock_path
from assetbuild.plan import Outline, part_lock
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.report.bundle import (
    BundleFile,
    json_text,
    manifest,
    notice,
    package_url,
    provenance,
    same_provenance,
)
from assetbuild.report.card import model_card
from assetbuild.report.document import Report
from assetbuild.report.facts import Subject
from assetbuild.report.html import Picture, View, html_page
from assetbuild.report.snapshot import robot_json
from assetbuild.report.summary import summary
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Control, Shapes, Tree


def bundle_files(
    loaded: LoadedRecipe,
    lock: Lock | None,
    outline: Outline,
    report: Report,
    session: Session,
    results: Mapping[str, NodeResult],
    graph: Graph,
) -> list[BundleFile]:
    """Everything that the bundle of one recipe holds, manifest and provenance last."""
    recipe = loaded.recipe
    pinned = _pinned(recipe, lock)
    files = _target_files(outline, results, session) + _licence_files(outline, results, session)
    subject = _subject(loaded, pinned, outline, session, results)
    files += _report_files(subject, outline, report, session, results)
    files.append(
        notice(
            [
                (recipe, pinned),
                *((p.recipe, _pinned(p.recipe, part_lock(p))) for p in loaded.parts),
            ]
        )
    )
    if outline.ranges is not None:
        stated = session.read(results[outline.ranges.label]["dr.yaml"])
        files.append(BundleFile.of_bytes("dr.yaml", "randomization", stated))
    if outline.expanded is not None:
        expanded = results[outline.expanded.node][outline.expanded.output]
        size = len(session.read(expanded))
        files.append(BundleFile("report/expanded.urdf", "report", expanded, size))
    files.append(manifest(recipe.robot, files))
    materials = _tools(graph) + _materials(recipe, lock)
    for part in loaded.parts:
        materials += _materials(part.recipe, part_lock(part))
    materials += _named(loaded, files_read(loaded, graph, session))
    recipe_digest = session.sources.digest(loaded.path)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    run = {
        "finishedOn": now,
        "assetbuild_host": platform.node(),
        "assetbuild_python": platform.python_version(),
    }
    parameters = {"recipe": loaded.path.name, "variant": loaded.variant}
    files.append(provenance(files, recipe_digest, parameters, materials, run))
    return files


def _pinned(recipe: Recipe, lock: Lock | None) -> dict[str, object]:
    pin = lock.pin_of(recipe.source) if lock else None
    return dict(pin.model_dump()) if pin else {}


def files_read(loaded: LoadedRecipe, graph: Graph, session: Session) -> dict[str, str]:
    """Path -> SHA-256 of every file outside the store that decided the result."""
    paths = [*loaded.files, *(Path(ref.output) for ref in graph.sources if not ref.is_tree)]
    pinned = [each for each in (loaded, *loaded.parts) if each.recipe.source.moving]
    paths += [lock_path(each.path) for each in pinned]
    return {str(path): session.sources.digest(path) for path in paths}


def _tools(graph: Graph) -> list[dict[str, object]]:
    """assetbuild, and the libraries whose versions are part of the steps' keys."""
    names = {name for node in graph.nodes.values() for name in node.step.tools}
    versions = {name: tool_version(name) for name in names}
    versions["assetbuild"] = __version__
    return [{"uri": package_url(*pair)} for pair in sorted(versions.items())]


def _named(loaded: LoadedRecipe, read: Mapping[str, str]) -> list[dict[str, object]]:
    """Files with their digests, named as seen from the recipe's folder."""
    here = loaded.path.absolute().parent
    return [
        {"name": os.path.relpath(path, here), "digest": {"sha256": digest}}
        for path, digest in sorted(read.items())
    ]


def _materials(recipe: Recipe, lock: Lock | None) -> list[dict[str, object]]:
    """What was downloaded, each with its digest."""
    if recipe.source.url is not None:
        return [{"uri": recipe.source.url, "digest": {"sha256": recipe.source.sha256}}]
    pin = lock.pin_of(recipe.source) if lock else None
    if pin is None:
        return []
    if isinstance(pin, GitPin):
        uri = f"git+{pin.git}@{pin.commit}"
        return [{"uri": uri, "digest": {"gitCommit": pin.commit, "sha256": pin.sha256}}]
    uri = f"pkg:pypi/{pin.name}@{pin.version}"
    return [{"uri": uri, "digest": {"sha256": pin.sha256}}]


def _target_files(
    outline: Outline, results: Mapping[str, NodeResult], session: Session
) -> list[BundleFile]:
    """Files of all targets, each path once; StepError when two targets disagree about one."""
    files: dict[str, BundleFile] = {}
    for name, node in outline.targets.items():
        tree = session.tree(results[node.label][f"{name}/"])
        folder = getattr(type(node.step), "folder", None)
        prefix = f"{name}/" if folder is None else f"{folder}/" if folder else ""
        for path, (digest, size) in sorted(tree.items()):
            file = BundleFile(f"{prefix}{path}", name, digest, size)
            if files.setdefault(file.path, file).sha256 != digest:
                raise StepError(f"targets {files[file.path].role} and {name} both write {path}")
    return list(files.values())


def _licence_files(
    outline: Outline, results: Mapping[str, NodeResult], session: Session
) -> list[BundleFile]:
    files = []
    for path, ref in sorted(outline.licenses.items()):
        if ref.node:
            digest, size = session.tree(results[ref.node][ref.output])[ref.member]
        else:
            digest, size = session.sources.digest(Path(ref.output)), Path(ref.output).stat().st_size
        files.append(BundleFile(f"LICENSES/{path}", "licence", digest, size))
    return files


def _report_files(
    subject: Subject,
    outline: Outline,
    report: Report,
    session: Session,
    results: Mapping[str, NodeResult],
) -> list[BundleFile]:
    """The report for machines, for people, for a job's page; its pictures."""
    pictures, files = _pictures(outline, session, results)
    page = html_page(report, subject, pictures, _view(outline, session, results))
    return [
        BundleFile.of_text("report/report.json", "report", json_text(report.to_json())),
        BundleFile.of_text("report/index.html", "report", page),
        BundleFile.of_text("report/report.md", "report", summary(report)),
        BundleFile.of_text(
            "report/robot.json",
            "report",
            robot_json(subject.tree, subject.shapes, subject.control),
        ),
        BundleFile.of_text("model_card.md", "report", model_card(subject, report)),
        *files,
    ]


def _pictures(
    outline: Outline, session: Session, results: Mapping[str, NodeResult]
) -> tuple[list[Picture], list[BundleFile]]:
    node = outline.looks.get("pictures")
    if node is None:
        return [], []
    made = results[node.label]
    images = session.tree(made["images/"])
    shown, files = [], []
    for row in json.loads(session.read(made["pictures.json"]))["pictures"]:
        digest, size = images[row["file"]]
        shown.append(Picture(row["title"], row["alt"], session.read(digest)))
        files.append(BundleFile(f"report/images/{row['file']}", "report", digest, size))
    return shown, files


def _view(outline: Outline, session: Session, results: Mapping[str, NodeResult]) -> View | None:
    node = outline.looks.get("viewer")
    if node is None:
        return None
    made = results[node.label]
    return View(
        session.read(made["viewer.json"]).decode("ascii"), session.read(made["three.js"]).decode()
    )


def _subject(
    loaded: LoadedRecipe,
    pinned: Mapping[str, object],
    outline: Outline,
    session: Session,
    results: Mapping[str, NodeResult],
) -> Subject:
    def built(port: str) -> bytes:
        ref = outline.robot[port]
        return session.read(results[ref.node][ref.output])

    tree = decode(Tree, built("tree.json"))
    shapes = decode(Shapes, built("shapes.json"))
    control = decode(Control, built("control.json"))
    return Subject(loaded.recipe, pinned, tree, shapes, control)


def publish_bundle(files: list[BundleFile], out: Path, session: Session) -> tuple[str, ...]:
    """Write the bundle beside its place, then swap; returns what the user had edited there.

    A bundle that lies there already, byte for byte, is left alone: of twenty robots an edit changes
    one, and the files of the others keep their stamps.
    """
    if _lies_there(files, out, session):
        heal(out)
        return ()
    staging = new_staging(out)
    try:
        for file in files:
            _place(file, staging / file.path, session)
        published = publish(staging, out, _manifest_or_none(out))
    except OSError as error:
        raise machine_error(error, out) from error
    finally:
        discard(staging)
    return (*published.edited, *published.added)


def _lies_there(files: list[BundleFile], out: Path, session: Session) -> bool:
    """Provenance may tell of another time and host, for the same build."""
    wanted = {file.path: file.sha256 for file in files}
    ours = next((file.content for file in files if file.path == PROVENANCE), None)
    if ours is not None:
        try:
            theirs = (out / PROVENANCE).read_bytes()
        except OSError:
            return False
        if not same_provenance(ours, theirs):
            return False
        wanted[PROVENANCE] = digest_bytes(theirs)
    return lies_there(out, wanted, session.sources.stat_cache.digest)


def _place(file: BundleFile, path: Path, session: Session) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if file.content is not None:
        path.write_bytes(file.content)
    else:
        session.object(file.sha256)  # a source comes into the store first
        session.store.restore(file.sha256, path)


def manifest_of(bundle: Path) -> dict[str, str]:
    """Path -> SHA-256 as the manifest says. UsageError when it is no bundle."""
    try:
        manifest = json.loads((bundle / "manifest.json").read_bytes())
        return {str(row["path"]): str(row["sha256"]) for row in manifest["files"]}
    except (FileNotFoundError, NotADirectoryError):
        raise UsageError(f"`{bundle}` has no manifest.json, so it is no bundle") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError) as error:
        raise UsageError(f"{bundle / 'manifest.json'}: not a manifest: {error}") from None


def _manifest_or_none(bundle: Path) -> dict[str, str] | None:
    try:
        return manifest_of(bundle)
    except UsageError:
        return None
