"""`assetbuild build`: recipes to bundles."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from assetbuild.cli.outputs import EventLog, event_log, tell_github, write_junit
from assetbuild.cli.plan import print_stale
from assetbuild.cli.progress import progress
from assetbuild.cli.summary import null_summary, print_differences, print_summary
from assetbuild.engine import noop_build
from assetbuild.engine.digest import digest_file
from assetbuild.engine.execute import Event
from assetbuild.engine.machine import cache_root
from assetbuild.engine.world import World
from assetbuild.errors import AssetBuildError, UsageError
from assetbuild.pipeline.building import Outcome, Request, build_all
from assetbuild.pipeline.publish import OWN_FILES
from assetbuild.report.bundle import manifest_of


def run(arguments: argparse.Namespace) -> int:
    """Build the recipes as one graph; the worst exit code of all."""
    requests = requests_of(arguments)
    if arguments.dry_run:
        return max(print_stale(request.recipe, request.variant) for request in requests)
    world, began_ns = World(), time.time_ns()
    outcomes = build_and_print(requests, world, arguments.log_json, arguments.report_junit)
    if not (arguments.rebuild_check or arguments.log_json or arguments.report_junit):
        _remember(outcomes, world, began_ns)
    return max(outcome.exit_code for outcome in outcomes)


def requests_of(arguments: argparse.Namespace) -> list[Request]:
    """One for each recipe. UsageError when the arguments do not fit together."""
    if arguments.out is not None and len(arguments.recipes) > 1:
        raise UsageError("`-o` names one bundle, but several recipes were given")
    if arguments.sandbox:
        print("warning: `--sandbox` no longer has an effect; omit it", file=sys.stderr)
    options = vars(arguments)
    return [Request.of({**options, "recipe": recipe}) for recipe in arguments.recipes]


def build_and_print(
    requests: Sequence[Request],
    world: World,
    log_json: Path | None = None,
    report_junit: Path | None = None,
) -> list[Outcome]:
    """Build with progress, and print what came of it. AssetBuildError for wrong input.

    world: its record tells afterwards what was asked.
    """
    outcomes: list[Outcome] = []
    failure: AssetBuildError | None = None
    with event_log(log_json) as log:
        try:
            outcomes = _build_shown(requests, world, log)
        except AssetBuildError as error:
            errors = [str(each) for each in error.each()]
            log.write("error", message=str(error), errors=errors, exit_code=error.exit_code)
            failure = error
        for outcome in outcomes:
            log.on_outcome(outcome)
    if report_junit is not None:
        write_junit(report_junit, outcomes, failure)
    tell_github(outcomes, failure)
    if failure is not None:
        raise failure
    for outcome in outcomes:
        print_summary(outcome)
        if requests[0].rebuild_check:
            print_differences(outcome)
    return outcomes


def _build_shown(requests: Sequence[Request], world: World, log: EventLog) -> list[Outcome]:
    name = requests[0].recipe.name if len(requests) == 1 else "assetbuild"
    with progress(name) as shown:

        def on_event(event: Event) -> None:
            shown.on_event(event)
            log.on_event(event)

        def say(text: str) -> None:
            shown.say(text)
            log.write("message", text=text)

        return build_all(requests, on_event, say, world)


def _remember(outcomes: Sequence[Outcome], world: World, began_ns: int) -> None:
    """Leave a record with which `__main__` answers the same command by `stat` alone.

    It is found by the command's words and working folder, so that nothing has to be parsed to find
    it. A store that cannot be written to costs only speed.
    """
    made: dict[str, str] = {}
    folders: list[str] = []
    summary = ""
    for outcome in outcomes:
        bundle, report = outcome.out, outcome.report
        if outcome.exit_code != 0 or bundle is None or report is None:
            return
        digests = manifest_of(bundle) | {name: digest_file(bundle / name) for name in OWN_FILES}
        made |= {str(bundle / name): digest for name, digest in digests.items()}
        folders.append(str(bundle))
        summary += null_summary(outcome, report)
    options = "\n".join((os.getcwd(), *sys.argv[1:]))  # noqa: PTH109 # as `__main__` does
    with contextlib.suppress(OSError):
        noop_build.write(
            noop_build.record_file(cache_root(), options),
            options=options,
            asked=world.record,
            made=made,
            folders=folders,
            exit_code=0,
            summary=summary,
            began_ns=began_ns,
        )
