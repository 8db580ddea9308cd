"""`<recipe>.lock.yaml`: what a moving source was when it was last pinned. Written by the tool."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from assetbuild.engine.digest import replace_file
from assetbuild.engine.world import World
from assetbuild.errors import LockError, MachineError, Where
from assetbuild.recipe.loader import read_map, shown_path
from assetbuild.recipe.source import PYPI_PATTERN, Sha256, Source
from assetbuild.recipe.validation import locate, validated
from assetbuild.recipe_types import Model

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


class GitPin(Model):
    """One commit of a repository."""

    git: str = Field(description="the repository, as in the recipe")
    rev: str = Field(description="branch, tag or commit, as in the recipe")
    commit: str = Field(pattern=r"^[0-9a-f]{40}$", description="what `rev` stood for")
    sha256: Sha256 = Field(description="of the paths and contents of its files")
    size: int = Field(ge=1, description="bytes of the exported tar")


_OnePin = Annotated[
    Annotated[Pin, Tag("a wheel")] | Annotated[GitPin, Tag("a commit")],
    # Without it a wrong value would be told once for each kind of pin.
    Discriminator(lambda raw: "a commit" if "git" in _keys(raw) else "a wheel"),
]


class Lock(Model):
    """The pins of one recipe: of its source, and of the sources that its parts name themselves."""

    schema_: Literal["assetbuild-lock/v1"] = Field("assetbuild-lock/v1", alias="schema")
    source: _OnePin | None = None
    parts: tuple[_OnePin, ...] = ()

    @model_validator(mode="after")
    def _of_something(self) -> Lock:
        if self.source is None and not self.parts:
            raise ValueError("missing key `source`: nothing is pinned")
        return self

    @property
    def pins(self) -> tuple[Pin | GitPin, ...]:
        """All of them."""
        return (*((self.source,) if self.source else ()), *self.parts)

    def pin_of(self, source: Source) -> Pin | GitPin | None:
        """The pin of a moving source, whoever names it; None when there is none."""
        return next((pin for pin in self.pins if _agree(source, pin)), None)


def _keys(raw: object) -> Iterable[str]:
    return raw if isinstance(raw, dict) else dict(raw) if isinstance(raw, Model) else ()


def lock_path(recipe: Path) -> Path:
    """`recipes/go1.lock.yaml` for `recipes/go1.yaml`."""
    return recipe.with_name(f"{recipe.stem}.lock.yaml")


def read_lock(path: Path, world: World | None = None) -> Lock | None:
    """The lock in a file, None when there is none; LockError with file and line when it is bad.

    world: of a build, which notes that it asked.
    """
    world = world or World()
    if not world.exists(path):
        return None
    hint = "write it anew with `assetbuild lock`"
    return validated(Lock, read_map(path, LockError, world, "a map at the top", hint), LockError)


def lock_text(lock: Lock) -> str:
    """The file's text: the same lock gives the same bytes."""
    text = f"{_HEAD}schema: {lock.schema_}\n"
    if lock.source is not None:
        text += "source:\n" + "".join(f"  {row}\n" for row in _rows(lock.source))
    if lock.parts:
        text += "parts:\n"
    for pin in lock.parts:
        first, *others = _rows(pin)
        text += f"  - {first}\n" + "".join(f"    {row}\n" for row in others)
    return text


def _rows(pin: Pin | GitPin) -> list[str]:
    # JSON's quotes are YAML's; a digest of digits alone must stay text.
    return [f"{key}: {json.dumps(value)}" for key, value in pin]


def write_lock(path: Path, lock: Lock) -> bool:
    """Write the lock beside the recipe, at once or not at all; False when it was so already."""
    data = lock_text(lock).encode("utf-8")
    with contextlib.suppress(OSError):
        if path.read_bytes() == data:
            return False
    try:
        replace_file(path, data)
    except OSError as problem:
        where = Where(shown_path(path))
        message = f"the lock cannot be written: {problem.strerror}"
        raise MachineError(message, where=where) from None
    return True


def place_of_pin(path: Path) -> Where:
    """The line of the digest in a lock file; the file alone when it cannot be read."""
    try:
        return locate(read_map(path, LockError, None, "a map", ""), ("source", "sha256"))
    except LockError:
        return Where(shown_path(path))


def check_pin(source: Source, lock: Lock, path: Path) -> None:
    """LockError when the lock at `path` pins another source than the recipe names."""
    if lock.pin_of(source) is None:
        pin = lock.pins[0]
        pinned = pin.pypi if isinstance(pin, Pin) else f"{pin.git} at {pin.rev}"
        raise LockError(
            f"the lock pins {pinned}, but the recipe names {source.moving}",
            where=Where(shown_path(path)),
            hint="run `assetbuild lock` to pin what the recipe names",
        )


def _agree(source: Source, pin: Pin | GitPin) -> bool:
    if isinstance(pin, GitPin):
        return (source.git, source.rev) == (pin.git, pin.rev)
    name, _, version = (source.pypi or "").partition("==")
    from packaging.utils import canonicalize_name  # for a source from PyPI alone

    return canonicalize_name(name) == canonicalize_name(pin.name) and version == pin.version
