"""build(): plan and execute until no question is open, then report, then the bundle."""

from __future__ import annotations

import datetime
import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from assetbuild import __version__
from assetbuild.engine.execute import Event, NodeResult, execute
from assetbuild.engine.folders import cache_root
from assetbuild.engine.graph import Graph, Node, Planner, joined
from assetbuild.engine.publish import check_replaceable, discard, new_staging, publish
from assetbuild.engine.rebuild import Difference, run_again
from assetbuild.engine.remote import Remote
from assetbuild.engine.session import Resolver, Session
from assetbuild.engine.store import LostObjectError, machine_error, open_store
from assetbuild.errors import AssetBuildError, LockError, OutOfDateError, UsageError, Where
from assetbuild.findings import Finding
from assetbuild.kinds import Edit
from assetbuild.lock import GitPin, Lock, Pin, check_pin, lock_path, read_lock, write_lock
from assetbuild.plan import Outline, plan
from assetbuild.plan.agree import check_names
from assetbuild.plan.source import repository
from assetbuild.plan.source_archive import MESHES
from assetbuild.recipe.loader import LoadedRecipe, load_recipe, shown_path
from assetbuild.recipe.models import Recipe
from assetbuild.report.bundle import BundleFile, json_text, manifest, notice, provenance
from assetbuild.report.card import model_card
from assetbuild.report.document import CheckResult, FailOn, Report, fails, make_report
from assetbuild.report.html import html_page
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Control, Shapes, Tree
from assetbuild.steps.fetch import resolve
from assetbuild.steps.fetch_git import resolve_git


@dataclass(frozen=True)
class Request:
    """What the user asks of a build. out: default `build/<robot>`; jobs: default, all cores."""

    recipe: Path
    out: Path | None = None
    variant: str | None = None
    jobs: int | None = None
    keep_going: bool = False
    frozen: bool = False
    rehash: bool = False
    rebuild_check: bool = False
    remote: str = ""
    cache_write: bool = False
    fail_on: FailOn = "error"


@dataclass
class Outcome:
    """What came of a build.

    out: where the bundle lies, None when a step failed. edited: files of the user that were set
    aside. errors: of the failed steps, in the order of the graph.
    read: path -> sha256 of every file outside the store that decided the result; absent: paths
    that would have, had they existed; began_ns: when the first was read. differences: what the
    second run of `--rebuild-check` found.
    """

    loaded: LoadedRecipe
    exit_code: int
    results: Mapping[str, NodeResult]
    seconds: float = 0.0
    out: Path | None = None
    report: Report | None = None
    edited: tuple[str, ...] = ()
    errors: tuple[AssetBuildError, ...] = ()
    read: Mapping[str, str] = field(default_factory=dict)
    absent: tuple[Path, ...] = ()
    began_ns: int = 0
    differences: tuple[Difference, ...] = ()


OnEvent = Callable[[Event], None]


@dataclass(frozen=True)
class _Job:
    """One recipe of a build, ready to be planned. name: its robot, which no other job builds."""

    name: str
    loaded: LoadedRecipe
    lock: Lock | None
    out: Path


@dataclass(frozen=True)
class _Executed:
    """The last plan of one recipe, and what became of its steps."""

    outline: Outline
    graph: Graph
    results: dict[str, NodeResult]


def build(request: Request, on_event: OnEvent, say: Callable[[str], None]) -> Outcome:
    """Build one recipe. Raises AssetBuildError for wrong input; failed steps are in the outcome."""
    return build_all([request], on_event, say)[0]


def build_all(
    requests: Sequence[Request], on_event: OnEvent, say: Callable[[str], None]
) -> list[Outcome]:
    """Build several recipes as one graph; they differ in `recipe` and `out` only.

    Raises AssetBuildError for wrong input; failed steps are in the outcomes.
    """
    started, began_ns = time.monotonic(), time.time_ns()
    jobs = _jobs(requests, say)
    request = requests[0]
    with open_session(*(job.loaded for job in jobs), rehash=request.rehash) as session:
        session.remote = _remote(request, say)
        if session.store.notice:
            say(f"warning: {session.store.notice}")
        for attempt in (1, 2, 3):
            try:
                outcomes = _build(jobs, session, request, on_event, say)
                break
            except LostObjectError:  # found corrupt while it was read: make it again
                session.forget()
                if attempt == 3:
                    raise
    for job, outcome in zip(jobs, outcomes, strict=True):
        outcome.seconds, outcome.began_ns = time.monotonic() - started, began_ns
        if outcome.report is not None:
            _write_run_log(outcome, job.out)
    return outcomes


