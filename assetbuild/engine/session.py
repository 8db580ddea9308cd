"""One build's view of the world: the store, the sources as first seen, what is known by key."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from assetbuild.engine.digest import StatCache
from assetbuild.engine.journal import JoinedJournal, Journal
from assetbuild.engine.keys import Parts, key_of, key_parts
from assetbuild.engine.store import Listing, LostObjectError, Store, is_plain_path
from assetbuild.errors import SourceError, StepError, did_you_mean
from assetbuild.findings import Finding, finding_from_json

if TYPE_CHECKING:
    from assetbuild.engine.children import Children
    from assetbuild.engine.graph import Node, Ref
    from assetbuild.engine.share.cluster import Cluster
    from assetbuild.engine.share.remote import Remote


@dataclass(frozen=True)
class Made:
    """What a step with a known key made, when it last ran.

    outputs: name -> digest. seconds: wall clock; cpu_seconds: of its child process, else 0.
    attempts: processes that it took just now; not kept.
    """

    outputs: Mapping[str, str]
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    child: bool = False
    attempts: int = 1

    def to_json(self) -> dict[str, object]:
        """The action entry."""
        return {
            "outputs": dict(self.outputs),
            "findings": [f.to_json() for f in self.findings],
            "seconds": self.seconds,
            "cpu_seconds": self.cpu_seconds,
            "child": self.child,
        }


def made_from_json(raw: Mapping[str, object]) -> Made | None:
    """Inverse of `Made.to_json`; None on foreign data."""
    try:
        outputs, findings = raw["outputs"], raw["findings"]
        if not isinstance(outputs, dict) or not isinstance(findings, list):
            return None
        return Made(
            outputs={str(k): str(v) for k, v in outputs.items()},
            findings=tuple(finding_from_json(f) for f in findings),
            seconds=float(str(raw["seconds"])),
            cpu_seconds=float(str(raw["cpu_seconds"])),
            child=bool(raw["child"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


class Session:
    """Store, stat cache, journal and child processes of one build; a context manager.

    build: names the build in the journal, so that `explain` finds its last run; the path of the
    recipe is a good one. builds: the same for graphs that are `joined`, by their names.
    remote: a cache shared with other machines, asked for what the store lacks.
    sandbox: steps that run may read what they declare, and nothing else.
    cluster: other machines that run the steps which need a process of their own.
    Each source is read once: every step of the build sees the same bytes.
    """

    def __init__(
        self,
        store: Store,
        *,
        build: str = "",
        builds: Mapping[str, str] | None = None,
        rehash: bool = False,
        remote: Remote | None = None,
        sandbox: bool = False,
    ) -> None:
        self.store = store
        self.sandbox = sandbox
        self.cluster: Cluster | None = None
        self.remote = remote
        self.build = build or "\n".join((builds or {}).values())
        self.stat_cache = StatCache(store.root / "stat.json", rehash=rehash)
        self.journal = JoinedJournal(store.root, builds) if builds else Journal(store.root, build)
        self._known: dict[str, Made] = {}
        self._listings: dict[str, Listing] = {}
        self._source_digests: dict[str, str] = {}
        self._source_paths: dict[str, Path] = {}
        self._source_folders: dict[str, Path] = {}
        self._children: Children | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the child processes, save what was learnt, remove private folders."""
        self.cancel()
        self.save()
        self.store.close()

    def save(self) -> None:
        """Write stat cache and journal; a full disk or missing permission costs only speed."""
        for part in (self.stat_cache, self.journal):
            try:
                part.save()
            except OSError:
                continue

    def cancel(self) -> None:
        """Kill all child processes now; a later build of this session starts new ones."""
        with self._lock:
            children, self._children = self._children, None
            cluster, self.cluster = self.cluster, None
        if children is not None:
            children.close()
        if cluster is not None:
            cluster.close()

    @property
    def children(self) -> Children:
        """The child processes of this build, started when first needed."""
        from assetbuild.engine.children import Children

        with self._lock:
            if self._children is None:
                self._children = Children(self.store.scratch())
            return self._children

    # -- sources

    def source_digest(self, path: Path) -> str:
        """Digest of a file outside the store, as first seen by this session. SourceError."""
        name = str(path.absolute())
        if name not in self._source_digests:
            try:
                digest = self.stat_cache.digest(name)
            except OSError as error:
                reason = error.strerror or str(error)
                raise SourceError(f"cannot read `{path}`: {reason}") from None
            self._source_digests[name] = digest
            self._source_paths[digest] = Path(name)
        return self._source_digests[name]

    def source_tree(self, folder: Path, members: Iterable[str]) -> str:
        """Remember files below a folder as one tree; its name, with a slash at the end."""
        listing: Listing = {}
        for member in sorted(members):
            if not is_plain_path(member):
                raise SourceError(f"`{member}` does not lie below `{folder}`")
            path = folder / member
            listing[member] = (self.source_digest(path), path.stat().st_size)
        digest = self.store.put_listing(listing)
        name = f"{folder.absolute()}/"
        if self._source_digests.get(name, digest) != digest:
            name = f"{folder.absolute()}:{digest[:8]}/"
        self._source_digests[name] = digest
        self._source_folders[name] = folder
        return name

    def digest_of_source(self, name: str) -> str:
        """Digest of what `source_digest` or `source_tree` remembered under a name."""
        return self._source_digests.get(name) or self.source_digest(Path(name))

    def check_sources(self, node: Node) -> None:
        """SourceError when a source that the node reads is not what it was when first seen."""
        for ref in node.inputs.values():
            if ref.node:
                continue
            for path, digest in self._files_of(ref):
                try:
                    same = self.stat_cache.digest(path) == digest
                except OSError:
                    same = False
                if not same:
                    raise edited(path)

    def _files_of(self, ref: Ref) -> list[tuple[Path, str]]:
        """The files outside the store that a source stands for, with their digests."""
        folder = self._source_folders.get(ref.output)
        if folder is None:
            return [(Path(ref.output), self._source_digests[ref.output])]
        members = self.tree(self._source_digests[ref.output])
        wanted = ref.member
        return [
            (folder / name, digest)
            for name, (digest, _) in members.items()
            if name == wanted or not wanted or (wanted[-1] == "/" and name.startswith(wanted))
        ]

    # -- objects

    def object(self, digest: str) -> Path:
        """A verified object's file; a source comes into the store when first needed.

        LostObjectError; SourceError when the source was edited meanwhile.
        """
        try:
            return self.store.path(digest)
        except LostObjectError:
            source = self._source_paths.get(digest)
            if source is None:
                raise
        self._take_in(source, digest)
        return self.store.path(digest)

    def read(self, digest: str) -> bytes:
        """The bytes of an object or source; errors as `object`."""
        return self.object(digest).read_bytes()

    def tree(self, digest: str) -> Listing:
        """The listing of a tree, read once per session. LostObjectError."""
        if digest not in self._listings:
            self._listings[digest] = self.store.tree(digest)
        return self._listings[digest]

    def _take_in(self, source: Path, digest: str) -> None:
        changed = not source.is_file() or self.store.put_file(source) != digest
        if changed:
            raise edited(source)

    # -- what is known

    def known(self, key: str) -> Made | None:
        """What a step with this key made, if all of it is still in the store."""
        if key not in self._known:
            made = self._whole(self.store.action(key))
            if made is not None:
                self.store.touch_action(key)
            elif self.remote is not None:
                raw = self.remote.get(key, self.store)
                made = self._whole(raw)
                if made is not None and raw is not None:
                    self.store.put_action(key, raw)
            if made is None:
                return None
            self._known[key] = made
        return self._known[key]

    def fetched(self, key: str) -> Made | None:
        """What a worker on another machine made just now, from the shared cache or this store."""
        made = self._whole(self.store.action(key))
        if made is None and self.remote is not None:
            made = self._whole(self.remote.get(key, self.store, again=True))
        return made

    def _whole(self, raw: dict[str, Any] | None) -> Made | None:  # Any: JSON
        """The result in an action entry, if all its outputs are in the store."""
        made = made_from_json(raw) if raw is not None else None
        return None if made is None or self.missing_output(made) else made

    def learn(self, key: str, made: Made) -> None:
        """Remember what a step made, in the store and here."""
        self.store.put_action(key, made.to_json())
        self._known[key] = made
        if self.remote is not None:
            self.remote.put(key, made.to_json(), self.store)

    def forget(self) -> None:
        """An object was lost: look again which results are whole."""
        self._known.clear()
        self._listings.clear()

    def missing_output(self, made: Made) -> str:
        """The first output that is no longer whole in the store, or nothing."""
        for name, digest in sorted(made.outputs.items()):
            try:
                members = self.tree(digest) if name.endswith("/") else {}
            except LostObjectError:
                return name
            if not all(self.store.has(d) for d in (digest, *(d for d, _ in members.values()))):
                return name
        return ""


