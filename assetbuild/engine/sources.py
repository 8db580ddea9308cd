"""Files outside the store, each as it was first seen: every step of a build sees the same bytes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from assetbuild.engine.digest import StatCache
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.step import is_plain_path
from assetbuild.engine.store import Listing
from assetbuild.errors import SourceError


class Sources:
    """The sources of one build, by the names that references give them."""

    def __init__(self, stat_cache: StatCache) -> None:
        self.stat_cache = stat_cache
        self._digests: dict[str, str] = {}
        self._paths: dict[str, Path] = {}
        self._folders: dict[str, tuple[Path, Listing]] = {}

    def digest(self, path: Path) -> str:
        """Digest of a file as first seen. SourceError."""
        name = str(path.absolute())
        if name not in self._digests:
            try:
                digest = self.stat_cache.digest(name)
            except OSError as error:
                reason = error.strerror or str(error)
                raise SourceError(f"cannot read `{path}`: {reason}") from None
            self._digests[name] = digest
            self._paths[digest] = Path(name)
        return self._digests[name]

    def listing(self, folder: Path, members: Iterable[str]) -> Listing:
        """Named files below a folder, as first seen. SourceError."""
        found: Listing = {}
        for member in sorted(members):
            if not is_plain_path(member):
                raise SourceError(f"`{member}` does not lie below `{folder}`")
            path = folder / member
            found[member] = (self.digest(path), path.stat().st_size)
        return found

    def remember(self, folder: Path, listing: Listing, digest: str) -> str:
        """The name of files below a folder that are one tree; it ends in a slash."""
        name = f"{folder.absolute()}/"
        if self._digests.get(name, digest) != digest:
            name = f"{folder.absolute()}:{digest[:8]}/"
        self._digests[name] = digest
        self._folders[name] = (folder, listing)
        return name

    def digest_of(self, name: str) -> str:
        """Digest of the file or tree of this name. SourceError."""
        return self._digests.get(name) or self.digest(Path(name))

    def file_of(self, digest: str) -> Path | None:
        """A file that had these bytes when it was first seen."""
        return self._paths.get(digest)

    def check(self, node: Node) -> None:
        """SourceError when a source that the node reads is not what it was when first seen."""
        for ref in node.inputs.values():
            for path, digest in () if ref.node else self.files_of(ref):
                try:
                    same = self.stat_cache.digest(path) == digest
                except OSError:
                    same = False
                if not same:
                    raise edited(path)

    def files_of(self, ref: Ref) -> list[tuple[Path, str]]:
        """The files that a reference to a source stands for, with their digests."""
        if ref.output not in self._folders:
            return [(Path(ref.output), self._digests[ref.output])]
        folder, listing = self._folders[ref.output]
        wanted = ref.member
        return [
            (folder / name, digest)
            for name, (digest, _) in listing.items()
            if name == wanted or not wanted or (wanted[-1] == "/" and name.startswith(wanted))
        ]


def edited(source: Path) -> SourceError:
    """A source changed between its first reading and now."""
    return SourceError(f"`{source}` was edited during the build", hint="run the build again")