def _jobs(requests: Sequence[Request], say: Callable[[str], None]) -> list[_Job]:
    """Read and pin every recipe before any is built."""
    jobs: list[_Job] = []
    for request in requests:
        loaded = load_recipe(request.recipe, request.variant)
        out = request.out or default_out(loaded)
        name = loaded.recipe.robot
        if any(job.name == name for job in jobs):
            raise UsageError(f"two of the recipes build `{name}`", hint="build them one by one")
        check_replaceable(out)
        jobs.append(_Job(name, loaded, pin(loaded, frozen=request.frozen, say=say), out))
    return jobs


def _build(
    jobs: Sequence[_Job],
    session: Session,
    request: Request,
    on_event: OnEvent,
    say: Callable[[str], None],
) -> list[Outcome]:
    executed = _plan_and_execute(jobs, session, request, on_event)
    outcomes = []
    for job, done in zip(jobs, executed, strict=True):
        outcome = _finish(job, done, session, request)
        if request.rebuild_check and outcome.report is not None:
            say("running every step a second time")
            keep = job.out.with_name(f"{job.out.name}.rebuild-check")
            outcome.differences = run_again(
                done.graph, session, done.results, keep, jobs=request.jobs, on_event=on_event
            )
            outcome.exit_code = outcome.exit_code or (4 if outcome.differences else 0)
        outcomes.append(outcome)
    return outcomes


def _finish(job: _Job, done: _Executed, session: Session, request: Request) -> Outcome:
    """Report and bundle of one recipe, if all its steps went well."""
    loaded, lock, out = job.loaded, job.lock, job.out
    outline, results = done.outline, done.results
    outcome = Outcome(loaded, 0, results)
    outcome.errors = tuple(
        _located(result.error, outline.subjects.get(label, ""), _where(loaded, outline, label))
        for label, result in results.items()
        if result.error is not None
    )
    if any(result.outputs is None for result in results.values()):
        outcome.exit_code = max((error.exit_code for error in outcome.errors), default=1)
        return outcome
    report = _report(loaded, outline, results, session)
    outcome.exit_code = 1 if fails(report, request.fail_on) else 0
    outcome.out = out.with_name(f"{out.name}.failed") if outcome.exit_code else out
    files = _bundle(loaded, lock, outline, report, session, results)
    outcome.edited = publish_bundle(files, outcome.out, session)
    outcome.report = report
    sources = [Path(ref.output) for ref in done.graph.sources if not ref.is_tree]
    outcome.read = {str(path): session.source_digest(path) for path in _read(loaded, sources)}
    outcome.absent = (lock_path(loaded.path),) if lock is None else ()
    return outcome


def _where(loaded: LoadedRecipe, outline: Outline, label: str) -> Where | None:
    """The place in the recipe of an edit."""
    return loaded.where(outline.edits[label]) if label in outline.edits else None


def _located(error: AssetBuildError, subject: str, where: Where | None) -> AssetBuildError:
    """The error of a step with the name of what it worked on, which the step did not know."""
    if where is not None and error.where is None:
        return type(error)(error.message, where=where, hint=error.hint)
    kind, _, name = subject.partition(" ")
    if not name:
        return error
    message = error.message.removeprefix(f"{kind}: ")
    if kind != "mesh":
        return type(error)(f"{subject}: {message}", where=error.where, hint=error.hint)
    line, column = (error.where.line, error.where.column) if error.where else (0, 0)
    return type(error)(message, where=Where(name, line, column), hint=error.hint)


def _read(loaded: LoadedRecipe, sources: list[Path]) -> list[Path]:
    lock = lock_path(loaded.path)
    return [*loaded.files, *sources, *([lock] if loaded.recipe.source.moving else [])]


def check(recipe: Path) -> list[Finding]:
    """What can be said without a heavy step: schema, lock, names, paths and static lints.

    Reads the description only where it needs no download: it lies in a folder, or in the store.
    Raises AssetBuildError; a lock that is out of date is an OutOfDateError.
    """
    loaded = load_recipe(recipe)
    for variant in loaded.recipe.variants:
        check_names(load_recipe(recipe, variant))
    check_names(loaded)
    lock = pin(loaded, frozen=True, say=lambda _: None)
    with open_session(loaded) as session:
        results: dict[str, NodeResult] = {}
        while True:
            planner = Planner(session)
            outline = plan(loaded, lock, planner)
            light = _light(planner.graph(), session)
            known = len(results)
            results |= execute(light, session)
            failed = [
                _located(result.error, "", _where(loaded, outline, label))
                for label, result in results.items()
                if result.error
            ]
            if failed:
                raise failed[0]
            if not planner.questions or len(results) == known:
                break
        findings = [finding for result in results.values() for finding in result.findings]
        locate = _locator(loaded, outline, results, session)
    return list(make_report("", findings, {}, loaded.recipe.rules, locate).findings)


