"""`assetbuild plan` and `explain`: the graph of a recipe; why its steps ran or would run."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from assetbuild.cli.parser import given_as
from assetbuild.engine.explain import Explanation, explain
from assetbuild.engine.graph import Graph
from assetbuild.errors import OutOfDateError, UsageError, did_you_mean
from assetbuild.pipeline.opening import opened
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.report.bundle import roles_of


def run(arguments: argparse.Namespace) -> int:
    """Print the graph as far as it is known."""
    with opened(load_recipe(arguments.recipe, arguments.variant)) as look:
        known = look.known()
    write = {"text": to_text, "json": to_json, "dot": to_dot}[arguments.format]
    print(write(known.graph))
    if not known.whole:
        print("the graph goes on once these steps are built", file=sys.stderr)
    return 0


def to_text(graph: Graph) -> str:
    """The rooms of the house in the order of building, each with its steps."""
    rooms: dict[str, list[str]] = {}
    for node in graph.nodes.values():
        room = type(node.step).__module__.removeprefix("assetbuild.").partition(".")[0]
        rooms.setdefault(room, []).append(node.label)
    lines = []
    for room, labels in rooms.items():
        lines.append(f"{room}: {len(labels)} step{'s' if len(labels) > 1 else ''}")
        lines += [f"  {label}" for label in labels]
    return "\n".join(lines)


def to_json(graph: Graph) -> str:
    """The steps in the order of building, as plain data."""
    nodes = [
        {
            "label": node.label,
            "step": node.step.step_name(),
            "outputs": list(node.step.outputs),
            "inputs": {name: str(ref) for name, ref in node.inputs.items()},
        }
        for node in graph.nodes.values()
    ]
    return json.dumps({"nodes": nodes}, indent=2, sort_keys=True)


def to_dot(graph: Graph) -> str:
    """Write the graph for Graphviz; sources are boxes."""
    lines = ["digraph assetbuild {", "  rankdir=LR;"]
    for label, node in graph.nodes.items():
        lines.append(f"  {json.dumps(label)};")
        for name, ref in sorted(node.inputs.items()):
            maker = json.dumps(ref.node or Path(ref.output).name)
            if not ref.node:
                lines.append(f"  {maker} [shape=box];")
            lines.append(f"  {maker} -> {json.dumps(label)} [label={json.dumps(name)}];")
    return "\n".join([*lines, "}"])


# --- why steps run --------------------------------------------------------------------------


def explain_steps(arguments: argparse.Namespace) -> int:
    """Print the explanations; 0, or 2 for an unknown step."""
    step = arguments.step and _step_of(arguments.step)
    explanations, whole = _explained(arguments.recipe, arguments.variant, step)
    if arguments.json:
        print(json.dumps([e.to_json() for e in explanations], indent=2, sort_keys=True))
        return 0
    for line in told_of_all(explanations) if step is None else [explanations[0].to_text()]:
        print(line)
    if not whole:
        print("the graph goes on once the stale steps are built", file=sys.stderr)
    return 0


def _step_of(named: str) -> str:
    """The target that wrote a file of a bundle; all else is the name of a step."""
    file = Path(named)
    bundle = next((above for above in file.parents if (above / "manifest.json").is_file()), None)
    if bundle is None or not file.is_file():
        return named
    return roles_of(bundle).get(file.relative_to(bundle).as_posix(), named)


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
            later = "the graph goes on once its stale steps are built: `assetbuild build` it first"
            hint = did_you_mean(step, labels) if known.whole else later
            raise UsageError(f"no step `{step}`", hint=hint)
        wanted = labels if step is None else [step]
        return [explain(known.graph, look.session, label) for label in wanted], known.whole


def told_of_all(steps: Sequence[Explanation]) -> list[str]:
    """All steps; those that nothing has touched since they were first built are counted."""
    touched = [one for one in steps if one.state != "up to date" or not one.only_first]
    left = len(steps) - len(touched)
    counted = [f"{left} of {len(steps)} steps: untouched since their first build"] if left else []
    return [*(one.to_text() for one in touched), *counted]


def print_stale(recipe: Path, variant: str | None) -> int:
    """What a build would run, and why; nothing is run. 3 when something would run, else 0."""
    explanations, whole = _explained(recipe, variant)
    stale = [explanation for explanation in explanations if explanation.state != "up to date"]
    for explanation in stale:
        print(explanation.to_text())
    more = "" if whole else ", and what follows from them"
    print(f"{given_as(recipe)}: {len(stale)} of {len(explanations)} steps would run{more}")
    return OutOfDateError.exit_code if stale or more else 0
