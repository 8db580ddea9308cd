"""build_all(): plan and execute until no question is open, then report, then the bundle."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from assetbuild.engine.execute import Listener
from assetbuild.engine.make import NodeResult
from assetbuild.engine.planner import Planner, Settled, settle_all
from assetbuild.engine.processes import Processes
from assetbuild.engine.rebuild import Difference, run_again
from assetbuild.engine.session import Session
from assetbuild.engine.store import OUT_OPTION, LostObjectError, machine_errors
from assetbuild.engine.world import World
from assetbuild.errors import AssetBuildError, Gather, RecipeError, UsageError, counted
from assetbuild.lock import Lock
from assetbuild.pipeline.bundling import bundle_files, publish_bundle
from assetbuild.pipeline.judging import evaluate, failures
from assetbuild.pipeline.opening import open_session, pin, remote_cache
from assetbuild.pipeline.publish import check_replaceable
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import Outline, plan
from assetbuild.plugin_types import Check
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.report.bundle import json_text
from assetbuild.report.document import FailOn, Report, fails
from assetbuild.report.verdict import TRAINER_CHECKS
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Tree
from assetbuild.simulators.consumers import ConsumerCheck

if TYPE_CHECKING:
    from assetbuild.engine.share.remote import Remote


@dataclass(frozen=True)
class Request:
    """What the user asks of a build. out: default `build/<robot>`, or `build/<robot>-<variant>`.

    jobs: default, all cores.

    smoke: consumers that try the bundle, besides those of the recipe.
    """

    recipe: Path
    out: Path | None = None
    variant: str | None = None
    jobs: int | None = None
    remote: str = ""
    cache_write: bool = False
    keep_going: bool = False
    frozen: bool = False
    rehash: bool = False
    rebuild_check: bool = False
    executor: str = "local"
    fail_on: FailOn = "error"
    smoke: tuple[str, ...] = ()

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Request:  # Any: words of a command line
        """What a command line says; what is no field is left."""
        return cls(**{each.name: values[each.name] for each in fields(cls) if each.name in values})


@dataclass
class Outcome:
    """What came of a build.

    out: where the bundle lies, None when a step failed. edited: files of the user that were set
    aside. errors: of the failed steps, in the order of the graph. differences: what the second
    run of `--rebuild-check` found.
    """

    loaded: LoadedRecipe
    exit_code: int
    results: Mapping[str, NodeResult]
    seconds: float = 0.0
    out: Path | None = None
    report: Report | None = None
    edited: tuple[str, ...] = ()
    errors: tuple[AssetBuildError, ...] = ()
    differences: tuple[Difference, ...] = ()


@dataclass(frozen=True)
class _Job:
    """One recipe of a build, ready to be planned. name: its robot, which no other job builds."""

    name: str
    loaded: LoadedRecipe
    lock: Lock | None
    out: Path


def build_all(
    requests: Sequence[Request],
    on_event: Listener,
    say: Callable[[str], None],
    world: World | None = None,
) -> list[Outcome]:
    """Build several recipes as one graph; they differ in `recipe` and `out` only.

    world: its record tells afterwards what all of them asked, also of a build that failed.
    Raises AssetBuildError for wrong input; failed steps are in the outcomes.
    """
    started = time.monotonic()
    request = requests[0]
    remote = remote_cache(request.remote, say, write=request.cache_write)
    jobs = _jobs(requests, world or World(), say)
    with (
        open_session(
            *(job.loaded for job in jobs), rehash=request.rehash, remote=remote
        ) as session,
        _runner(request, session, remote) as runner,
    ):
        if session.store.notice:
            say(f"warning: {session.store.notice}")
        for attempt in (1, 2, 3):
            try:
                outcomes = _build(jobs, session, runner, request, on_event, say)
                break
            except LostObjectError:  # found corrupt while it was read: make it again
                session.forget()
                if attempt == 3:
                    raise
    for job, outcome in zip(jobs, outcomes, strict=True):
        outcome.seconds = time.monotonic() - started
        if outcome.report is not None:
            _write_run_log(outcome, job.out)
    return outcomes


def read_recipes(requests: Sequence[Request], world: World) -> list[LoadedRecipe]:
    """Every recipe; RecipeError with the mistakes in all of them."""
    recipes, wrong = list[LoadedRecipe](), Gather(RecipeError)
    for request in requests:
        with wrong:
            recipes.append(load_recipe(request.recipe, request.variant, world.part()))
    wrong.stop()
    return recipes


def _jobs(requests: Sequence[Request], world: World, say: Callable[[str], None]) -> list[_Job]:
    """Read and pin every recipe before any is built."""
    jobs: list[_Job] = []
    for request, loaded in zip(requests, read_recipes(requests, world), strict=True):
        if request.smoke:
            loaded = _asking(loaded, request.smoke)
        name = loaded.recipe.robot
        place = f"{name}-{loaded.variant}" if loaded.variant else name
        out = request.out or Path("build") / place
        if any(job.name == name for job in jobs):
            raise UsageError(f"two of the recipes build `{name}`", hint="build them one by one")
        check_replaceable(out)
        jobs.append(_Job(name, loaded, pin(loaded, frozen=request.frozen, say=say), out))
    return jobs


def check_of(consumer: str) -> type[ConsumerCheck]:
    """The check that asks this consumer."""
    check = load_plugin(Check, check_name(consumer))
    assert issubclass(check, ConsumerCheck)  # noqa: S101 # all of that name are
    return check


def check_name(consumer: str) -> str:
    """The name of its check: one that trains nothing is called as it is."""
    name = f"{TRAINER_CHECKS}{consumer}"
    return name if name in plugin_names(Check) else consumer


def _asking(loaded: LoadedRecipe, consumers: Sequence[str]) -> LoadedRecipe:
    """The recipe that asks these consumers too, with the targets that they read."""
    validate, targets = loaded.recipe.validate_, loaded.recipe.targets
    smoke = tuple(dict.fromkeys((*validate.smoke, *consumers)))
    needs = [need for consumer in smoke for need in check_of(consumer).needs]
    asked = validate.model_copy(update={"smoke": smoke})
    return loaded.but(validate_=asked, targets=tuple(dict.fromkeys((*targets, *needs))))


def _build(
    jobs: Sequence[_Job],
    session: Session,
    runner: Processes,
    request: Request,
    on_event: Listener,
    say: Callable[[str], None],
) -> list[Outcome]:
    settled = settle_all(
        {job.name: functools.partial(_planned, job, say, set()) for job in jobs},
        session,
        runner,
        jobs=request.jobs,
        keep_going=request.keep_going,
        on_event=on_event,
    )
    runner.rest()
    outcomes = []
    for job, done in zip(jobs, settled.values(), strict=True):
        outcome = _finish(job, done, session, request)
        if request.rebuild_check and outcome.report is not None:
            say("running every step a second time")
            keep = job.out.with_name(f"{job.out.name}.rebuild-check")
            outcome.differences = run_again(
                done.graph,
                session,
                done.results,
                runner,
                keep,
                jobs=request.jobs,
                on_event=on_event,
            )
            outcome.exit_code = outcome.exit_code or (4 if outcome.differences else 0)
        outcomes.append(outcome)
    return outcomes


def _planned(job: _Job, say: Callable[[str], None], messages: set[str], p: Planner) -> Outline:
    """The plan of one recipe; says once what the robot is, as soon as it is read.

    messages: of earlier rounds.
    """
    outline = plan(job.loaded, job.lock, p)
    if outline.tree is not None and not messages:
        messages.add(_robot_words(outline.tree))
        say(f"{job.name}: {_robot_words(outline.tree)}")
    return outline


def _robot_words(tree: Tree) -> str:
    """`13 bodies, 12 moving joints, 13.1 kg`."""
    bodies = counted(len(tree.bodies), "body", "bodies")
    joints = counted(len(tree.moving_joints), "moving joint")
    return f"{bodies}, {joints}, {total_mass(tree):.3g} kg"


def _finish(job: _Job, done: Settled[Outline], session: Session, request: Request) -> Outcome:
    """Report and bundle of one recipe, if all its steps went well."""
    loaded, out, results = job.loaded, job.out, done.results
    outcome = Outcome(loaded, 0, results)
    # Once, where a picture and a target refuse the same.
    outcome.errors = tuple({str(each): each for each in failures(loaded, done, session)}.values())
    if not done.whole or any(result.outputs is None for result in results.values()):
        outcome.exit_code = max((error.exit_code for error in outcome.errors), default=1)
        return outcome
    report = evaluate(loaded, done, session)
    outcome.exit_code = 1 if fails(report, request.fail_on) else 0
    outcome.out = out.with_name(f"{out.name}.failed") if outcome.exit_code else out
    files = bundle_files(loaded, job.lock, done, report, session)
    outcome.edited = publish_bundle(files, outcome.out, session)
    outcome.report = report
    return outcome


def _runner(request: Request, session: Session, remote: Remote | None) -> Processes:
    """Where the steps run. UsageError; MachineError when the cluster does not answer."""
    if request.executor == "local":
        return Processes(session)
    from assetbuild.engine.share.cluster import Cluster, scheduler_address

    scheduler_address(request.executor)
    if remote is None or not request.cache_write:
        raise UsageError(
            "workers on other machines need `--remote URL` and `--cache-write`",
            hint="their inputs and results go through the shared cache",
        )
    return Cluster(request.executor, remote, session)


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
    with machine_errors(out.parent, OUT_OPTION):
        out.with_name(f"{out.name}.run.json").write_text(json_text(log), encoding="utf-8")
