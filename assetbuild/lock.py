"""`<recipe>.lock.yaml`: what a moving source was when it was last pinned. Written by the tool."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from pathlib import Path
from typing import Literal

from packaging.utils import canonicalize_name
from pydantic import Field

from assetbuild.errors import LockError, MachineError, Where
from assetbuild.recipe.loader import read_small_file, shown_path
from assetbuild.recipe.models import PYPI_PATTERN, Model, Sha256, Source
from assetbuild.recipe.validation import validated
from assetbuild.recipe.yaml_tree import described, parse

_HEAD = "# Written by `assetbuild lock`; not meant to be edited\n"


class Pin(Model):
    """One wheel, to the byte."""

    pypi: str = Field(pattern=PYPI_PATTERN, description="`name==version`, as in the recipe")
    file: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+!-]*\.whl$", description="wheel file name")
    sha256: Sha256 = Field(description="of the wheel, 64 hex digits")
    size: int = Field(ge=1, description="bytes")

    @property
    def name(self) -> str:
        """The distribution, as the recipe spells it."""
        return self.pypi.partition("==")[0]

    @property
    def version(self) -> str:
        """The version, as the recipe spells it."""
        return self.pypi.partition("==")[2]


class Lock(Model):
    """The pins of one recipe."""

    schema_: Literal["assetbuild-lock/v1"] = Field("assetbuild-lock/v1", alias="schema")
    source: Pin


def lock_path(recipe: Path) -> Path:
    """`recipes/go1.lock.yaml` for `recipes/go1.yaml`."""
    return recipe.with_name(f"{recipe.stem}.lock.yaml")


def read_lock(path: Path) -> Lock | None:
    """The lock in a file, None when there is none; LockError with file and line when it is bad."""
    if not os.path.lexists(path):
        return None
    file = shown_path(path)
    root = parse(read_small_file(path, file, LockError), file, LockError)
    if not isinstance(root.value, dict):
        hint = "write it anew with `assetbuild lock`"
        message = f"expected a map at the top, found {described(root)}"
        raise LockError(message, where=root.where, hint=hint)
    return validated(Lock, root, LockError)


def lock_text(lock: Lock) -> str:
    """The file's text: the same lock gives the same bytes."""
    pin = lock.source
    return (
        f"{_HEAD}schema: {lock.schema_}\nsource:\n"
        f"  pypi: {_quoted(pin.pypi)}\n  file: {_quoted(pin.file)}\n"
        f"  sha256: {_quoted(pin.sha256)}\n  size: {pin.size}\n"
    )


def write_lock(path: Path, lock: Lock) -> bool:
    """Write the lock beside the recipe, at once or not at all; False when it was so already."""
    data = lock_text(lock).encode("utf-8")
    with contextlib.suppress(OSError):
        if path.read_bytes() == data:
            return False
    try:
        handle, beside = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            Path(beside).chmod(0o644)
            Path(beside).replace(path)
        except BaseException:
            Path(beside).unlink(missing_ok=True)
            raise
    except OSError as problem:
        where = Where(shown_path(path))
        message = f"the lock cannot be written: {problem.strerror}"
        raise MachineError(message, where=where) from None
    return True


def check_pin(source: Source, lock: Lock, path: Path) -> None:
    """LockError when the lock at `path` pins another source than the recipe names."""
    where = Where(shown_path(path))
    if source.pypi is None:
        message = f"the lock pins {lock.source.pypi}, but the recipe's source is a folder"
        raise LockError(message, where=where, hint="delete the lock")
    name, _, version = source.pypi.partition("==")
    pin = lock.source
    if canonicalize_name(name) != canonicalize_name(pin.name) or version != pin.version:
        raise LockError(
            f"the lock pins {pin.pypi}, but the recipe names {source.pypi}",
            where=where,
            hint="run `assetbuild lock` to pin what the recipe names",
        )


def _quoted(text: str) -> str:
    """JSON's quotes are YAML's; a digest of digits alone must stay text."""
    return json.dumps(text)
