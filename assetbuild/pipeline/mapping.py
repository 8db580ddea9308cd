"""What a plan tells of its steps: which ones a change reaches, and what a build waits for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from assetbuild.engine.graph import Ref
from assetbuild.engine.resolver import Resolver
from assetbuild.engine.rounds import Settled
from assetbuild.engine.session import Session
from assetbuild.errors import UsageError, did_you_mean
from assetbuild.plan import Outline


def seconds_of(done: Settled[Outline], session: Session) -> dict[str, float]:
    """Wall clock of each step when it last ran; steps that the store does not know are absent."""
    resolver = Resolver(done.graph.nodes, session)
    made = {label: resolver.made(label) for label in done.graph.nodes}
    return {label: each.seconds for label, each in made.items() if each is not None}


def reached_first(name: str, done: Settled[Outline], session: Session) -> list[str]:
    """The step of this name, or the steps that read the file of this name. UsageError.

    name: a file outside the store as the user sees it, or a member of a folder that steps read,
    by its path in that folder (`meshes/trunk.dae` of an archive).
    """
    if name in done.graph.nodes:
        return [name]
    path = Path(name).absolute()
    resolver = Resolver(done.graph.nodes, session)
    files: set[str] = set()
    found = []
    for label, node in done.graph.nodes.items():
        read = {each for ref in node.inputs.values() for each in _files(ref, resolver, session)}
        files |= {str(each) for each in read}
        if path in read or name in read:
            found.append(label)
    if not found:
        known = [*done.graph.nodes, *files]
        hint = did_you_mean(name, known) if known else ""
        raise UsageError(f"`{name}` is no step, and no file that a step reads", hint=hint)
    return found


def _files(ref: Ref, resolver: Resolver, session: Session) -> Iterator[Any]:
    """Paths outside the store, and names of members below a folder, as far as they are known."""
    if not ref.node:
        yield from (path for path, _ in session.sources.files_of(ref))
    elif not ref.is_tree:
        yield ref.member
    elif (digest := resolver.digest(ref)) is not None:
        yield from (ref.member + name for name in session.tree(digest))
