"""The two folders of a step: inputs laid out, outputs taken in."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from assetbuild.engine.actions import Action
from assetbuild.engine.digest import Signature, signature_of
from assetbuild.engine.session import Session
from assetbuild.engine.store import LostObjectError, Store, files_below
from assetbuild.errors import StepError

Staged = dict[str, tuple[str, Path, Signature]]
"""Input file by its path below the folder -> (digest, object's file, signature)."""


def stage(session: Session, inputs: Mapping[str, str], folder: Path) -> Staged:
    """Lay out inputs (name -> digest) as links to verified objects; `folder` is made.

    LostObjectError when the store lost one; SourceError when a source was edited meanwhile.
    """
    folder.mkdir()
    staged: Staged = {}
    for name, digest in sorted(inputs.items()):
        if name.endswith("/"):
            (folder / name).mkdir(parents=True)
            for member, (part, _) in sorted(session.tree(digest).items()):
                staged[name + member] = _link(session, part, folder / name / member)
        else:
            staged[name] = _link(session, digest, folder / name)
    return staged


def _link(session: Session, digest: str, place: Path) -> tuple[str, Path, Signature]:
    path = session.object(digest)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.symlink_to(path)
    return digest, path, signature_of(path.stat())


def check_untouched(session: Session, staged: Staged, label: str) -> None:
    """StepError when the step wrote to an input; a changed object leaves the store."""
    for name, (digest, path, signature) in staged.items():
        try:
            same = signature_of(path.stat()) == signature
        except OSError:
            continue  # another build set a corrupt object aside
        if same:
            continue
        was = path.read_bytes() if path.is_file() else b""
        session.forget()
        try:
            session.store.path(digest)
        except LostObjectError:
            raise StepError(
                f"step `{label}` wrote to its input `{name}` ({len(was)} bytes now)",
                hint="a step reads its inputs and writes its outputs only",
            ) from None


def check_present(staged: Staged) -> None:
    """LostObjectError when an input went away while the step ran: it is made again."""
    for name, (digest, path, _) in staged.items():
        if not path.is_file():
            raise LostObjectError(digest, f"input `{name}` went away while its step ran")


def collect(store: Store, action: Action, folder: Path) -> dict[str, str]:
    """Take the declared outputs into the store: name -> digest.

    StepError names what was declared and not written, or written and not declared.
    """
    declared = action.step.outputs
    try:
        written = [path.relative_to(folder).as_posix() for path in files_below(folder)]
    except ValueError as error:
        raise StepError(f"step `{action.label}`: output {error}") from None
    trees = tuple(name for name in declared if name.endswith("/"))
    extra = [name for name in written if name not in declared and not name.startswith(trees)]
    if extra:
        raise StepError(
            f"step `{action.label}` wrote what it does not declare: {_names(extra)}",
            hint=f"its `outputs` are {_names(declared) or 'empty'}",
        )
    absent = [
        name
        for name in declared
        if not ((folder / name).is_dir() if name.endswith("/") else name in written)
    ]
    if absent:
        raise StepError(f"step `{action.label}` did not write its output {_names(absent)}")
    for name in written:
        if not _is_text(name):
            raise StepError(f"step `{action.label}` wrote a file whose name is not UTF-8: {name!a}")
    return {
        name: store.put_tree(folder / name)
        if name.endswith("/")
        else store.put_file(folder / name, move=True)
        for name in declared
    }


def _names(names: tuple[str, ...] | list[str]) -> str:
    shown = ", ".join(f"`{name}`" for name in names[:8])
    return f"{shown}, ..." if len(names) > 8 else shown


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
