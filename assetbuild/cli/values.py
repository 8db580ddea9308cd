"""What the words of a command line stand for: recipes, numbers, sizes, pairs."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

UNITS = {"": 1, "K": 1000, "M": 1000**2, "G": 1000**3, "T": 1000**4}
UNITS |= {"KI": 1024, "MI": 1024**2, "GI": 1024**3, "TI": 1024**4}


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
    """A path, or `go1` for the library's recipe."""
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


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """The type of an argument that is a whole number from `least` to `most`."""
    bounds = f"of at least {least}" if most is None else f"from {least} to {most}"

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least or (most is not None and value > most):
            raise argparse.ArgumentTypeError(f"must be a whole number {bounds}, not `{text}`")
        return value

    return read


def size_of_text(text: str) -> int:
    """Bytes of `5GB`, `500 MB`, `2GiB` or `1000`."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?I?)B?", text.strip().upper())
    if found is None or found[2] not in UNITS:
        message = f"must be a size such as `500MB`, `5GB` or `2GiB`, not `{text}`"
        raise argparse.ArgumentTypeError(message)
    return int(float(found[1]) * UNITS[found[2]])


def named_path(text: str) -> tuple[str, Path]:
    """`NAME=PATH`."""
    name, _, folder = text.partition("=")
    if not name or not folder:
        raise argparse.ArgumentTypeError("must be NAME=PATH")
    return name, Path(folder)


def named_value(text: str) -> tuple[str, str]:
    """`NAME=VALUE`; of `NAME:=VALUE` too, as ROS writes it."""
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise argparse.ArgumentTypeError("must be NAME=VALUE")
    return name.removesuffix(":"), value
