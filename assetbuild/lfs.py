"""Git LFS: a clone without it holds small text files where meshes and pictures should be."""

from __future__ import annotations

from assetbuild.errors import SourceError, Where

POINTER = b"version https://git-lfs.github.com/spec/v1"
"""How a pointer file begins (git-lfs, docs/spec.md)."""


def refuse_pointer(data: bytes, subject: str = "", where: Where | None = None) -> None:
    """SourceError for a file that is only a pointer to the real one. subject: what it is."""
    if not data.startswith(POINTER):
        return
    message = "this is a git-LFS pointer: the file itself was not downloaded"
    hint = "run `git lfs pull` in the repository that it comes from"
    raise SourceError(f"{subject}: {message}" if subject else message, where=where, hint=hint)
