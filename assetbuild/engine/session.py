"""What one build works with: the store, the world as first seen, what is known of the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from threading import Lock

from assetbuild.engine.actions import Action, Actions, Made, SharedCache, key_parts
from assetbuild.engine.code import Code, notes_folder
from assetbuild.engine.digest import digest_bytes
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.journal import Journal
from assetbuild.engine.stamps import Stamps
from assetbuild.engine.store import Listing, LostObjectError, Store, below, listing_bytes
from assetbuild.engine.world import World, edited
from assetbuild.errors import StepError, did_you_mean


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
        self.code = Code(notes_folder(store.root))
        self.world = (world or World()).whole
        self.world.stamps = Stamps(store.root / "stat.json", fresh=rehash)
        self._listings: dict[str, Listing] = {}
        self._views: dict[str, Path] = {}
        self._viewing = Lock()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
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

    def view(self, digest: str, own: Path | None = None) -> Path:
        """A folder of links to the files of a tree, made once per session. Errors as `object`.

        own: the folder to make instead, which goes with a step.
        """
        if own is not None:
            return self._made_view(digest, own)
        with self._viewing:  # else two steps that begin together would both make it
            if digest not in self._views:
                self._views[digest] = self._made_view(digest)
            return self._views[digest]

    def _made_view(self, digest: str, own: Path | None = None) -> Path:
        folder, listing = own or self.store.scratch(), self.tree(digest)
        folder.mkdir(parents=True, exist_ok=True)
        shared = {} if own else self._shared(listing)
        for name, path in shared.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).symlink_to(path)
        for name, (member, _) in listing.items():
            if not name.startswith(tuple(shared)):
                place = folder / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.symlink_to(self.object(member))
        return folder

    def _shared(self, listing: Listing) -> dict[str, Path]:
        """Folders of a tree (with a slash) that are trees of which there is a view already."""
        folders = {name[: at + 1] for name in listing for at, c in enumerate(name) if c == "/"}
        shared: dict[str, Path] = {}
        for folder in sorted(folders):
            view = self._views.get(digest_bytes(listing_bytes(below(listing, folder))))
            if view is not None and not folder.startswith(tuple(shared)):
                shared[folder] = view
        return shared

    def forget(self) -> None:
        """An object was lost: look again what is whole."""
        self.actions.forget()
        self._listings.clear()
        self._views.clear()


class Resolver:
    """Actions and digests of nodes, as far as they are known. The nodes may grow meanwhile."""

    def __init__(self, nodes: Mapping[str, Node], session: Session) -> None:
        self._nodes = nodes
        self._session = session
        self._actions: dict[str, Action] = {}

    def action(self, label: str) -> Action | None:
        """The node on its inputs; None while one of them is not known. StepError."""
        if label not in self._actions:
            node = self._nodes[label]
            inputs: dict[str, str] = {}
            for name, ref in node.inputs.items():
                digest = self.digest(ref)
                if digest is None:
                    return None
                inputs[name] = digest
            parts = key_parts(node.step, inputs, self._session.code)
            self._actions[label] = Action(label, node.step, parts)
        return self._actions[label]

    def made(self, label: str) -> Made | None:
        """What the node made, if it was built with its present key. StepError."""
        action = self.action(label)
        made = None if action is None else self._session.actions.known(action.key)
        if made is not None and set(made.outputs) != set(self._nodes[label].step.outputs):
            return None  # a foreign action entry
        return made

    def digest(self, ref: Ref) -> str | None:
        """Digest of a reference; None while it is not built. StepError on an unknown member."""
        if not ref.node:
            whole = self._session.world.digest(Path(ref.output))
        else:
            made = self.made(ref.node)
            if made is None:
                return None
            whole = made.outputs[ref.output]
        return self._member(ref, whole) if ref.member else whole

    def _member(self, ref: Ref, whole: str) -> str | None:
        try:
            listing = self._session.tree(whole)
        except LostObjectError:
            self._session.forget()
            return None
        if ref.member.endswith("/"):
            inside = below(listing, ref.member)
            if inside:
                return self._session.store.put_listing(inside)
        elif ref.member in listing:
            return listing[ref.member][0]
        origin = f"step `{ref.node}`" if ref.node else "the source"
        raise StepError(
            f"{origin} has no `{ref.member}` in `{ref.output}`",
            hint=did_you_mean(ref.member, listing),
        )
