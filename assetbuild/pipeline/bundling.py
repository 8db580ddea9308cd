"""The files of a bundle, and the swap that puts them in place."""

from __future__ import annotations

import datetime
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from assetbuild._version import __version__
from assetbuild.body.measure_bodies import Measured
from assetbuild.engine.claims import release
from assetbuild.engine.digest import digest_bytes
from assetbuild.engine.graph import Graph, Ref
from assetbuild.engine.make import NodeResult
from assetbuild.engine.planner import Settled
from assetbuild.engine.scratch import Scratch
from assetbuild.engine.session import Session
from assetbuild.engine.store import OUT_OPTION, Listing, machine_errors
from assetbuild.engine.world import files_in
from assetbuild.errors import StepError, UsageError
from assetbuild.facts.again.written import Written, sign
from assetbuild.facts.reader import asked_sections, stated_options
from assetbuild.facts.reference import Reference
from assetbuild.lock import GitPin, Lock, Pin
from assetbuild.pipeline.publish import PROVENANCE, heal, lies_there, new_staging, publish
from assetbuild.pipeline.writers import RANGES, code_of_writers, patterns
from assetbuild.plan import Outline, part_lock
from assetbuild.plan.asked import readers_of
from assetbuild.plugin_types import Target
from assetbuild.plugins import load_plugin, own_names
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.rendering.render import HERO, THUMBNAIL
from assetbuild.report.bundle import (
    BundleFile,
    json_text,
    manifest,
    manifest_of,
    notice,
    package_url,
    provenance,
    same_provenance,
)
from assetbuild.report.card import Subject, model_card
from assetbuild.report.document import Report
from assetbuild.report.html import View, html_page
from assetbuild.report.summary import summary
from assetbuild.robot.codec import decode
from assetbuild.robot.identify import Fit


def bundle_files(
    loaded: LoadedRecipe,
    lock: Lock | None,
    done: Settled[Outline],
    report: Report,
    session: Session,
) -> list[BundleFile]:
    """Everything that the bundle of one recipe holds, manifest and provenance last."""
    recipe, built = loaded.recipe, _Built(done.outline, done.results, session)
    locks = [(recipe, lock), *((part.recipe, part_lock(part)) for part in loaded.parts)]
    pins = [(each, held.pin_of(each.source) if held else None) for each, held in locks]
    sources = [(each, dict(pin.model_dump()) if pin else {}) for each, pin in pins]
    writers = (load_plugin(Target, name) for name in own_names(Target))
    sections = asked_sections((reader for _, reader in readers_of(recipe)), writers)
    reference = built.reference(stated_options(recipe, sections) | patterns(recipe))
    assert done.outline.bodies is not None  # noqa: S101 # a whole plan has it
    subject = Subject(
        recipe,
        sources[0][1],
        reference.tree,
        reference.shapes,
        reference.control,
        decode(Measured, built.read(done.outline.bodies)),
        tuple(decode(Fit, built.read(node["fit.json"])) for node in done.outline.fits),
    )
    # The small picture where libraries of USD assets look for it.
    small = f"usd/.thumbs/256x256/{recipe.robot}.usda.png"
    has_usd = "usd" in done.outline.targets
    thumbnail = built.picture(THUMBNAIL, small, "usd") if has_usd else []
    files = [
        *built.targets(),
        *thumbnail,
        *built.licences(),
        *_report_files(subject, report, built, reference),
    ]
    files += [notice(sources), *built.others()]
    files.append(manifest(recipe.robot, files))
    materials = [
        *_libraries(done.graph, session),
        *(material for pin in pins for material in _material(*pin)),
    ]
    materials += _named(loaded, files_in(loaded.world.record | done.asked))
    run = {
        "finishedOn": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "assetbuild_host": platform.node(),
        "assetbuild_python": platform.python_version(),
    }
    parameters = {
        "recipe": loaded.path.name,
        "variant": loaded.variant,
        "sections": reference.options,
    }
    recipe_digest = session.world.digest(loaded.path)
    files.append(provenance(files, recipe_digest, parameters, materials, run))
    return files


def _libraries(graph: Graph, session: Session) -> list[dict[str, object]]:
    """assetbuild, and the libraries whose versions are part of the steps' keys."""
    versions = {"assetbuild": __version__}
    for kind in {type(node.step) for node in graph.nodes.values()}:
        versions |= session.code.of(kind).libraries
    return [{"uri": package_url(*pair)} for pair in sorted(versions.items())]


def _named(loaded: LoadedRecipe, read: Mapping[str, str]) -> list[dict[str, object]]:
    """Files with their digests, named as seen from the recipe's folder."""
    here = loaded.path.absolute().parent
    return [
        {"name": os.path.relpath(path, here), "digest": {"sha256": digest}}
        for path, digest in sorted(read.items())
    ]


def _material(recipe: Recipe, pin: Pin | GitPin | None) -> Iterator[dict[str, object]]:
    """What was downloaded, with its digest."""
    if recipe.source.url is not None:
        yield {"uri": recipe.source.url, "digest": {"sha256": recipe.source.sha256}}
    elif isinstance(pin, GitPin):
        digest = {"gitCommit": pin.commit, "sha256": pin.sha256}
        yield {"uri": f"git+{pin.git}@{pin.commit}", "digest": digest}
    elif pin is not None:
        yield {"uri": f"pkg:pypi/{pin.name}@{pin.version}", "digest": {"sha256": pin.sha256}}


