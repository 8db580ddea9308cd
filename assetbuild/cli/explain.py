"""`assetbuild explain`: why a step ran or would run."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.recipes import file_or_robot

if TYPE_CHECKING:
    from assetbuild.engine.explain import Explanation

HELP = "say why steps ran or would run, naming the part of the key that changed"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("recipe", type=file_or_robot, metavar="RECIPE")
    parser.add_argument("step", nargs="?", metavar="STEP", help="default: all")
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")
    parser.add_argument("--json", action="store_true", help="print data")


def run(arguments: argparse.Namespace) -> int:
    """Print the explanations; 0, or 2 for an unknown step."""
    from assetbuild.engine.explain import explain
    from assetbuild.errors import UsageError, did_you_mean
    from assetbuild.pipeline.opening import looked_at

    with looked_at(arguments.recipe, arguments.variant) as look:
        graph, session = look.done.graph, look.session
        if arguments.step is not None and arguments.step not in graph.nodes:
            hint = did_you_mean(arguments.step, graph.nodes)
            raise UsageError(f"no step `{arguments.step}`", hint=hint)
        labels = [arguments.step] if arguments.step else list(graph.nodes)
        found = [explain(graph, session, label) for label in labels]
    if arguments.json:
        print(json.dumps([e.to_json() for e in found], indent=2, sort_keys=True))
        return 0
    for line in told_of_all(found) if arguments.step is None else [found[0].to_text()]:
        print(line)
    if not look.done.whole:
        print("the graph goes on once the stale steps are built", file=sys.stderr)
    return 0


def told_of_all(found: Sequence[Explanation]) -> list[str]:
    """All steps; those that nothing has touched since they were first built are counted."""
    touched = [one for one in found if one.state != "up to date" or not one.only_first]
    left = len(found) - len(touched)
    counted = [f"{left} of {len(found)} steps: untouched since their first build"] if left else []
    return [*(one.to_text() for one in touched), *counted]


def print_stale(recipe: Path, variant: str | None) -> int:
    """What a build would run, and why; nothing is run. 3 when something would run, else 0."""
    from assetbuild.engine.explain import explain
    from assetbuild.errors import OutOfDateError
    from assetbuild.pipeline.opening import looked_at

    with looked_at(recipe, variant) as look:
        graph = look.done.graph
        found = [explain(graph, look.session, label) for label in graph.nodes]
    stale = [explanation for explanation in found if explanation.state != "up to date"]
    for explanation in stale:
        print(explanation.to_text())
    more = "" if look.done.whole else ", and what follows from them"
    print(f"{recipe}: {len(stale)} of {len(found)} steps would run{more}")
    return OutOfDateError.exit_code if stale or more else 0
