"""The swap of a finished folder: readers see the old bundle whole or the new one whole.

<out>.new-<owner>   a folder being filled, or an old one being removed: worthless after a kill
<out>.old-<8 hex>   the old bundle, for the moment between two renames where the file system
                    cannot exchange: after a kill it is put back
<out>.edited/       what the user changed or added inside the bundle
"""

from __future__ import annotations

import ctypes
import os
import re
import secrets
import shutil
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from assetbuild.engine.claims import (
    OWNER,
    claim_new_folder,
    claimed_name,
    release,
    remove_abandoned,
)
from assetbuild.engine.digest import digest_file
from assetbuild.engine.store import OUT_OPTION, machine_errors
from assetbuild.errors import MachineError, UsageError
from assetbuild.report.bundle import differing_files

MARK = "manifest.json"
"""A folder with this file is a bundle and may be replaced."""
PROVENANCE = "provenance.json"
OWN_FILES = (MARK, PROVENANCE)
"""Files of a bundle that its manifest does not list."""

AT_FDCWD = -100
RENAME_EXCHANGE = 2


def new_staging(out_dir: Path) -> Path:
    """An empty folder beside `out_dir` to build in; `publish` swaps it in, `release` gives it up.

    Refuses an `out_dir` that is not a bundle, and heals what a killed build left.
    """
    out = _real(out_dir)
    check_replaceable(out)
    heal(out)
    with machine_errors(out.parent, OUT_OPTION):
        return claim_new_folder(out.parent, f"{out.name}.new-")


def check_replaceable(out_dir: Path) -> None:
    """UsageError when `out_dir` holds something that is not a bundle, or cannot be a folder."""
    check_folder(out_dir)
    if not out_dir.exists() and not out_dir.is_symlink():
        return
    if not (out_dir / MARK).is_file() and any(out_dir.iterdir()):
        raise UsageError(
            f"`{out_dir}` holds files and no {MARK}: it is not a bundle, so it stays",
            hint="choose another folder with `-o`, or move its content away",
        )


def check_folder(path: Path) -> None:
    """UsageError when a file stands where a folder has to be."""
    for each in (path, *path.parents):
        if (each.exists() or each.is_symlink()) and not each.is_dir():
            message = f"`{each}` is not a folder"
            if each != path:
                message = f"`{path}` cannot be a folder: {message}"
            raise UsageError(message, hint="choose another folder with `-o`")


def heal(out_dir: Path) -> None:
    """Finish or undo what a killed build left beside `out_dir`.

    Folders that a running build has claimed are left alone.
    """
    out = _real(out_dir)
    if not out.parent.is_dir():
        return
    old = _beside(out, "old")
    if old and not os.path.lexists(out):
        old.pop().rename(out)
    for folder in old:
        _retire(folder, out)
    remove_abandoned(_beside(out, "new"))


def publish(
    staging: Path, out_dir: Path, manifest: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Swap a finished folder in as `out_dir`; paths in it that the user changed or added.

    staging: from `new_staging`, or any folder on the same file system; it is gone afterwards.
    manifest: of the bundle that is there now, relative path -> SHA-256; None = do not look.
    UsageError when `out_dir` is not a bundle; MachineError when the disk refuses.
    """
    out = _real(out_dir)
    try:
        with machine_errors(out.parent, OUT_OPTION):
            out.parent.mkdir(parents=True, exist_ok=True)
            heal(out)
            check_replaceable(out)
            paths = set_aside(out, manifest) if manifest is not None else ()
            _at("kept the user's files")
            _swap(staging, out)
    finally:
        release(staging)
    return paths


def lies_there(out_dir: Path, wanted: Mapping[str, str], digest: Callable[[Path], str]) -> bool:
    """Whether `out_dir` holds these files, path -> SHA-256, and nothing else: no swap is needed.

    digest: of a file; OSError counts as another one.
    """
    try:
        return bool(wanted) and not any(differing_files(_real(out_dir), wanted, digest))
    except OSError:
        return False


def set_aside(out: Path, manifest: Mapping[str, str]) -> tuple[str, ...]:
    """Copy edited and added files of a bundle to `<out>.edited/`; nothing there is replaced.

    Copied before the swap: a kill in between leaves them in both places, in none never.
    """
    changed = [
        name
        for what, name in differing_files(out, manifest)
        if what != "missing" and name not in OWN_FILES
    ]
    aside = out.with_name(f"{out.name}.edited")
    for name in changed:
        _keep(out / name, aside / name)
    return tuple(sorted(changed, key=lambda name: name not in manifest))  # edited ones first


def _keep(path: Path, place: Path) -> None:
    """Copy beside earlier kept versions: `a.xml`, `a.xml.1`, ...; the same bytes only once."""
    place.parent.mkdir(parents=True, exist_ok=True)
    number = 0
    target = place
    while os.path.lexists(target):
        if path.is_file() and target.is_file() and digest_file(target) == digest_file(path):
            return
        number += 1
        target = place.with_name(f"{place.name}.{number}")
    beside = place.with_name(f".{place.name[:200]}.{secrets.token_hex(4)}.tmp")
    shutil.copy2(path, beside, follow_symlinks=False)
    beside.rename(target)


def _swap(staging: Path, out: Path) -> None:
    if not os.path.lexists(out) or not any(out.iterdir()):
        staging.rename(out)  # onto nothing or an empty folder
        _at("renamed")
        return
    if _exchange(staging, out):
        _at("exchanged")
        _remove(staging)
        return
    old = out.with_name(f"{out.name}.old-{secrets.token_hex(4)}")
    out.rename(old)
    _at("moved the old one")
    staging.rename(out)
    _at("moved the new one")
    _retire(old, out)


def _retire(old: Path, out: Path) -> None:
    """Remove an old bundle. Renamed first: half of it must never be put back."""
    worthless = out.with_name(f"{out.name}.new-{claimed_name()}")
    old.rename(worthless)
    _at("retired the old one")
    _remove(worthless)


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    _at("removed the old one")


def _exchange(one: Path, other: Path) -> bool:
    """Swap two paths in one step; False where kernel or file system cannot."""
    if sys.platform != "linux":
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, "renameat2"):
        return False
    done = libc.renameat2(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE)
    return bool(done == 0)  # on any error the two renames try, and name what is wrong


def _beside(out: Path, kind: str) -> list[Path]:
    pattern = re.compile(rf"{re.escape(out.name)}\.{kind}-([0-9a-f]{{8}}|{OWNER.pattern})")
    return sorted(p for p in out.parent.iterdir() if pattern.fullmatch(p.name) and p.is_dir())


def _real(out_dir: Path) -> Path:
    """The folder behind links, so that a swap replaces the bundle and not the link to it."""
    real = Path(os.path.realpath(out_dir))
    if not real.name:
        raise MachineError(f"`{out_dir}` cannot hold a bundle")
    return real


def _at(point: str) -> None:
    """A point at which the tests kill the process."""