LIGHT_STEPS = frozenset(
    {
        "list_archive",
        "unpack",
        "expand_xacro",
        "read_urdf",
        "lint_links",
        "merge_fixed_joints",
        "lint_bodies",
    }
)
"""Steps that `check` may run: no simulator, no mesh, no network."""


def _light(graph: Graph, session: Session) -> Graph:
    """The part of a graph that `check` may run: light steps, and what the store has already."""
    resolver = Resolver(graph.nodes, session)
    kept: dict[str, Node] = {}
    for label, node in graph.nodes.items():  # each after the nodes it reads
        light = node.step.step_name() in LIGHT_STEPS or isinstance(node.step, Edit)
        may_run = light and label != MESHES
        if all(maker in kept for maker in graph.predecessors(label)) and (
            may_run or resolver.made(label) is not None
        ):
            kept[label] = node
    return Graph(kept, graph.sources)


def opened(recipe: Path, variant: str | None) -> tuple[LoadedRecipe, Lock | None, Session]:
    """A recipe, its lock and a session, for verbs that only look; the caller closes it."""
    loaded = load_recipe(recipe, variant)
    lock = pin(loaded, frozen=True, say=lambda _: None)
    return loaded, lock, open_session(loaded)


def default_out(loaded: LoadedRecipe) -> Path:
    """`build/go1`, or `build/go1-train` for a variant."""
    suffix = f"-{loaded.variant}" if loaded.variant else ""
    return Path("build") / f"{loaded.recipe.robot}{suffix}"


def open_session(*loaded: LoadedRecipe, rehash: bool = False) -> Session:
    """The store and what this machine knows of earlier builds of the recipes."""
    names = {
        each.recipe.robot: f"{each.path}#{each.variant}" if each.variant else str(each.path)
        for each in loaded
    }
    store = open_store(Path(cache_root()))
    if len(names) == 1:
        return Session(store, build=next(iter(names.values())), rehash=rehash)
    return Session(store, builds=names, rehash=rehash)


def _remote(request: Request, say: Callable[[str], None]) -> Remote | None:
    """The cache shared with other machines; no recipe can name one."""
    if not request.remote:
        return None
    key = os.environ.get("ASSETBUILD_CACHE_KEY", "")
    return Remote(request.remote, key=key, write=request.cache_write, warn=say)


def pin(loaded: LoadedRecipe, *, frozen: bool, say: Callable[[str], None]) -> Lock | None:
    """The lock of a moving source; written when it is missing or pins something else.

    Raises OutOfDateError instead when `frozen`.
    """
    if loaded.recipe.source.moving is None:
        return None
    path = lock_path(loaded.path)
    lock = read_lock(path)
    try:
        if lock is not None:
            check_pin(loaded.recipe.source, lock, path)
            return lock
        reason = "there is no lock yet"
    except LockError as error:
        reason = error.message
    if frozen:
        raise OutOfDateError(
            reason, where=Where(shown_path(path)), hint=f"run `assetbuild lock {loaded.file}`"
        )
    say(f"{reason}: pinning {loaded.recipe.source.moving}")
    return write_pin(loaded, say)


def write_pin(loaded: LoadedRecipe, say: Callable[[str], None]) -> Lock:
    """Resolve a moving source and write the lock beside the recipe."""
    source = loaded.recipe.source
    pinned: Pin | GitPin
    if source.git is not None:
        pinned = resolve_git(source.git, str(source.rev), repository(loaded))
    else:
        name, _, version = str(source.pypi).partition("==")
        pinned = resolve(name, version, on_line=lambda line: say(line) if "MB)" in line else None)
    lock = Lock(schema="assetbuild-lock/v1", source=pinned)
    path = lock_path(loaded.path)
    if write_lock(path, lock):
        say(f"wrote {shown_path(path)}")
    return lock


def planned(
    loaded: LoadedRecipe, lock: Lock | None, session: Session
) -> tuple[Graph, Outline, bool]:
    """The graph as far as it is known without running anything; True when it is whole."""
    planner = Planner(session)
    outline = plan(loaded, lock, planner)
    return planner.graph(), outline, not planner.questions


