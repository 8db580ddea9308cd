"""`assetbuild smoke`: a trainer tries the bundle before twelve hours are spent."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

from assetbuild.cli.build import build_and_print, requests_of
from assetbuild.cli.summary import shown_figures
from assetbuild.engine.world import World
from assetbuild.pipeline.building import check_requests
from assetbuild.pipeline.smoking import (
    check_name,
    environments_to_make,
    lacks,
    make_environments,
)


def run(arguments: argparse.Namespace) -> int:
    """Make what is missing, build, print what each trainer found; 1 when one refuses."""
    consumers = tuple(dict.fromkeys(arguments.consumer))
    requests = [replace(request, smoke=consumers) for request in requests_of(arguments)]
    check_requests(requests)
    if not _agreed(environments_to_make(consumers), arguments.yes):
        return 2
    make_environments(consumers, say=lambda line: print(line, file=sys.stderr))
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
