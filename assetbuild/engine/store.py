"""The content-addressed store: objects by the SHA-256 of their bytes, actions by their key.

    <root>/v1/cas/ab/<digest>      an object, read only, never linked into a user's folder
    <root>/v1/ac/ab/<key>.json     what a step with this key made
    <root>/v1/quarantine/          objects whose bytes did not match their name
    <root>/v1/tmp/                 private folders of running builds
    <root>/v1/turns/               who runs which action now

Everything is written beside and renamed, so any number of builds may share a store and a kill
at any moment leaves it valid. There is no fsync: what a power cut tears is found on reading,
because every object is verified, and is made again.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from assetbuild.engine.claims import claim_new_folder, release, remove_abandoned
from assetbuild.engine.digest import (
    CHUNK,
    FINE_RACY_NS,
    RACY_NS,
    Signature,
    canonical_json,
    digest_bytes,
    digest_file,
    is_racy,
    replace_file,
    signature_of,
)
from assetbuild.engine.step import is_plain_path
from assetbuild.errors import MachineError

LAYOUT = "v1"
STORE_OPTION, OUT_OPTION = "ASSETBUILD_CACHE", "`-o`"
"""How a user chooses another folder for the store, and for what a command writes."""
BEGAN = "began"
"""Files in the private folder of a process: their stamps say when what it builds now began."""
ACTION_FORMAT = 1
Listing = dict[str, tuple[str, int]]
"""A tree: relative path -> (digest, size in bytes)."""


class LostObjectError(MachineError):
    """An object that should be in the store is missing or was corrupt; making it again heals."""

    def __init__(self, digest: str, what: str) -> None:
        super().__init__(
            f"the store lost object {digest[:12]}: {what}", hint="run the build again: it heals"
        )
        self.digest = digest


class Store:
    """Objects and actions below `root`. Threads and processes may share it.

    notice: why this store stands in for the one that was meant; it then goes when it is closed.
    """

    def __init__(self, root: Path, *, notice: str = "") -> None:
        self.notice = notice
        self.root = Path(os.path.abspath(root)) / LAYOUT  # noqa: PTH100 - keeps symlinks
        self._verified: dict[str, Signature] = {}
        with machine_errors(self.root.parent):
            for name in ("cas", "ac", "quarantine", "tmp", "turns", "journal", "logs"):
                (self.root / name).mkdir(parents=True, exist_ok=True)
            self._tmp = claim_new_folder(self.root / "tmp")
            self._began = self._tmp / BEGAN
            self._began.touch()

    def close(self) -> None:
        """Remove this process's private folder, and those of builds that were killed."""
        release(self._tmp)
        remove_abandoned((self.root / "tmp").iterdir())
        if self.notice:
            shutil.rmtree(self.root.parent, ignore_errors=True)

    def scratch(self) -> Path:
        """A new empty folder on the file system of the store, private to this process."""
        folder = self._tmp / secrets.token_hex(6)
        with machine_errors(self.root.parent):
            folder.mkdir()
        return folder

    @contextmanager
    def busy(self) -> Iterator[None]:
        """One of many builds of a process that lives long, and spares nothing between them."""
        self._began.unlink(missing_ok=True)
        mark = self._tmp / f"{BEGAN}-{secrets.token_hex(6)}"
        with machine_errors(self.root.parent):
            mark.touch()
        try:
            yield
        finally:
            mark.unlink(missing_ok=True)

    # -- objects in

    def put_bytes(self, data: bytes) -> str:
        """Store bytes; their digest."""
        digest = digest_bytes(data)
        beside = self._tmp / secrets.token_hex(8)
        with machine_errors(self.root.parent):
            beside.write_bytes(data)
            self._accept(beside, digest)
        return digest

    def put_file(self, path: Path, *, move: bool = False) -> str:
        """Store a file's content; its digest.

        move: the file is ours, on the file system of the store, and finished: it is renamed.
        """
        with machine_errors(self.root.parent):
            if move and path.stat().st_nlink == 1:
                digest = digest_file(path)
                self._accept(path, digest)
                return digest
            beside = self._tmp / secrets.token_hex(8)
            with path.open("rb", buffering=0) as file:
                digest = _copy(file, beside)
            self._accept(beside, digest)
        return digest

    def put_tree(self, folder: Path, linked: Mapping[str, tuple[str, int]] | None = None) -> str:
        """Move every file below a folder into the store, as `put_file`; the listing's digest.

        linked: what is in the tree besides, and in the store already.
        Symbolic links and special files raise ValueError: they have no content of their own.
        """
        listing: Listing = dict(linked or {})
        for path in files_below(folder):
            size = path.stat().st_size
            name = path.relative_to(folder).as_posix()
            listing[name] = (self.put_file(path, move=True), size)
        return self.put_listing(listing)

    def put_listing(self, listing: Mapping[str, tuple[str, int]]) -> str:
        """Store a tree whose objects are stored already; its digest."""
        return self.put_bytes(listing_bytes(listing))

    def _accept(self, beside: Path, digest: str) -> None:
        """Rename a finished file to its digest. An older object of that name is replaced: it
        may be corrupt, and readers keep the file that they opened."""
        beside.chmod(0o444)
        target = self._object(digest)
        target.parent.mkdir(exist_ok=True)
        beside.replace(target)

    # -- objects out

    def has(self, digest: str) -> bool:
        """Is there an object of this name? Its bytes are verified when they are used."""
        return self._object(digest).is_file()

    def path(self, digest: str) -> Path:
        """The object's file, verified, read only. LostObjectError when missing or corrupt.

        Hashed once per process, as long as its signature stays the same.
        """
        path = self._object(digest)
        try:
            signature = signature_of(path.stat())
            if self._verified.get(digest) == signature:
                return path
            file_digest = digest_file(path)
        except FileNotFoundError:
            raise LostObjectError(digest, "it is not there") from None
        except OSError as error:
            raise LostObjectError(digest, error.strerror or str(error)) from error
        if file_digest != digest:
            self._quarantine(digest)
        window_ns = FINE_RACY_NS if signature[1] % 1_000_000 else RACY_NS
        if not is_racy(signature, window_ns=window_ns):
            self._verified[digest] = signature
        return path

    def tree(self, digest: str) -> Listing:
        """The listing of a stored tree, verified; its objects are not. LostObjectError."""
        path = self.path(digest)
        try:
            raw = json.loads(path.read_bytes())
            listing = {str(name): (str(d), int(size)) for name, (d, size) in raw.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            raise LostObjectError(digest, "it is not a tree") from None
        for name, (member, _) in listing.items():
            if not is_plain_path(name) or not _is_digest(member):
                raise LostObjectError(digest, f"it lists `{name}`, which no tree may hold")
        return listing

    def sizes(self, outputs: Mapping[str, str]) -> dict[str, int]:
        """Size in bytes of each object that outputs (name -> digest) are made of, by its digest.

        Those of folders come with all their members. LostObjectError when one of the outputs
        itself is missing; members may be.
        """
        sizes: dict[str, int] = {}
        for name, digest in outputs.items():
            try:
                sizes[digest] = self._object(digest).stat().st_size
            except OSError as error:
                raise LostObjectError(digest, error.strerror or str(error)) from None
            if name.endswith("/"):
                sizes |= dict(self.tree(digest).values())
        return sizes

    def restore(self, digest: str, dest: Path, out: Path | None = None) -> None:
        """Copy an object to `dest`, verified on the way; `dest` is replaced at once.

        Never a hard link: an edit in place would poison the store. out: the folder that an error
        names, of a `dest` that the user knows by another name; default: where `dest` lies.
        """
        beside = dest.with_name(f".{dest.name[:200]}.{secrets.token_hex(4)}.tmp")
        place, option = out or dest.parent, OUT_OPTION
        if dest.is_relative_to(self.root.parent):
            place, option = self.root.parent, STORE_OPTION
        try:
            with machine_errors(place, option):
                dest.parent.mkdir(parents=True, exist_ok=True)
                try:
                    with self._object(digest).open("rb", buffering=0) as source:
                        file_digest = _copy(source, beside)
                except OSError as error:
                    if error.errno not in (errno.ENOENT, errno.ESTALE):
                        raise
                    raise LostObjectError(digest, "it is not there") from None
                if file_digest != digest:
                    self._quarantine(digest)
                beside.replace(dest)
        finally:
            beside.unlink(missing_ok=True)

    def restore_tree(self, digest: str, dest: Path) -> None:
        """Copy the files of a tree below the folder `dest`, each as `restore` does."""
        for name, (member, _) in sorted(self.tree(digest).items()):
            self.restore(member, dest / name)

    def _quarantine(self, digest: str) -> None:
        """Set a corrupt object aside and say that it is lost."""
        self._verified.pop(digest, None)
        aside = self.root / "quarantine" / f"{digest}-{secrets.token_hex(4)}"
        with suppress(OSError):
            self._object(digest).replace(aside)
        raise LostObjectError(digest, "its bytes were not those of its name")

    def _object(self, digest: str) -> Path:
        if not _is_digest(digest):
            raise LostObjectError(digest, "that is not a digest")
        return Path(f"{self.root}/cas/{digest[:2]}/{digest}")

    # -- actions

    def action(self, key: str) -> dict[str, Any] | None:  # Any: JSON
        """What a step with this key made, as `put_action` was given it; None when unknown.

        An unreadable, torn or foreign entry is unknown.
        """
        try:
            entry = json.loads((self.root / "ac" / key[:2] / f"{key}.json").read_bytes())
            result = entry["result"]
            sound = (
                entry["format"] == ACTION_FORMAT
                and entry["key"] == key
                and entry["check"] == digest_bytes(canonical_json(result))
            )
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None
        return result if sound and isinstance(result, dict) else None

    def touch_action(self, key: str) -> None:
        """The action was used: `cache gc` removes those first that were not used for long."""
        with suppress(OSError):
            os.utime(self.root / "ac" / key[:2] / f"{key}.json")

    def put_action(self, key: str, result: Mapping[str, object]) -> None:
        """Remember what a step with this key made: plain JSON data, outputs by digest."""
        entry = {
            "format": ACTION_FORMAT,
            "key": key,
            "result": dict(result),
            "check": digest_bytes(canonical_json(dict(result))),
        }
        with machine_errors(self.root.parent):
            replace_file(self.root / "ac" / key[:2] / f"{key}.json", canonical_json(entry))


def open_store(root: Path) -> Store:
    """The store below `root`; a temporary one with a notice where that cannot be written to.

    MachineError when the disk is full, or there is no place for a temporary one either.
    """
    try:
        return Store(root)
    except MachineError as error:
        cause = error.__cause__
        if not isinstance(cause, OSError) or cause.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        why = f"cannot write to the store {root} ({cause.strerror or cause})"
        with machine_errors(Path(tempfile.gettempdir())):
            place = Path(tempfile.mkdtemp(prefix="assetbuild-store-"))
        return Store(place, notice=f"{why}: nothing is taken from it or kept")


@contextmanager
def machine_errors(place: Path, option: str = STORE_OPTION) -> Iterator[None]:
    """Failed writes below `place` as MachineError; `option` chooses another place."""
    try:
        yield
    except OSError as error:
        file, hint = error.filename or place, f"choose another folder with {option}"
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            hint = f"free some space, or {hint}; nothing is lost"
            message = f"no space left on the disk that holds {place}"
        elif error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            message = f"no permission for `{file}`"
        else:
            message, hint = f"{error.strerror or error}: `{file}`", ""
        raise MachineError(message, hint=hint) from error


def listing_bytes(listing: Mapping[str, tuple[str, int]]) -> bytes:
    """A tree as it is stored; their digest is the tree's."""
    return canonical_json({name: list(held) for name, held in listing.items()})


def below(listing: Listing, folder: str) -> Listing:
    """The part of a tree below a folder, which ends in a slash."""
    return {n.removeprefix(folder): held for n, held in listing.items() if n.startswith(folder)}


def files_below(folder: Path) -> list[Path]:
    """Every regular file below a folder, sorted; ValueError names anything else found there."""
    files: list[Path] = []
    for path in folder.rglob("*"):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise ValueError(f"`{path.relative_to(folder)}` is not a regular file")
        if path.is_file():
            files.append(path)
    return sorted(files)


def _is_digest(text: str) -> bool:
    return len(text) == 64 and not set(text) - set("0123456789abcdef")


def _copy(source: Any, dest: Path) -> str:  # Any: an unbuffered binary file
    """Copy a file's content and hash it in the same pass."""
    state = hashlib.sha256()
    with dest.open("wb") as out:
        while chunk := source.read(CHUNK):
            state.update(chunk)
            out.write(chunk)
    return state.hexdigest()