def _plan_and_execute(
    jobs: Sequence[_Job], session: Session, request: Request, on_event: OnEvent
) -> list[_Executed]:
    """(plan, execute)* of all recipes as one graph, until no question is open or a step failed."""
    results: dict[str, NodeResult] = {}
    while True:
        planners = [Planner(session) for _ in jobs]
        outlines = [
            plan(job.loaded, job.lock, planner) for job, planner in zip(jobs, planners, strict=True)
        ]
        graphs = {job.name: p.graph() for job, p in zip(jobs, planners, strict=True)}
        now = execute(
            joined(graphs) if len(jobs) > 1 else graphs[jobs[0].name],
            session,
            jobs=request.jobs,
            keep_going=request.keep_going,
            on_event=on_event,
        )
        # What ran in an earlier round is found in the store in this one; it still has run.
        ran = {label for label, result in results.items() if result.status == "ran"}
        results = {
            k: results[k] if k in ran and r.status == "cached" else r for k, r in now.items()
        }
        is_open = any(planner.questions for planner in planners)
        if not is_open or any(result.error for result in results.values()):
            return [
                _Executed(outline, graphs[job.name], _own(results, job.name, len(jobs)))
                for job, outline in zip(jobs, outlines, strict=True)
            ]


def _own(results: dict[str, NodeResult], name: str, jobs: int) -> dict[str, NodeResult]:
    """The results of one recipe, under the labels of its own graph."""
    if jobs == 1:
        return results
    prefix = f"{name}:"
    return {k.removeprefix(prefix): r for k, r in results.items() if k.startswith(prefix)}


# --- the report -----------------------------------------------------------------------------


def _report(
    loaded: LoadedRecipe, outline: Outline, results: Mapping[str, NodeResult], session: Session
) -> Report:
    findings = _licence_findings(loaded, outline)
    for label, result in results.items():
        subject = outline.subjects.get(label)
        own = result.findings
        findings += [replace(f, subject=subject) for f in own] if subject else own
    checks: dict[str, CheckResult] = {
        name: CheckResult("skip", note=note) for name, note in outline.skipped.items()
    }
    for name, node in outline.checks.items():
        result = results[node.label]
        bad = any(finding.severity == "error" for finding in result.findings)
        figures = json.loads(session.read(result["figures.json"]))
        checks[name] = CheckResult("fail" if bad else "pass", figures)
    locate = _locator(loaded, outline, results, session)
    return make_report(loaded.recipe.robot, findings, checks, loaded.recipe.rules, locate)


def _licence_findings(loaded: LoadedRecipe, outline: Outline) -> list[Finding]:
    found = []
    if loaded.recipe.source.license is None:
        found.append(
            Finding(
                rule="license.unstated",
                severity="warning",
                subject="recipe source",
                message="the recipe does not say under which licence the robot comes",
                hint="add `license:` with an SPDX identifier below `source`",
            )
        )
    if not outline.licenses:
        found.append(
            Finding(
                rule="license.no_text",
                severity="info",
                subject="recipe source",
                message="the source brings no licence text, so the bundle has none",
            )
        )
    return found


def _locator(
    loaded: LoadedRecipe, outline: Outline, results: Mapping[str, NodeResult], session: Session
) -> Callable[[str], str]:
    """From a finding's subject to `file:line` of the source or of the recipe."""
    lines: dict[str, int] = {}
    file = loaded.recipe.source.description
    if outline.source_map is not None:
        digest = results[outline.source_map.node][outline.source_map.output]
        source_map = json.loads(session.read(digest))
        file, lines = source_map["file"], source_map["lines"]
    for label in outline.edits:  # the source knows its own names only
        for finding in results[label].findings if label in results else ():
            if finding.rule == "edit.rename":
                kind = finding.subject.partition(" ")[0]
                lines[finding.subject] = lines.get(f"{kind} {finding.data['before']}", 0)
    joints = {f"actuator {name[6:]}": line for name, line in lines.items() if name[:6] == "joint "}

    def locate(subject: str) -> str:
        if subject.startswith("recipe "):
            keys = tuple(subject.removeprefix("recipe ").split("."))
            return str(loaded.where(keys))
        line = lines.get(subject) or joints.get(subject)
        return f"{file}:{line}" if line else ""

    return locate


# --- the bundle -----------------------------------------------------------------------------


