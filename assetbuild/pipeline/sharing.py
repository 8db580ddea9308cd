"""push() and pull(): what the store knows of a recipe, to and from the cache of other machines."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.planner import nothing, settle
from assetbuild.engine.resolver import Resolver
from assetbuild.engine.share.remote import Remote
from assetbuild.pipeline.opening import looked_at, opened
from assetbuild.plan import plan


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
    with looked_at(recipe, variant) as look:
        done, session = look.done, look.session
        resolver = Resolver(done.graph.nodes, session)
        sent = 0
        for label in done.graph.nodes:
            action, made = resolver.action(label), resolver.made(label)
            if action is not None and made is not None:
                sent += remote.put(action.key, made, session.store)
    return Shared(len(done.graph.nodes), sent, done.whole)


def pull(recipe: Path, variant: str | None, remote: Remote) -> Shared:
    """Fetch every result that the store lacks and the cache has; nothing is built."""
    loaded, lock, session = opened(recipe, variant, remote)
    with session:
        done = settle(functools.partial(plan, loaded, lock), session, may_run=nothing)
    return Shared(len(done.graph.nodes), len(done.results), done.whole)
