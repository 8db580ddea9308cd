"""What one build works with: the store, the world as first seen, what is known by key."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from assetbuild.engine.actions import Actions, SharedCache
from assetbuild.engine.code import Code
from assetbuild.engine.journal import Journal
from assetbuild.engine.stamps import Stamps
from assetbuild.engine.store import Listing, LostObjectError, Store
from assetbuild.engine.world import World, edited


class Session:
    """Store, world, actions and journal of one build; a context manager.

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
        self.actions = Actions(store, remote)
        self.journal = Journal(store.root, builds or {"": build})
        self.code = Code(store.root / "code")
        self.world = (world or World()).whole
        self.world.stamps = Stamps(store.root / "stat.json", fresh=rehash)
        self._listings: dict[str, Listing] = {}

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.actions.close()
        self.save()
        self.store.close()

    def save(self) -> None:
        """Write what was learnt and the journal; a full disk costs only speed."""
        for part in (self.world.stamps, self.code, self.journal):
            with suppress(OSError):
                part.save()

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

    def forget(self) -> None:
        """An object was lost: look again what is whole."""
        self.actions.forget()
        self._listings.clear()
