"""Recipes on a command line: robots of the library by name; a lock stands for its recipe."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any


class Recipes(argparse.Action):
    """Each recipe once; a lock stands for its recipe, as `recipes/*.yaml` names both."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,  # Any: as argparse has it
        option_string: str | None = None,
    ) -> None:
        """Store them."""
        setattr(namespace, self.dest, recipes_of([Path(value) for value in values or ()]))


def recipes_of(named: Sequence[Path]) -> list[Path]:
    """`a.yaml` for `a.yaml` and `a.lock.yaml`, in the order of the command line."""
    return list(dict.fromkeys(p.with_name(p.name.replace(".lock.", ".")) for p in named))


def given_as(recipe: Path) -> str:
    """What names this recipe on a command line here: its path, or its name in the library."""
    from assetbuild.library import robots

    if recipe.is_relative_to(Path.cwd()):
        return shlex.quote(str(recipe.relative_to(Path.cwd())))
    return recipe.stem if robots().get(recipe.stem) == recipe else shlex.quote(str(recipe))


def file_or_robot(text: str) -> Path:
    """The type of an argument: a path, or `go1` for the library's recipe."""
    path = Path(text)
    if not text.isidentifier() or path.exists():
        return path
    from assetbuild.errors import UsageError
    from assetbuild.library import recipe

    try:
        return recipe(text)
    except UsageError as error:
        said = f"is no file, and {error.message}; {error.hint}"
        raise argparse.ArgumentTypeError(said) from None
