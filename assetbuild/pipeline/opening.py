"""Opening a recipe: its lock, its session, its graph as far as it is known."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.engine.folders import cache_root
from assetbuild.engine.graph import Graph, Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import open_store
from assetbuild.errors import LockError, OutOfDateError, Where
from assetbuild.lock import GitPin, Lock, Pin, check_pin, lock_path, read_lock, write_lock
from assetbuild.plan import Outline, plan
from assetbuild.plan.source import repository
from assetbuild.recipe.loader import LoadedRecipe, load_recipe, shown_path
from assetbuild.steps.fetch import resolve
from assetbuild.steps.fetch_git import resolve_git

if TYPE_CHECKING:
    from assetbuild.engine.remote import Remote


def opened(recipe: Path, variant: str | None) -> tuple[LoadedRecipe, Lock | None, Session]:
    """A recipe, its lock and a session, for verbs that only look; the caller closes it."""
    loaded = load_recipe(recipe, variant)
    lock = pin(loaded, frozen=True, say=lambda _: None)
    return loaded, lock, open_session(loaded)


def planned(
    loaded: LoadedRecipe, lock: Lock | None, session: Session
) -> tuple[Graph, Outline, bool]:
    """The graph as far as it is known without running anything; True when it is whole."""
    planner = Planner(session)
    outline = plan(loaded, lock, planner)
    return planner.graph(), outline, not planner.questions


def open_session(*loaded: LoadedRecipe, rehash: bool = False) -> Session:
    """The store and what this machine knows of earlier builds of the recipes."""
    names = {
        each.recipe.robot: f"{each.path}#{each.variant}" if each.variant else str(each.path)
        for each in loaded
    }
    store = open_store(Path(cache_root()))
    if len(names) == 1:
        return Session(store, build=next(iter(names.values())), rehash=rehash)
    return Session(store, builds=names, rehash=rehash)


def remote_cache(url: str, say: Callable[[str], None], *, write: bool) -> Remote | None:
    """The cache shared with other machines, if there is one; no recipe can name it. UsageError."""
    if not url:
        return None
    from assetbuild.engine.remote import Remote

    return Remote(url, key=os.environ.get("ASSETBUILD_CACHE_KEY", ""), write=write, warn=say)


def pin(loaded: LoadedRecipe, *, frozen: bool, say: Callable[[str], None]) -> Lock | None:
    """The lock of a moving source; written when it is missing or pins something else.

    The locks of parts are looked after as well. Raises OutOfDateError instead when `frozen`.
    """
    for part in loaded.parts:
        pin(part, frozen=frozen, say=say)
    if loaded.recipe.source.moving is None:
        return None
    path = lock_path(loaded.path)
    lock = read_lock(path)
    try:
        if lock is not None:
            check_pin(loaded.recipe.source, lock, path)
            return lock
        reason = "there is no lock yet"
    except LockError as error:
        reason = error.message
    if frozen:
        raise OutOfDateError(
            reason, where=Where(shown_path(path)), hint=f"run `assetbuild lock {loaded.file}`"
        )
    say(f"{reason}: pinning {loaded.recipe.source.moving}")
    return write_pin(loaded, say)


def write_pin(loaded: LoadedRecipe, say: Callable[[str], None]) -> Lock:
    """Resolve a moving source and write the lock beside the recipe."""
    source = loaded.recipe.source
    pinned: Pin | GitPin
    if source.git is not None:
        pinned = resolve_git(source.git, str(source.rev), repository(loaded))
    else:
        name, _, version = str(source.pypi).partition("==")
        pinned = resolve(name, version, on_line=lambda line: say(line) if "MB)" in line else None)
    lock = Lock(schema="assetbuild-lock/v1", source=pinned)
    path = lock_path(loaded.path)
    if write_lock(path, lock):
        say(f"wrote {shown_path(path)}")
    return lock
