"""Which steps a change reaches, and how long each took; a key is tried with other values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from assetbuild.engine.graph import Graph, Ref
from assetbuild.engine.resolver import Resolver
from assetbuild.engine.session import Session
from assetbuild.engine.step import Step
from assetbuild.errors import AssetBuildError, RecipeError, UsageError, did_you_mean
from assetbuild.pipeline.opening import Opened
from assetbuild.pipeline.recipes import model_of
from assetbuild.recipe import yaml_tree as yaml
from assetbuild.recipe.validation import validated


def seconds_of(graph: Graph, session: Session) -> dict[str, float]:
    """Wall clock of each step when it last ran; steps that the store does not know are absent."""
    resolver = Resolver(graph.nodes, session)
    made = {label: resolver.made(label) for label in graph.nodes}
    return {label: each.seconds for label, each in made.items() if each is not None}


def reached_first(name: str, graph: Graph, look: Opened) -> list[str]:
    """The steps that a change reaches directly. UsageError.

    name: of a step, of a file that steps read, or of a key that stands in the recipe.
    """
    if name in graph.nodes:
        return [name]
    readers = _readers_of(name, graph, look.session)
    keys = _children(look.loaded.tree)
    if not readers and name.partition(".")[0] in keys:
        return _reached_by_key(name, graph, look)
    if not readers:
        hint = did_you_mean(name, [*graph.nodes, *keys])
        raise UsageError(f"`{name}` is no step, no file that a step reads, no key", hint=hint)
    return readers


# --- files ----------------------------------------------------------------------------------


def _readers_of(name: str, graph: Graph, session: Session) -> list[str]:
    """The steps that read the file of this name.

    name: a file outside the store as the user sees it, or a member of a folder that steps read,
    by its path in that folder (`meshes/trunk.dae` of an archive).
    """
    sought = {name, str(Path(name).absolute())}
    resolver = Resolver(graph.nodes, session)
    return [
        label
        for label, node in graph.nodes.items()
        if any(sought & set(_files(ref, resolver, session)) for ref in node.inputs.values())
    ]


def _files(ref: Ref, resolver: Resolver, session: Session) -> Iterator[str]:
    """Paths outside the store, and names of members below a folder, as far as they are known."""
    if not ref.node:
        yield ref.output
    elif not ref.is_tree:
        yield ref.member
    elif (digest := resolver.digest(ref)) is not None:
        yield from (ref.member + name for name in session.tree(digest))


# --- keys -----------------------------------------------------------------------------------


def _reached_by_key(key: str, graph: Graph, look: Opened) -> list[str]:
    """The steps that read a value below a key such as `actuators.0.kp`. UsageError.

    Numbers and switches get another value, and each entry is left out once; what the recipe's own
    rules refuse then is passed over.
    """
    before = _steps(graph)
    reached: set[str] | None = None
    for tree in _varied_at(look.loaded.tree, key.split(".")):
        try:
            model, misnamed = model_of(tree)
            recipe = validated(model, tree, RecipeError, misnamed=misnamed)
            changed = replace(look.loaded, recipe=recipe, tree=tree)
            now = _steps(replace(look, loaded=changed).known().graph)
        except AssetBuildError:
            continue
        others = {label for label, step in before.items() if now.get(label) != step}
        reached = others | (reached or set())
    if reached is None:
        raise UsageError(
            f"`{key}` is a key of the recipe of which no value can be changed alone",
            hint="change it in the recipe: `assetbuild build -n` says what would run",
        )
    return sorted(reached)


def _steps(graph: Graph) -> Mapping[str, tuple[Step, Mapping[str, Ref]]]:
    return {label: (node.step, node.inputs) for label, node in graph.nodes.items()}


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