def edited(source: Path) -> SourceError:
    """A source changed between its first reading and now."""
    return SourceError(f"`{source}` was edited during the build", hint="run the build again")


class Resolver:
    """Keys and digests of nodes, as far as they are known. The nodes may grow meanwhile."""

    def __init__(self, nodes: Mapping[str, Node], session: Session) -> None:
        self._nodes = nodes
        self._session = session
        self._keys: dict[str, tuple[str, Parts]] = {}

    def key(self, label: str) -> tuple[str, Parts] | None:
        """Key of a node and its parts; None while an input is not known. StepError."""
        if label not in self._keys:
            node = self._nodes[label]
            inputs: dict[str, str] = {}
            for name, ref in node.inputs.items():
                digest = self.digest(ref)
                if digest is None:
                    return None
                inputs[name] = digest
            parts = key_parts(node.step, inputs)
            self._keys[label] = (key_of(parts), parts)
        return self._keys[label]

    def made(self, label: str) -> Made | None:
        """What the node made, if it was built with its present key. StepError."""
        key = self.key(label)
        made = None if key is None else self._session.known(key[0])
        if made is not None and set(made.outputs) != set(self._nodes[label].step.outputs):
            return None  # a foreign action entry
        return made

    def digest(self, ref: Ref) -> str | None:
        """Digest of a reference; None while it is not built. StepError on an unknown member."""
        if not ref.node:
            whole = self._session.digest_of_source(ref.output)
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
            size = len(ref.member)
            below = {n[size:]: v for n, v in listing.items() if n.startswith(ref.member)}
            if below:
                return self._session.store.put_listing(below)
        elif ref.member in listing:
            return listing[ref.member][0]
        origin = f"step `{ref.node}`" if ref.node else "the source"
        raise StepError(
            f"{origin} has no `{ref.member}` in `{ref.output}`",
            hint=did_you_mean(ref.member, listing),
        )
