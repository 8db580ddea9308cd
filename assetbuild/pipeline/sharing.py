"""push() and pull(): what the store knows of a recipe, to and from the cache of other machines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.session import Resolver
from assetbuild.engine.share.remote import Remote
from assetbuild.pipeline.opening import opened, planned


@dataclass(frozen=True)
class Shared:
    """steps: in the graph, as far as it is known; done: of these, sent or now in the store.

    whole: the graph has no open question.
    """

    steps: int
    done: int
    whole: bool


def push(recipe: Path, variant: str | None, remote: Remote) -> Shared:
    """Offer every result that the store has; nothing is built."""
    loaded, lock, session = opened(recipe, variant)
    with session:
        graph, _, whole = planned(loaded, lock, session)
        resolver = Resolver(graph.nodes, session)
        sent = 0
        for label in graph.nodes:
            key, made = resolver.key(label), resolver.made(label)
            if key is not None and made is not None:
                sent += remote.put(key[0], made.to_json(), session.store)
    return Shared(len(graph.nodes), sent, whole)


def pull(recipe: Path, variant: str | None, remote: Remote) -> Shared:
    """Fetch every result that the store lacks and the cache has; nothing is built."""
    loaded, lock, session = opened(recipe, variant)
    with session:
        session.remote = remote
        known = -1
        while True:
            graph, _, whole = planned(loaded, lock, session)
            resolver = Resolver(graph.nodes, session)
            here = sum(resolver.made(label) is not None for label in graph.nodes)
            if whole or here == known:
                return Shared(len(graph.nodes), here, whole)
            known = here
