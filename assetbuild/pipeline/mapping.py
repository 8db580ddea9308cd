"""What a plan tells of its steps: which ones a change reaches, and what a build waits for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from assetbuild.engine.graph import Graph, Ref
from assetbuild.engine.resolver import Resolver
from assetbuild.engine.session import Session
from assetbuild.errors import UsageError, did_you_mean
from assetbuild.pipeline.opening import Look
from assetbuild.pipeline.varying import reached_by_key


def seconds_of(look: Look) -> dict[str, float]:
    """Wall clock of each step when it last ran; steps that the store does not know are absent."""
    resolver = Resolver(look.done.graph.nodes, look.session)
    made = {label: resolver.made(label) for label in look.done.graph.nodes}
    return {label: each.seconds for label, each in made.items() if each is not None}


def reached_first(name: str, look: Look) -> list[str]:
    """The steps that a change reaches directly. UsageError.

    name: of a step, of a file that steps read, or of a key that stands in the recipe.
    """
    found = _of_step_or_file(name, look.done.graph, look.session)
    written = look.loaded.tree.value
    keys = list(written) if isinstance(written, dict) else []
    if not found and name.partition(".")[0] in keys:
        return reached_by_key(name, look)
    if not found:
        hint = did_you_mean(name, [*look.done.graph.nodes, *keys])
        raise UsageError(f"`{name}` is no step, no file that a step reads, no key", hint=hint)
    return found


def _of_step_or_file(name: str, graph: Graph, session: Session) -> list[str]:
    """The step of this name, or the steps that read the file of this name; else none.

    name: a file outside the store as the user sees it, or a member of a folder that steps read,
    by its path in that folder (`meshes/trunk.dae` of an archive).
    """
    if name in graph.nodes:
        return [name]
    path = Path(name).absolute()
    resolver = Resolver(graph.nodes, session)
    found = []
    for label, node in graph.nodes.items():
        read = {each for ref in node.inputs.values() for each in _files(ref, resolver, session)}
        if path in read or name in read:
            found.append(label)
    return found


def _files(ref: Ref, resolver: Resolver, session: Session) -> Iterator[Any]:
    """Paths outside the store, and names of members below a folder, as far as they are known."""
    if not ref.node:
        yield Path(ref.output)
    elif not ref.is_tree:
        yield ref.member
    elif (digest := resolver.digest(ref)) is not None:
        yield from (ref.member + name for name in session.tree(digest))
