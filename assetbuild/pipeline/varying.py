"""Which steps read a key of the recipe: its values are changed in turn, and the plans compared."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import replace

from assetbuild.engine.graph import Graph, Ref
from assetbuild.engine.planner import planned
from assetbuild.engine.step import Step
from assetbuild.errors import AssetBuildError, RecipeError, UsageError
from assetbuild.pipeline.opening import Look
from assetbuild.pipeline.recipes import model_of
from assetbuild.plan import plan
from assetbuild.recipe import yaml_tree as yaml
from assetbuild.recipe.validation import validated


def reached_by_key(key: str, look: Look) -> list[str]:
    """The steps that read a value below a key such as `actuators.0.kp`. UsageError.

    Numbers and switches get another value, and each entry is left out once; what the recipe's own
    rules refuse then is passed over.
    """
    before = _steps(look.done.graph)
    reached: set[str] = set()
    compared = 0
    for tree in _varied_at(look.loaded.tree, key.split(".")):
        try:
            model, misnamed = model_of(tree)
            recipe = validated(model, tree, RecipeError, misnamed=misnamed)
            changed = replace(look.loaded, recipe=recipe, tree=tree)
            now = planned(functools.partial(plan, changed, look.lock), look.session)
        except AssetBuildError:
            continue
        compared += 1
        steps = _steps(now.graph)
        reached |= {label for label, step in before.items() if steps.get(label) != step}
    if not compared:
        raise UsageError(
            f"`{key}` is a key of the recipe of which no value can be changed alone",
            hint="change it in the recipe: `assetbuild build -n` says what would run",
        )
    return sorted(reached)


def _steps(graph: Graph) -> dict[str, tuple[Step, dict[str, Ref]]]:
    return {label: (node.step, dict(node.inputs)) for label, node in graph.nodes.items()}


def _varied_at(tree: yaml.Node, key: list[str]) -> Iterator[yaml.Node]:
    """The tree with one value below the key changed or left out, each in turn."""
    name, *rest = key
    child = _children(tree).get(name)
    if child is not None:
        for other in _varied_at(child, rest) if rest else _varied(child):
            yield _replaced(tree, name, other)


def _varied(node: yaml.Node) -> Iterator[yaml.Node | None]:
    """What may stand in place of this value; None = nothing."""
    value = node.value
    if isinstance(value, bool):
        yield replace(node, value=not value)
    elif isinstance(value, int):
        yield replace(node, value=value + 1)
    elif isinstance(value, float):
        yield replace(node, value=0.9 * value or 0.1)
    for name, child in _children(node).items():
        for other in _varied(child):
            yield _replaced(node, name, other)
    yield None


def _children(node: yaml.Node) -> dict[str, yaml.Node]:
    """Entries of a map by their keys, items of a list by their numbers."""
    if isinstance(node.value, dict):
        return {name: entry.node for name, entry in node.value.items()}
    if isinstance(node.value, tuple):
        return {str(number): item for number, item in enumerate(node.value)}
    return {}


def _replaced(node: yaml.Node, name: str, other: yaml.Node | None) -> yaml.Node:
    """The same map or list with another child of this name, or without it."""
    children: dict[str, yaml.Node | None] = {**_children(node), name: other}
    kept = {key: child for key, child in children.items() if child is not None}
    if isinstance(node.value, tuple):
        return replace(node, value=tuple(kept.values()))
    return replace(node, value={key: yaml.Entry(c.where, c) for key, c in kept.items()})
