"""build(): plan and execute until no question is open, then report, then the bundle."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from assetbuild.engine.execute import Event, NodeResult, execute
from assetbuild.engine.graph import Graph, Planner, joined
from assetbuild.engine.publish import check_replaceable
from assetbuild.engine.rebuild import Difference, run_again
from assetbuild.engine.session import Session
from assetbuild.engine.store import LostObjectError
from assetbuild.errors import AssetBuildError, MachineError, UsageError
from assetbuild.lock import Lock, lock_path
from assetbuild.pipeline.bundling import bundle_files, files_read, publish_bundle
from assetbuild.pipeline.judging import judged, located, where_of
from assetbuild.pipeline.opening import open_session, pin, remote_cache
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.pipeline.smoking import asking
from assetbuild.plan import Outline, plan
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.report.bundle import json_text
from assetbuild.report.document import FailOn, Report, fails

if TYPE_CHECKING:
    from assetbuild.engine.share.cluster import Cluster
    from assetbuild.engine.share.remote import Remote


@dataclass(frozen=True)
class Request:
    """What the user asks of a build. out: default `build/<robot>`; jobs: default, all cores.

    smoke: consumers that try the bundle, besides those of the recipe.
    """

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
    sandbox: Literal["off", "strict"] = "off"
    executor: str = "local"
    fail_on: FailOn = "error"
    smoke: tuple[str, ...] = ()


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
        session.remote = remote_cache(request.remote, say, write=request.cache_write)
        session.sandbox = _sandbox(request)
        session.cluster = _cluster(request, session.remote)
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
        if request.smoke:
            loaded = asking(loaded, request.smoke)
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


def _finish(job: _Job, done: _Executed, session: Session, request: Request) -> Outcome:
    """Report and bundle of one recipe, if all its steps went well."""
    loaded, lock, out = job.loaded, job.lock, job.out
    outline, results = done.outline, done.results
    outcome = Outcome(loaded, 0, results)
    outcome.errors = tuple(
        located(result.error, outline.subjects.get(label, ""), where_of(loaded, outline, label))
        for label, result in results.items()
        if result.error is not None
    )
    outcome.read = files_read(loaded, done.graph, session)
    outcome.absent = (*outline.absent, *((lock_path(loaded.path),) if lock is None else ()))
    if any(result.outputs is None for result in results.values()):
        outcome.exit_code = max((error.exit_code for error in outcome.errors), default=1)
        return outcome
    report = judged(loaded, outline, results, session)
    outcome.exit_code = 1 if fails(report, request.fail_on) else 0
    outcome.out = out.with_name(f"{out.name}.failed") if outcome.exit_code else out
    files = bundle_files(loaded, lock, outline, report, session, results, done.graph)
    outcome.edited = publish_bundle(files, outcome.out, session)
    outcome.report = report
    return outcome


def default_out(loaded: LoadedRecipe) -> Path:
    """`build/go1`, or `build/go1-train` for a variant."""
    suffix = f"-{loaded.variant}" if loaded.variant else ""
    return Path("build") / f"{loaded.recipe.robot}{suffix}"


def _sandbox(request: Request) -> bool:
    if request.sandbox == "off":
        return False
    from assetbuild.engine.sandbox import why_not

    if reason := why_not():
        raise MachineError(f"steps cannot be confined on this machine: {reason}")
    return True


def _cluster(request: Request, remote: Remote | None) -> Cluster | None:
    if request.executor == "local":
        return None
    from assetbuild.engine.share.cluster import Cluster, scheduler_address

    scheduler_address(request.executor)
    if remote is None or not request.cache_write:
        raise UsageError(
            "workers on other machines need `--remote URL` and `--cache-write`",
            hint="their inputs and results go through the shared cache",
        )
    return Cluster(request.executor, remote)


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
