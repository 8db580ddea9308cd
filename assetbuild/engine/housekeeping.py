"""What lies in a store: counted, verified, and held below a size by removing what was used least.

Last use is the time of an entry's last change (ctime): a build touches the entry of each action
that it takes from the store. `atime` says nothing on most machines.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.actions import made_from_json, missing_output
from assetbuild.engine.claims import is_claimed, remove_abandoned
from assetbuild.engine.store import BEGAN, LAYOUT, LostObjectError, Store

NOTES = ("logs", "journal", "null", "code")
"""Folders of small files that only spare work or explain; a tenth of the limit is theirs."""
CLOCK_TICK_S = 0.05
"""Stamps of files may lie this much behind the clock."""


@dataclass(frozen=True)
class Stats:
    """What a store holds. Sizes in bytes; times in seconds since 1970, 0 = never."""

    objects: int = 0
    object_bytes: int = 0
    actions: int = 0
    quarantined: int = 0
    total_bytes: int = 0
    oldest_use: float = 0.0
    live_builds: int = 0


@dataclass(frozen=True)
class Checked:
    """Result of verifying a store. corrupt: digests set aside; torn: unreadable action entries;
    incomplete: actions whose outputs are gone. Torn and incomplete entries were removed."""

    objects: int
    corrupt: tuple[str, ...] = ()
    torn: int = 0
    incomplete: int = 0


@dataclass(frozen=True)
class Collected:
    """Result of `collect`: sizes of the store in bytes, and how many entries went."""

    before: int
    after: int
    actions: int
    objects: int


def stats(root: Path) -> Stats:
    """Count what the store below `root` holds; an absent store holds nothing."""
    home = root / LAYOUT
    objects = [entry.stat() for entry in _files(home / "cas")]
    actions = [entry.stat() for entry in _files(home / "ac")]
    uses = [status.st_ctime for status in [*actions, *objects]]
    return Stats(
        objects=len(objects),
        object_bytes=sum(status.st_size for status in objects),
        actions=len(actions),
        quarantined=sum(1 for _ in _files(home / "quarantine")),
        total_bytes=total_bytes(home),
        oldest_use=min(uses, default=0.0),
        live_builds=len(_live(home)),
    )


def total_bytes(home: Path) -> int:
    """Size of everything but the private folders of running builds."""
    private = f"{home / 'tmp'}{os.sep}"
    return sum(e.stat().st_size for e in _files(home) if not e.path.startswith(private))


def check(store: Store) -> Checked:
    """Verify every object and action; what is wrong is set aside and made again when needed."""
    corrupt = []
    count = 0
    for entry in _files(store.root / "cas"):
        count += 1
        try:
            store.path(entry.name)
        except LostObjectError:
            corrupt.append(entry.name)
            with suppress(OSError):  # not even a digest by its name
                Path(entry.path).replace(store.root / "quarantine" / entry.name)
    torn = incomplete = 0
    for entry in _files(store.root / "ac"):
        made = made_from_json(store.action(entry.name.removesuffix(".json")))
        if made is None:
            torn += 1
        elif missing_output(store, made):
            incomplete += 1
        else:
            continue
        Path(entry.path).unlink(missing_ok=True)
    return Checked(count, tuple(sorted(corrupt)), torn, incomplete)


def collect(store: Store, max_bytes: int) -> Collected:
    """Remove what was used least lately until the store holds at most `max_bytes`.

    What was used since the oldest running build began stays, whatever the limit; what such a
    build read earlier and loses, it makes again.
    """
    for name in ("tmp", "turns"):
        remove_abandoned((store.root / name).glob("*"))
    before = total_bytes(store.root)
    _trim(store.root, ("quarantine",), 0)
    _trim(store.root, NOTES, max_bytes // 10)
    protected_from = min(_live(store.root)) - CLOCK_TICK_S  # our own mark is among them
    results = sum(e.stat().st_size for name in ("ac", "cas") for e in _files(store.root / name))
    others = total_bytes(store.root) - results
    kept, dropped = _choice(store, max_bytes - others, protected_from)
    for path in dropped:
        path.unlink(missing_ok=True)
    removed = 0
    for entry in _files(store.root / "cas"):
        # An object may have come, or come again, since we chose.
        if entry.name not in kept and entry.stat().st_ctime < protected_from:
            Path(entry.path).unlink(missing_ok=True)
            removed += 1
    after = total_bytes(store.root)
    return Collected(before, after, len(dropped), removed)


def _choice(store: Store, max_bytes: int, protected_from: float) -> tuple[set[str], list[Path]]:
    """Objects that stay, and action entries that go.

    Actions stay with all that they made, those used last first; then sources.
    """
    statuses = {entry.name: entry.stat() for entry in _files(store.root / "cas")}
    kept: set[str] = set()
    made: set[str] = set()
    dropped: list[Path] = []
    left = max_bytes

    def keep(objects: set[str], size: int, used: float) -> bool:
        nonlocal left
        cost = size + sum(statuses[name].st_size for name in objects - kept if name in statuses)
        if used < protected_from and cost > left:
            return False
        left -= cost
        kept.update(objects)
        return True

    actions = [(e.stat().st_ctime, e.stat().st_size, e.path) for e in _files(store.root / "ac")]
    for used, size, path in sorted(actions, reverse=True):
        objects = _objects_of(store, Path(path).stem)
        made |= objects or set()
        if objects is None and used >= protected_from:
            continue  # a build that runs now is writing it
        if objects is None or not keep(objects, size, used):
            dropped.append(Path(path))
    for name in sorted(statuses.keys() - made, key=lambda n: (-statuses[n].st_ctime, n)):
        keep({name}, 0, statuses[name].st_ctime)
    return kept, dropped


def _objects_of(store: Store, key: str) -> set[str] | None:
    """Everything that an action made, folders with their members; None when it lost something."""
    made = made_from_json(store.action(key))
    try:
        return None if made is None else set(store.sizes(made.outputs))
    except LostObjectError:
        return None


def _trim(home: Path, names: tuple[str, ...], allowed: int) -> None:
    """Remove the oldest files below these folders until they hold at most `allowed` bytes."""
    files = [(e.stat().st_ctime, e.stat().st_size, e.path) for n in names for e in _files(home / n)]
    size = sum(part[1] for part in files)
    for _, part, path in sorted(files):
        if size <= allowed:
            return
        Path(path).unlink(missing_ok=True)
        size -= part


def _live(home: Path) -> list[float]:
    """When the builds that run now began."""
    start_times = []
    for folder in (home / "tmp").glob("*"):
        with suppress(OSError):  # it ends just now
            began = [mark.stat().st_ctime for mark in folder.glob(f"{BEGAN}*")]
            start_times += began if is_claimed(folder) else []
    return start_times


def _files(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Every file below a folder; one that goes away meanwhile, and an absent folder, pass."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        if entry.is_dir(follow_symlinks=False):
            yield from _files(Path(entry.path))
        elif entry.is_file(follow_symlinks=False):
            with suppress(FileNotFoundError):
                entry.stat()  # kept by the entry
                yield entry
