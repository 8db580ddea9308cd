"""`assetbuild build`: recipes to bundles."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.cache import add_sharing
from assetbuild.cli.parser import whole_number
from assetbuild.cli.recipes import Recipes, file_or_robot
from assetbuild.errors import AssetBuildError

if TYPE_CHECKING:
    from assetbuild.cli.outputs import EventLog
    from assetbuild.engine.execute import Event
    from assetbuild.engine.world import World
    from assetbuild.pipeline.building import Outcome, Request

HELP = "build the bundle; only stale steps run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_plain_arguments(parser)
    parser.add_argument(
        "-n",
        "--dry-run",
        action="store_true",
        help="say what would run; exit code 3 where something would",
    )
    parser.add_argument("--rehash", action="store_true", help="read every source file again")
    parser.add_argument(
        "--rebuild-check", action="store_true", help="run every step twice and compare"
    )
    parser.add_argument("--log-json", type=Path, metavar="FILE", help="write events, one per line")
    parser.add_argument("--report-junit", type=Path, metavar="FILE", help="write JUnit XML")


def add_plain_arguments(parser: argparse.ArgumentParser) -> None:
    """Those that `watch` takes too."""
    parser.add_argument("recipes", nargs="+", type=file_or_robot, metavar="RECIPE", action=Recipes)
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="default: build/<robot>")
    parser.add_argument(
        "-j", "--jobs", type=whole_number(1), metavar="N", help="default: all cores"
    )
    parser.add_argument("-k", "--keep-going", action="store_true", help="build what still can be")
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")
    parser.add_argument("--frozen", action="store_true", help="fail rather than write a lock")
    add_sharing(parser)
    parser.add_argument(
        "--executor",
        default="local",
        metavar="WHERE",
        help="local, or dask://HOST:PORT: run steps on the workers of that scheduler",
    )
    parser.add_argument(
        "--sandbox",
        choices=("off", "strict"),
        help="no longer has an effect; the next version removes it",
    )
    parser.add_argument(
        "--fail-on", choices=("error", "warning", "never"), default="error", help="default: error"
    )


def run(arguments: argparse.Namespace) -> int:
    """Build the recipes as one graph; the worst exit code of all."""
    from assetbuild.engine.world import World

    requests = requests_of(arguments)
    if arguments.dry_run:
        return max(_dry_run(request) for request in requests)
    requests = [
        replace(request, rehash=arguments.rehash, rebuild_check=arguments.rebuild_check)
        for request in requests
    ]
    world, began_ns = World(), time.time_ns()
    outcomes = build_and_print(requests, world, arguments.log_json, arguments.report_junit)
    if not (arguments.rebuild_check or arguments.log_json or arguments.report_junit):
        _remember(outcomes, world, began_ns)
    return max(outcome.exit_code for outcome in outcomes)


def requests_of(arguments: argparse.Namespace) -> list[Request]:
    """One for each recipe. UsageError when the arguments do not fit together."""
    from assetbuild.errors import UsageError
    from assetbuild.pipeline.building import Request

    if arguments.out is not None and len(arguments.recipes) > 1:
        raise UsageError("`-o` names one bundle, but several recipes were given")
    if arguments.sandbox:
        print("warning: `--sandbox` no longer has an effect; omit it", file=sys.stderr)
    return [
        Request(
            recipe=recipe,
            out=arguments.out,
            variant=arguments.variant,
            jobs=arguments.jobs,
            keep_going=arguments.keep_going,
            frozen=arguments.frozen,
            remote=arguments.remote,
            cache_write=arguments.cache_write,
            executor=arguments.executor,
            fail_on=arguments.fail_on,
        )
        for recipe in arguments.recipes
    ]


def build_and_print(
    requests: list[Request],
    world: World,
    log_json: Path | None = None,
    report_junit: Path | None = None,
) -> list[Outcome]:
    """Build with progress, and print what came of it. AssetBuildError for wrong input.

    world: its record tells afterwards what was asked.
    """
    from assetbuild.cli.outputs import event_log, tell_github, write_junit
    from assetbuild.cli.summary import print_differences, print_summary

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


def _build_shown(requests: list[Request], world: World, log: EventLog) -> list[Outcome]:
    from assetbuild.cli.progress import progress
    from assetbuild.pipeline.building import build_all

    name = requests[0].recipe.name if len(requests) == 1 else "assetbuild"
    with progress(name) as shown:

        def on_event(event: Event) -> None:
            shown.on_event(event)
            log.on_event(event)

        def say(text: str) -> None:
            shown.say(text)
            log.write("message", text=text)

        return build_all(requests, on_event, say, world)


def _remember(outcomes: list[Outcome], world: World, began_ns: int) -> None:
    """Leave a record with which the same command is answered by `stat` alone."""
    from assetbuild.cli.null import remember
    from assetbuild.cli.summary import null_summary

    if all(outcome.exit_code == 0 and outcome.report and outcome.is_shared for outcome in outcomes):
        summary = "".join(null_summary(o, o.report) for o in outcomes if o.report is not None)
        bundles = [outcome.out for outcome in outcomes if outcome.out is not None]
        remember(sys.argv[1:], bundles, world, summary, began_ns)


def _dry_run(request: Request) -> int:
    from assetbuild.cli.explain import print_stale

    return print_stale(request.recipe, request.variant)
