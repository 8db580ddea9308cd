"""`assetbuild explain`: why a step ran or would run."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from assetbuild.engine.explain import Explanation, explain
from assetbuild.errors import OutOfDateError, UsageError, did_you_mean
from assetbuild.pipeline.opening import opened
from assetbuild.pipeline.recipes import load_recipe


def run(arguments: argparse.Namespace) -> int:
    """Print the explanations; 0, or 2 for an unknown step."""
    step = arguments.step
    found, whole = _explained(arguments.recipe, arguments.variant, step)
    if arguments.json:
        print(json.dumps([e.to_json() for e in found], indent=2, sort_keys=True))
        return 0
    for line in told_of_all(found) if step is None else [found[0].to_text()]:
        print(line)
    if not whole:
        print("the graph goes on once the stale steps are built", file=sys.stderr)
    return 0


def _explained(
    recipe: Path, variant: str | None, step: str | None = None
) -> tuple[list[Explanation], bool]:
    """(explanations of one step or of all steps, whether the graph is complete). UsageError for an
    unknown step.
    """
    with opened(load_recipe(recipe, variant)) as look:
        known = look.known()
        labels = list(known.graph.nodes)
        if step is not None and step not in labels:
            raise UsageError(f"no step `{step}`", hint=did_you_mean(step, labels))
        wanted = labels if step is None else [step]
        return [explain(known.graph, look.session, label) for label in wanted], known.whole


def told_of_all(found: Sequence[Explanation]) -> list[str]:
    """All steps; those that nothing has touched since they were first built are counted."""
    touched = [one for one in found if one.state != "up to date" or not one.only_first]
    left = len(found) - len(touched)
    counted = [f"{left} of {len(found)} steps: untouched since their first build"] if left else []
    return [*(one.to_text() for one in touched), *counted]


def print_stale(recipe: Path, variant: str | None) -> int:
    """What a build would run, and why; nothing is run. 3 when something would run, else 0."""
    found, whole = _explained(recipe, variant)
    stale = [explanation for explanation in found if explanation.state != "up to date"]
    for explanation in stale:
        print(explanation.to_text())
    more = "" if whole else ", and what follows from them"
    print(f"{recipe}: {len(stale)} of {len(found)} steps would run{more}")
    return OutOfDateError.exit_code if stale or more else 0
