"""What a moving name stands for now: the pins that a lock keeps."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from assetbuild.engine.digest import digest_file
from assetbuild.lock import GitPin, Pin
from assetbuild.source.get.fetch import OnLine, downloaded_wheel
from assetbuild.source.get.fetch_git import COMMIT, commit_of, export_commit, tree_digest


def resolve(name: str, version: str, *, on_line: OnLine | None = None) -> Pin:
    """Download a wheel to learn its file name, digest and size: what the lock pins.

    on_line: gets pip's own lines while it works ("Downloading ... (131.1 MB)"). Errors as
    `Fetch.run`.
    """
    with TemporaryDirectory(prefix=".fetch-") as folder:
        wheel = downloaded_wheel(name, version, Path(folder), on_line)
        size = wheel.stat().st_size
        digest = digest_file(wheel)
        return Pin(pypi=f"{name}=={version}", file=wheel.name, sha256=digest, size=size)


def resolve_git(git: str, rev: str, url: str) -> GitPin:
    """The commit that a branch, tag or commit stands for now, and the digest of its files.

    git: as the recipe spells it; url: where it is from here. Errors as `FetchGit.run`.
    """
    with TemporaryDirectory(prefix=".git-") as temporary:
        folder = Path(temporary)
        commit = rev if COMMIT.fullmatch(rev) else commit_of(url, rev, folder)
        target = folder / "archive.tar"
        export_commit(url, commit, folder, target)
        size = target.stat().st_size
        return GitPin(git=git, rev=rev, commit=commit, sha256=tree_digest(target), size=size)
