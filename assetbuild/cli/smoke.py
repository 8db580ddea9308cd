"""`assetbuild smoke`: a trainer tries the bundle before twelve hours are spent."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

from assetbuild.cli.build import build_and_print, requests_of
from assetbuild.cli.summary import shown_figures
from assetbuild.engine.world import World
from assetbuild.pipeline.building import check_name, check_of, read_recipes
from assetbuild.report.document import Report


def run(arguments: argparse.Namespace) -> int:
    """Make what is missing, build, print what each trainer found; 1 when one refuses."""
    consumers = tuple(dict.fromkeys(arguments.consumer))
    requests = [replace(request, smoke=consumers) for request in requests_of(arguments)]
    read_recipes(requests, World())  # a mistake shows before anything large is fetched
    if not _agreed(environments_to_make(consumers), arguments.yes):
        return 2
    for consumer in consumers:
        check_of(consumer).home.make(lambda line: print(line, file=sys.stderr))
    outcomes = build_and_print(requests, World())
    reports = [outcome.report for outcome in outcomes if outcome.report is not None]
    asked = [_print_answer(report, name) for report in reports for name in consumers]
    return max([*(outcome.exit_code for outcome in outcomes), *(int(not one) for one in asked)])


def _print_answer(report: Report, consumer: str) -> bool:
    """What a trainer made of a robot; whether it ran."""
    result = report.checks.get(check_name(consumer))
    if result is not None:
        every = ", ".join(f"{key} {value}" for key, value in sorted(result.figures.items()))
        figures = shown_figures(consumer, str(result.figures.get("summary") or every))
        print(f"{report.robot} in {consumer}: {result.status}; {figures}")
    if result is None or result.status == "skip":
        why = result.note if result else "its check did not run"
        print(f"error: {report.robot}: {consumer} was not asked: {why}", file=sys.stderr)
        return False
    return True


def _agreed(lines: Sequence[str], yes: bool) -> bool:
    """Say what would be downloaded, and ask where somebody can answer."""
    for line in lines:
        print(line, file=sys.stderr)
    if not lines or yes or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return True
    print("Go on? [Y/n] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("", "y", "yes")


def environments_to_make(consumers: Sequence[str]) -> list[str]:
    """Tell of each missing environment what is downloaded, and where it goes."""
    homes = [(consumer, check_of(consumer).home) for consumer in consumers]
    return [
        f"{name} needs an environment of its own, made once: {home.size or 'size unknown'}, "
        f"in {home.folder}"
        for name, home in homes
        if home.python(World()) is None
    ]
