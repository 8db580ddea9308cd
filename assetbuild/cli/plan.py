"""`assetbuild plan`: the graph of a recipe."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

HELP = "print the graph of a recipe"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("recipe", type=Path, metavar="RECIPE")
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")
    parser.add_argument("--format", choices=("text", "json", "dot"), default="text")


def run(arguments: argparse.Namespace) -> int:
    """Print the graph as far as it is known."""
    from assetbuild.pipeline.opening import opened, planned

    loaded, lock, session = opened(arguments.recipe, arguments.variant)
    with session:
        graph, _, whole = planned(loaded, lock, session)
    match arguments.format:
        case "json":
            print(json.dumps(graph.to_json(), indent=2, sort_keys=True))
        case "dot":
            print(graph.to_dot())
        case _:
            print(graph.to_text())
    if not whole:
        print("the graph goes on once these steps are built", file=sys.stderr)
    return 0
