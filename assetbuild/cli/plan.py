"""`assetbuild plan`: the graph of a recipe."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence

from assetbuild.pipeline import drawing
from assetbuild.pipeline.mapping import reached_first, seconds_of
from assetbuild.pipeline.opening import opened
from assetbuild.pipeline.recipes import load_recipe


def run(arguments: argparse.Namespace) -> int:
    """Print the graph as far as it is known, or what is asked of it."""
    with opened(load_recipe(arguments.recipe, arguments.variant)) as look:
        known = look.known()
        graph, asked = known.graph, arguments.stale is not None or arguments.critical
        if arguments.format in ("json", "text") and not asked:
            _print_graph(drawing.to_data(graph), drawing.to_text(graph), arguments.format)
        else:
            seconds = seconds_of(graph, look.session)
            net = drawing.network(graph, seconds)
            marked: Sequence[str] = ()
            head = "a build with enough cores waits for"
            if arguments.stale is not None:
                reached = drawing.behind(net, reached_first(arguments.stale, graph, look))
                marked = [label for label in graph.nodes if label in reached]
                head = f"a change of `{arguments.stale}` can reach"
            elif arguments.critical:
                marked = drawing.critical_path(net)
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
    if not known.whole:
        print("the graph goes on once these steps are built", file=sys.stderr)
    return 0


def _print_graph(data: object, text: str, form: str) -> None:
    print(text if form == "text" else json.dumps(data, indent=2, sort_keys=True))


def _print_marked(head: str, marked: Sequence[str], seconds: Mapping[str, float]) -> None:
    """seconds: of all steps of the graph that have been built."""
    of_these = sum(seconds.get(label, 0.0) for label in marked)
    took = f"{of_these:.1f} of {sum(seconds.values()):.1f} s when they last ran"
    print(f"{head} {len(marked)} steps, {took}")
    for label in marked:
        print(f"  {f'{seconds[label]:8.2f} s' if label in seconds else 'not built':>10}  {label}")
