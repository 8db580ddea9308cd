"""`assetbuild smoke`: a trainer tries the bundle before twelve hours are spent."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from assetbuild.cli.build import build_and_print, requests_of
from assetbuild.cli.summary import shown_figures
from assetbuild.engine.world import World
from assetbuild.pipeline.building import check_name, check_of, check_requests
from assetbuild.report.document import Report


def run(arguments: argparse.Namespace) -> int:
    """Make what is missing, build, print what each trainer found; 1 when one refuses."""
    consumers = tuple(dict.fromkeys(arguments.consumer))
    requests = [replace(request, smoke=consumers) for request in requests_of(arguments)]
    check_requests(requests)
    if not _agreed(environments_to_make(consumers), arguments.yes):
        return 2
    for consumer in consumers:
        check_of(consumer).home.make(lambda line: print(line, file=sys.stderr))
    outcomes = build_and_print(requests, World())
    reports = [outcome.report for outcome in outcomes if outcome.report is not None]
    for report in reports:
        for name in consumers:
            result = report.checks.get(check_name(name))
            if result is not None:
                figures = str(
                    result.figures.get("summary")
                    or ", ".join(f"{k} {v}" for k, v in sorted(result.figures.items()))
                )
                print(f"{report.robot} in {name}: {result.status}; {shown_figures(name, figures)}")
    missing = list(lacks(reports, consumers))
    for line in missing:
        print(f"error: {line}", file=sys.stderr)
    return max([outcome.exit_code for outcome in outcomes] + ([1] if missing else []))


def _agreed(lines: Sequence[str], yes: bool) -> bool:
    """Say what would be downloaded, and ask where somebody can answer."""
    for line in lines:
        print(line, file=sys.stderr)
    if not lines or yes or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return True
    print("Go on? [Y/n] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("", "y", "yes")


def environments_to_make(consumers: Sequence[str]) -> list[str]:
    """For each environment that is missing: what is downloaded, and where it goes."""
    homes = [(consumer, check_of(consumer).home) for consumer in consumers]
    return [
        f"{name} needs an environment of its own, made once: {home.size or 'size unknown'}, "
        f"in {home.folder}"
        for name, home in homes
        if home.python(World()) is None
    ]


def lacks(reports: Iterable[Report], consumers: Sequence[str]) -> Iterator[str]:
    """Consumers that were asked for and did not run, with the reason."""
    for report in reports:
        for consumer in consumers:
            result = report.checks.get(check_name(consumer))
            if result is None or result.status == "skip":
                why = result.note if result else "its check did not run"
                yield f"{report.robot}: {consumer} was not asked: {why}"
