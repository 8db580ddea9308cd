"""push() and pull(): what the store knows of a recipe, to and from the cache of other machines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.resolver import Resolver
from assetbuild.engine.share.remote import Remote
from assetbuild.pipeline.opening import opened
from assetbuild.pipeline.recipes import load_recipe


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
    with opened(load_recipe(recipe, variant)) as look:
        known = look.known()
        resolver = Resolver(known.graph.nodes, look.session)
        sent = 0
        for label in known.graph.nodes:
            action, made = resolver.action(label), resolver.made(label)
            if action is not None and made is not None:
                sent += remote.put(action.key, made, look.session.store)
    return Shared(len(known.graph.nodes), sent, known.whole)


def pull(recipe: Path, variant: str | None, remote: Remote) -> Shared:
    """Fetch every result that the store lacks and the cache has; nothing is built."""
    with opened(load_recipe(recipe, variant), remote) as look:
        stored = look.stored()
    return Shared(len(stored.graph.nodes), len(stored.results), stored.whole)
