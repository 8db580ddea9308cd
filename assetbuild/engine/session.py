"""What one build works with: the store, the world as first seen, what is known by key."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from assetbuild.engine.digest import StatCache, digest_bytes
from assetbuild.engine.journal import Journal
from assetbuild.engine.made import Made, made_from_json, missing_output
from assetbuild.engine.store import Listing, LostObjectError, Store
from assetbuild.engine.world import World, edited


class SharedCache(Protocol):
    """A cache shared with other machines; whatever goes wrong there is a miss."""

    def get(self, key: str, store: Store, *, again: bool = False) -> Made | None:
        """What a step with this key made elsewhere, all its objects now in the store."""
        ...

    def put(self, key: str, made: Made, store: Store) -> bool:
        """Offer what a step with this key made. Is it there?"""
        ...


class Session:
    """Store, world and journal of one build, and what is known by key; a context manager.

    build: names the build in the journal, so that `explain` finds its last run; the path of the
    recipe is a good one. builds: the same for graphs that are `joined`, by their names.
    remote: asked for what the store lacks. world: what was asked before the store was opened.
    """

    def __init__(
        self,
        store: Store,
        *,
        build: str = "",
        builds: Mapping[str, str] | None = None,
        rehash: bool = False,
        remote: SharedCache | None = None,
        world: World | None = None,
    ) -> None:
        self.store = store
        self.remote = remote
        self.journal = Journal(store.root, builds or {"": build})
        self.world = (world or World()).whole
        self.world.stat_cache = StatCache(store.root / "stat.json", rehash=rehash)
        self._logs = store.root / "logs" / digest_bytes(os.fsencode(self.journal.name))[:12]
        self._known: dict[str, Made] = {}
        self._listings: dict[str, Listing] = {}

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Save what was learnt, remove private folders."""
        self.save()
        self.store.close()

    def save(self) -> None:
        """Write stat cache and journal; a full disk or missing permission costs only speed."""
        for part in (self.world.stat_cache, self.journal):
            with suppress(OSError):
                part.save()

    def log_path(self, label: str) -> Path:
        """Where the log of a node of this build lies, if its last run left one."""
        name = re.sub(r"[^\w.-]+", "_", label, flags=re.ASCII)[:80]
        return self._logs / f"{name}-{digest_bytes(label.encode())[:6]}.log"

    # -- objects

    def object(self, digest: str) -> Path:
        """A verified object's file; a source comes into the store when first needed.

        LostObjectError; SourceError when the source was edited meanwhile.
        """
        try:
            return self.store.path(digest)
        except LostObjectError:
            source = self.world.file_of(digest)
            if source is None:
                raise
        if not source.is_file() or self.store.put_file(source) != digest:
            raise edited(source)
        return self.store.path(digest)

    def read(self, digest: str) -> bytes:
        """The bytes of an object or source; errors as `object`."""
        return self.object(digest).read_bytes()

    def tree(self, digest: str) -> Listing:
        """The listing of a tree, read once per session. LostObjectError."""
        if digest not in self._listings:
            self._listings[digest] = self.store.tree(digest)
        return self._listings[digest]

    # -- what is known

    def known(self, key: str) -> Made | None:
        """What a step with this key made, if all of it is still in the store."""
        if key not in self._known:
            made = self._stored(key)
            if made is not None:
                self.store.touch_action(key)
            elif (made := self._shared(key)) is not None:
                self.store.put_action(key, made.to_json())
            else:
                return None
            self._known[key] = made
        return self._known[key]

    def fetched(self, key: str) -> Made | None:
        """What a worker on another machine made just now, from the shared cache or this store."""
        return self._stored(key) or self._shared(key, again=True)

    def _stored(self, key: str) -> Made | None:
        return self._whole(made_from_json(self.store.action(key)))

    def _shared(self, key: str, *, again: bool = False) -> Made | None:
        return self._whole(self.remote.get(key, self.store, again=again) if self.remote else None)

    def _whole(self, made: Made | None) -> Made | None:
        """The same, if all its outputs are in the store."""
        return None if made is None or missing_output(self.store, made) else made

    def learn(self, key: str, made: Made) -> None:
        """Remember what a step made, in the store and here."""
        self.store.put_action(key, made.to_json())
        self._known[key] = made
        if self.remote is not None:
            self.remote.put(key, made, self.store)

    def forget(self) -> None:
        """An object was lost: look again which results are whole."""
        self._known.clear()
        self._listings.clear()