@dataclass(frozen=True)
class _Built:
    """What the steps of one recipe made, by its outline."""

    outline: Outline
    results: Mapping[str, NodeResult]
    session: Session

    def read(self, ref: Ref) -> bytes:
        """The content of an output."""
        return self.session.read(self.results[ref.node][ref.output])

    def listing(self, ref: Ref) -> Listing:
        """Path -> (digest, size) of an output that is a folder."""
        return self.session.tree(self.results[ref.node][ref.output])

    def reference(self, options: Mapping[str, Any]) -> Reference:  # Any: plain JSON
        """The robot that the targets wrote, with what its files hold."""
        ports = Scratch(self.session.store.scratch())
        for port, ref in self.outline.robot.items():
            if port.endswith(".json"):
                ports.link(port, self.session.object(self.results[ref.node][ref.output]))
        return Reference.of_ports(ports.folder, options)

    def written(self) -> Written:
        """What `validate` needs to write the files again."""
        meshes = self.listing(self.outline.robot["meshes/"])
        kinds = {name: type(node.step) for name, node in self.outline.targets.items()}
        if self.outline.ranges is not None:
            kinds[RANGES] = type(self.outline.ranges.step)
        digests = {path: digest for path, (digest, _) in sorted(meshes.items())}
        return Written(digests, code_of_writers(kinds, self.session.code))

    def targets(self) -> list[BundleFile]:
        """Files of all targets, each path once; StepError when two disagree about one."""
        files: dict[str, BundleFile] = {}
        for name, node in self.outline.targets.items():
            target = load_plugin(Target, name)
            for path, (digest, size) in sorted(self.listing(node[f"{name}/"]).items()):
                file = BundleFile(target.place(name, path), name, digest, size)
                if files.setdefault(file.path, file).sha256 != digest:
                    raise StepError(f"targets {files[file.path].role} and {name} both write {path}")
        return list(files.values())

    def licences(self) -> Iterator[BundleFile]:
        """The licence texts of the source and of its parts."""
        for path, ref in sorted(self.outline.licenses.items()):
            if ref.node:
                digest, size = self.listing(ref)[ref.member]
            else:
                digest = self.session.world.digest(Path(ref.output))
                size = self.session.object(digest).stat().st_size
            yield BundleFile(f"LICENSES/{path}", "licence", digest, size)

    def others(self) -> Iterator[BundleFile]:
        """What not every recipe makes: `dr.yaml`, the expanded xacro."""
        if self.outline.ranges is not None:
            stated = self.read(self.outline.ranges["dr.yaml"])
            yield BundleFile.of_bytes("dr.yaml", "randomization", stated)
        if self.outline.expanded is not None:
            expanded = self.read(self.outline.expanded)
            yield BundleFile.of_bytes("report/expanded.urdf", "report", expanded)

    def picture(self, name: str, path: str, role: str) -> list[BundleFile]:
        """A drawn picture, at its place in the bundle; none without OpenGL."""
        node = self.outline.looks.get("pictures")
        image = self.listing(node["images/"]).get(name) if node else None
        return [BundleFile(path, role, *image)] if image else []

    def view(self) -> View | None:
        """The 3D view; None in a bundle without."""
        node = self.outline.looks.get("viewer")
        if node is None:
            return None
        return View(self.read(node["viewer.json"]).decode(), self.read(node["three.js"]).decode())


def _report_files(
    subject: Subject, report: Report, built: _Built, reference: Reference
) -> list[BundleFile]:
    """The report for machines, for people, for a job's page; its picture."""
    hero = built.picture(HERO, f"report/images/{HERO}", "report")
    picture = next((built.session.read(file.sha256) for file in hero), None)
    texts = {
        "report/report.json": json_text(report.to_json()),
        "report/index.html": html_page(report, subject, picture, built.view()),
        "report/report.md": summary(report),
        "report/robot.json": sign(reference.to_json(), built.written()),
        "model_card.md": model_card(subject, report),
    }
    files = [BundleFile.of_text(path, "report", text) for path, text in texts.items()]
    return [*files, *hero]


def publish_bundle(files: list[BundleFile], out: Path, session: Session) -> tuple[str, ...]:
    """Write the bundle beside its place, then swap; returns what the user had edited there.

    A bundle that lies there already, byte for byte, is left alone: of twenty robots an edit changes
    one, and the files of the others keep their stamps.
    """
    if _lies_there(files, out, session):
        heal(out)
        return ()
    before = None
    with suppress(UsageError):
        before = manifest_of(out)
    staging = new_staging(out)
    try:
        with machine_errors(out, OUT_OPTION):
            for file in files:
                _place(file, staging / file.path, out, session)
            return publish(staging, out, before)
    finally:
        release(staging)


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
    return lies_there(out, wanted, session.world.stamps.digest)


def _place(file: BundleFile, path: Path, out: Path, session: Session) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if file.content is not None:
        path.write_bytes(file.content)
    elif not _take_over(out / file.path, path, file.sha256, session):
        session.object(file.sha256)  # a source comes into the store first
        session.store.restore(file.sha256, path, out)


def _take_over(old: Path, path: Path, digest: str, session: Session) -> bool:
    """Link `path` to a file of the old bundle, as most are the same; False where it is not."""
    try:
        if old.is_symlink() or not old.is_file() or session.world.stamps.digest(old) != digest:
            return False
        os.link(old, path)
    except OSError:
        return False
    return True
