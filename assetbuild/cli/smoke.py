"""`assetbuild smoke`: a trainer tries the bundle before twelve hours are spent."""

from __future__ import annotations

import argparse
from pathlib import Path

from assetbuild.cli.recipes import Recipes

HELP = "build the bundle and let a trainer load, step and train it for a moment"
CONSUMERS = ("mjlab", "newton", "isaaclab")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("recipes", nargs="+", type=Path, metavar="RECIPE", action=Recipes)
    parser.add_argument(
        "--consumer", choices=CONSUMERS, action="append", required=True, help="may be repeated"
    )
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="default: build/<robot>")
    parser.add_argument("-j", "--jobs", type=int, metavar="N", help="default: all cores")
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")


def run(arguments: argparse.Namespace) -> int:
    """Make what is missing, build, print what each trainer found; 1 when one refuses."""
    import sys

    from assetbuild.cli.build import build_and_print
    from assetbuild.cli.public import shown_figures
    from assetbuild.errors import UsageError
    from assetbuild.pipeline.building import Request
    from assetbuild.pipeline.smoking import lacks, make_environments

    if arguments.out is not None and len(arguments.recipes) > 1:
        raise UsageError("`-o` names one bundle, but several recipes were given")
    consumers = tuple(dict.fromkeys(arguments.consumer))
    make_environments(consumers, say=lambda line: print(line, file=sys.stderr))
    requests = [
        Request(
            recipe=recipe,
            out=arguments.out,
            variant=arguments.variant,
            jobs=arguments.jobs,
            smoke=consumers,
        )
        for recipe in arguments.recipes
    ]
    outcomes = build_and_print(requests)
    reports = [outcome.report for outcome in outcomes if outcome.report is not None]
    for report in reports:
        for name in consumers:
            result = report.checks.get(f"smoke_{name}")
            if result is not None:
                figures = ", ".join(f"{k} {v}" for k, v in sorted(result.figures.items()))
                print(f"{report.robot} in {name}: {result.status}; {shown_figures(name, figures)}")
    missing = list(lacks(reports, consumers))
    for line in missing:
        print(f"error: {line}", file=sys.stderr)
    return max([outcome.exit_code for outcome in outcomes] + ([1] if missing else []))