def _bundle(
    loaded: LoadedRecipe,
    lock: Lock | None,
    outline: Outline,
    report: Report,
    session: Session,
    results: Mapping[str, NodeResult],
) -> list[BundleFile]:
    recipe = loaded.recipe
    pinned: dict[str, object] = {} if lock is None else dict(lock.source.model_dump())
    files = _target_files(outline, results, session) + _licence_files(outline, results, session)
    card = _card(loaded, pinned, outline, report, results, session)
    files += [
        BundleFile.of_text("report/report.json", "report", json_text(report.to_json())),
        BundleFile.of_text("report/index.html", "report", html_page(report, card, {})),
        BundleFile.of_text("model_card.md", "report", card),
        notice(recipe, pinned),
    ]
    if outline.expanded is not None:
        expanded = results[outline.expanded.node][outline.expanded.output]
        size = len(session.read(expanded))
        files.append(BundleFile("report/expanded.urdf", "report", expanded, size))
    files.append(manifest(recipe.robot, files))
    materials: list[dict[str, object]] = [{"name": "assetbuild", "version": __version__}]
    materials += _materials(recipe, lock)
    recipe_digest = session.source_digest(loaded.path)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    run = {"finishedOn": now, "host": platform.node(), "python": platform.python_version()}
    parameters = {"recipe": loaded.path.name, "variant": loaded.variant}
    files.append(provenance(files, recipe_digest, parameters, materials, run))
    return files


def _materials(recipe: Recipe, lock: Lock | None) -> list[dict[str, object]]:
    """What was downloaded, each with its digest."""
    if recipe.source.url is not None:
        return [{"uri": recipe.source.url, "digest": {"sha256": recipe.source.sha256}}]
    if lock is None:
        return []
    pin = lock.source
    if isinstance(pin, GitPin):
        uri = f"git+{pin.git}@{pin.commit}"
        return [{"uri": uri, "digest": {"gitCommit": pin.commit, "sha256": pin.sha256}}]
    uri = f"pkg:pypi/{pin.name}@{pin.version}"
    return [{"uri": uri, "digest": {"sha256": pin.sha256}}]


def _target_files(
    outline: Outline, results: Mapping[str, NodeResult], session: Session
) -> list[BundleFile]:
    files = []
    for name, node in outline.targets.items():
        tree = session.tree(results[node.label][f"{name}/"])
        for path, (digest, size) in sorted(tree.items()):
            files.append(BundleFile(f"{name}/{path}", name, digest, size))
    return files


def _licence_files(
    outline: Outline, results: Mapping[str, NodeResult], session: Session
) -> list[BundleFile]:
    files = []
    for path, ref in sorted(outline.licenses.items()):
        if ref.node:
            digest, size = session.tree(results[ref.node][ref.output])[ref.member]
        else:
            digest, size = session.source_digest(Path(ref.output)), Path(ref.output).stat().st_size
        files.append(BundleFile(f"LICENSES/{path}", "licence", digest, size))
    return files


def _card(
    loaded: LoadedRecipe,
    pinned: Mapping[str, object],
    outline: Outline,
    report: Report,
    results: Mapping[str, NodeResult],
    session: Session,
) -> str:
    def built(port: str) -> bytes:
        ref = outline.robot[port]
        return session.read(results[ref.node][ref.output])

    tree = decode(Tree, built("tree.json"))
    shapes = decode(Shapes, built("shapes.json"))
    control = decode(Control, built("control.json"))
    return model_card(loaded.recipe, pinned, tree, shapes, control, report)


def publish_bundle(files: list[BundleFile], out: Path, session: Session) -> tuple[str, ...]:
    """Write the bundle beside its place, then swap; returns what the user had edited there."""
    staging = new_staging(out)
    try:
        for file in files:
            _place(file, staging / file.path, session)
        published = publish(staging, out, _digests_of(out))
    except OSError as error:
        raise machine_error(error, out) from error
    finally:
        discard(staging)
    return (*published.edited, *published.added)


def _place(file: BundleFile, path: Path, session: Session) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if file.content is not None:
        path.write_bytes(file.content)
    else:
        session.object(file.sha256)  # a source comes into the store first
        session.store.restore(file.sha256, path)


def _digests_of(bundle: Path) -> dict[str, str] | None:
    """Path -> sha256 of the bundle that lies there now; None when it has no readable manifest."""
    try:
        raw = json.loads((bundle / "manifest.json").read_bytes())
        return {str(row["path"]): str(row["sha256"]) for row in raw["files"]}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _write_run_log(outcome: Outcome, out: Path) -> None:
    """`<out>.run.json`: what ran, what was cached, how long it took. Not part of the bundle."""
    steps = {
        label: {
            "status": result.status,
            "seconds": round(result.seconds, 3),
            "child_cpu_seconds": round(result.cpu_seconds, 3),
            "reason": result.reason,
        }
        for label, result in outcome.results.items()
    }
    log = {
        "exit_code": outcome.exit_code,
        "seconds": round(outcome.seconds, 3),
        "edited": list(outcome.edited),
        "steps": steps,
    }
    out.with_name(f"{out.name}.run.json").write_text(json_text(log), encoding="utf-8")
