"""`assetbuild plan`: the graph of a recipe."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from assetbuild.cli.recipes import file_or_robot

if TYPE_CHECKING:
    from assetbuild.pipeline.opening import Look

HELP = "print the graph of a recipe, what a change reaches, what a build waits for"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("recipe", type=file_or_robot, metavar="RECIPE")
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")
    parser.add_argument("--format", choices=("text", "json", "dot", "graphml"), default="text")
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--stale", metavar="WHAT", help="the steps that a change of a file, step or key can reach"
    )
    which.add_argument(
        "--critical", action="store_true", help="the steps that take longest, one after the other"
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the graph as far as it is known."""
    from assetbuild.pipeline import drawing
    from assetbuild.pipeline.opening import looked_at

    with looked_at(arguments.recipe, arguments.variant) as look:
        asked = arguments.stale is not None or arguments.critical
        if arguments.format == "json" and not asked:
            print(json.dumps(drawing.to_data(look.done.graph), indent=2, sort_keys=True))
        elif arguments.format == "text" and not asked:
            print(drawing.to_text(look.done.graph))
        else:
            _answer(arguments, look)
    if not look.done.whole:
        print("the graph goes on once these steps are built", file=sys.stderr)
    return 0


def _answer(arguments: argparse.Namespace, look: Look) -> None:
    """In words, or for another tool with these steps marked."""
    from assetbuild.pipeline import drawing
    from assetbuild.pipeline.mapping import reached_first, seconds_of

    seconds = seconds_of(look)
    net = drawing.network(look.done.graph, seconds)
    marked: Sequence[str] = ()
    head = ""
    if arguments.stale is not None:
        reached = drawing.behind(net, reached_first(arguments.stale, look))
        marked = [label for label in look.done.graph.nodes if label in reached]
        head = f"a change of `{arguments.stale}` can reach"
    elif arguments.critical:
        marked = drawing.critical_path(net)
        head = "a build with enough cores waits for"
    match arguments.format:
        case "dot":
            print(drawing.to_dot(net, marked))
        case "graphml":
            print(drawing.to_graphml(net, marked))
        case "json":
            rows = [{"label": label, "seconds": seconds.get(label)} for label in marked]
            print(json.dumps(rows, indent=2))
        case _:
            _print_marked(head, marked, seconds)


def _print_marked(head: str, marked: Sequence[str], seconds: Mapping[str, float]) -> None:
    """seconds: of all steps of the graph that have been built."""
    of_these = sum(seconds.get(label, 0.0) for label in marked)
    took = f"{of_these:.1f} of {sum(seconds.values()):.1f} s when they last ran"
    print(f"{head} {len(marked)} steps, {took}")
    for label in marked:
        print(f"  {f'{seconds[label]:8.2f} s' if label in seconds else 'not built':>10}  {label}")
