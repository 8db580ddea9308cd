"""Opening a recipe: its lock, its session, its graph as far as it is known."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from assetbuild.engine.actions import SharedCache
from assetbuild.engine.execute import Listener
from assetbuild.engine.graph import Ref
from assetbuild.engine.machine import cache_root
from assetbuild.engine.planner import Planner, Settled, nothing, planned, settle
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.store import open_store
from assetbuild.errors import LockError, OutOfDateError, UsageError, Where
from assetbuild.lock import (
    GitPin,
    Lock,
    Pin,
    check_pin,
    lock_path,
    lock_text,
    read_lock,
    write_lock,
)
from assetbuild.plan import Outline, begun, plan
from assetbuild.plugins import foreign_modules
from assetbuild.recipe.loader import LoadedRecipe, shown_path
from assetbuild.recipe.source import Source
from assetbuild.source.plan import resolve

if TYPE_CHECKING:
    from assetbuild.engine.share.remote import Remote

T = TypeVar("T")


@dataclass(frozen=True)
class Opened:
    """A recipe, its lock, the session that it is built in, and where its steps run."""

    loaded: LoadedRecipe
    lock: Lock | None
    session: Session
    runner: Processes | None = None
    jobs: int | None = None
    on_event: Listener | None = None

    def plan(self, p: Planner) -> Outline:
        """The whole build."""
        return plan(self.loaded, self.lock, p)

    def robot(self, p: Planner) -> Outline:
        """The robot without targets and pictures."""
        return plan(self.loaded.but(targets=()), self.lock, p, drawn=False)

    def known(self) -> Settled[Outline]:
        """The build as far as it is known without running anything."""
        return planned(self.plan, self.session)

    def stored(self) -> Settled[Outline]:
        """The build with the results that the store and the shared cache hold; nothing runs."""
        return settle(self.plan, self.session, may_run=nothing)

    def made(self, add: Callable[[Planner], T]) -> Settled[T]:
        """What a plan adds, built. Raises the error of the first step that fails, and where."""
        done = settle(add, self.session, self.runner, jobs=self.jobs, on_event=self.on_event)
        if done.errors:
            from assetbuild.pipeline.judging import failures  # reports cost time to import

            known: Settled[Any] = done  # Any: of any plan
            if not isinstance(known.outline, Outline):
                known = replace(known, outline=begun(self.loaded))
            raise next(failures(self.loaded, known, self.session))
        return done

    def read(self, done: Settled[Any], ref: Ref) -> bytes:  # Any: of any plan
        """The bytes of an output."""
        return self.session.read(done.results[ref.node][ref.output])


@contextmanager
def opened(loaded: LoadedRecipe, remote: SharedCache | None = None) -> Iterator[Opened]:
    """Open a build for verbs that only look."""
    lock = pin(loaded, frozen=True, say=lambda _: None)
    with open_session(loaded, remote=remote) as session:
        yield Opened(loaded, lock, session)


def open_session(
    *loaded: LoadedRecipe, rehash: bool = False, remote: SharedCache | None = None
) -> Session:
    """The store and what this machine knows of earlier builds of the recipes."""
    names = {
        each.recipe.robot: f"{each.path}#{each.variant}" if each.variant else str(each.path)
        for each in loaded
    }
    builds = names if len(names) > 1 else {"": "".join(names.values())}
    loaded[0].world.whole.installed(foreign_modules())
    return Session(
        open_store(Path(cache_root())),
        builds=builds,
        rehash=rehash,
        remote=remote,
        world=loaded[0].world,
    )


def remote_cache(url: str, say: Callable[[str], None], *, write: bool) -> Remote | None:
    """The cache shared with other machines, if there is one; no recipe can name it. UsageError."""
    if not url:
        if write:
            raise UsageError("no shared cache to write to: give `--remote` or ASSETBUILD_REMOTE")
        return None
    from assetbuild.engine.share.remote import Remote

    return Remote(url, key=os.environ.get("ASSETBUILD_CACHE_KEY", ""), write=write, warn=say)


def pin(loaded: LoadedRecipe, *, frozen: bool, say: Callable[[str], None]) -> Lock | None:
    """The lock of moving sources; written when it is missing or pins something else.

    Parts with recipes of their own have locks of their own, which are looked after as well; a
    part that is a mere source is pinned in this one. Raises OutOfDateError instead when `frozen`.
    """
    for part in loaded.parts:
        if not part.inline:
            pin(part, frozen=frozen, say=say)
    path, moving = lock_path(loaded.path), moving_sources(loaded)
    if not moving:
        return None
    lock = read_lock(path, loaded.world)
    try:
        if lock is not None:
            for _, source in moving:
                check_pin(source, lock, path)
            return lock
        reason = "there is no lock yet"
    except LockError as error:
        reason = error.message
    if frozen:
        raise OutOfDateError(
            reason, where=Where(shown_path(path)), hint=f"run `assetbuild lock {loaded.file}`"
        )
    say(f"{reason}: pinning {', '.join(str(source.moving) for _, source in moving)}")
    return write_pin(loaded, say, known=lock)


def moving_sources(*recipes: LoadedRecipe) -> list[tuple[LoadedRecipe, Source]]:
    """What the lock beside a recipe must pin, and who names it; each source once.

    recipes: one, or it and its variants.
    """
    sources: dict[str, tuple[LoadedRecipe, Source]] = {}
    for loaded in recipes:
        for each in (loaded, *(part for part in loaded.parts if part.inline)):
            if (moving := each.recipe.source.moving) is not None:
                sources.setdefault(moving, (each, each.recipe.source))
    return list(sources.values())


def write_pin(
    loaded: LoadedRecipe,
    say: Callable[[str], None],
    variants: Sequence[LoadedRecipe] = (),
    known: Lock | None = None,
) -> Lock:
    """Resolve moving sources and write the lock beside the recipe.

    variants: of the recipe, whose parts are pinned too. known: a lock whose pins stay where they
    agree, and those of parts that other variants have; None = all are resolved anew.
    """
    robot_pin: Pin | GitPin | None = None
    parts: list[Pin | GitPin] = []
    for each, source in moving_sources(loaded, *variants):
        pinned = known.pin_of(source) if known else None
        pinned = pinned or resolve(
            source, each.folder, each.world, lambda line: say(line) if "MB)" in line else None
        )
        if each is loaded:
            robot_pin = pinned
        else:
            parts.append(pinned)
    parts += [pinned for pinned in (known.parts if known else ()) if pinned not in parts]
    lock = Lock(schema="assetbuild-lock/v1", source=robot_pin, parts=tuple(parts))
    path = lock_path(loaded.path)
    if write_lock(path, lock):
        loaded.world.wrote(path, lock_text(lock).encode())
        say(f"wrote {shown_path(path)}")
    return lock
