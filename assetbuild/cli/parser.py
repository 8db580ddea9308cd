"""The parser of every verb: what is wrong with a command is said in a sentence, with its usage."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from assetbuild.errors import UsageError, nearest

N = TypeVar("N", int, float)


class Parser(argparse.ArgumentParser):
    """Shows the usage of the verb that is wrong, and one error as all others are shown."""

    def parse_known_args(  # type: ignore[override] # typeshed has overloads by `namespace`
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse as argparse does, but leave no argument over: the parser of a verb is to say so."""
        parsed, left = super().parse_known_args(args, namespace)
        for word in left:
            if not word.startswith("-"):
                self.refuse(f"`{self.prog}` takes no further argument: `{word}`")
            known = [option for option in self._option_string_actions if option.startswith("--")]
            near = nearest(word, known) if word.startswith("--") else None
            hint = f"did you mean `{near}`?" if near else f"`{self.prog} --help` lists the options"
            self.refuse(f"`{self.prog}` has no option `{word}`", hint=hint)
        return parsed, []

    def _check_value(self, action: argparse.Action, value: Any) -> None:  # Any: as argparse has it
        """A word that is none of the choices; argparse has no public method for this."""
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        near = nearest(str(value), known)
        hint = f"did you mean `{near}`?" if near else ""
        if action.dest in ("verb", "what"):
            more = f"`{self.prog} --help` lists the verbs"
            self.refuse(f"no verb named `{value}`", hint=hint or _for_file(str(value)) or more)
        name = (action.option_strings or [str(action.metavar or action.dest)])[-1]
        *most, last = [f"`{one}`" for one in known]
        choices = f"{', '.join(most)} or {last}" if most else last
        self.refuse(f"`{name}` must be {choices}, not `{value}`", hint=hint)

    def error(self, message: str) -> NoReturn:
        """The words of argparse as ours."""
        about, _, reason = message.removeprefix("argument ").partition(": ")
        if about == "the following arguments are required":
            names = ", ".join(f"`{one.rpartition('/')[2]}`" for one in reason.split(", "))
            verbs = [choice for action in self._actions for choice in action.choices or ()]
            hint = f"one of {', '.join(verbs)}" if self._subparsers else ""
            self.refuse(f"`{self.prog}` needs {names}", hint=hint)
        if not reason or not message.startswith("argument "):
            self.refuse(message)
        if reason.startswith("expected "):
            count = reason.split()[1]
            reason = f"needs {count} values" if count.isdigit() else "needs a value"
        self.refuse(f"`{about.rpartition('/')[2]}` {reason.removeprefix('argument ')}")

    def refuse(self, message: str, hint: str = "") -> NoReturn:
        """The usage, the error, and exit code 2."""
        self.print_usage(sys.stderr)
        self.exit(UsageError.exit_code, f"error: {UsageError(message, hint=hint)}\n")


def _for_file(word: str) -> str:
    """The command that somebody meant who named a file alone; nothing for any other word."""
    verbs = {"build": (".yaml", ".yml"), "init": (".urdf", ".xacro", ".xml")}
    for verb, suffixes in verbs.items():
        if Path(word).suffix in suffixes and Path(word).is_file():
            return f"`assetbuild {verb} {word}`"
    return ""


UNITS = {"": 1, "K": 1000, "M": 1000**2, "G": 1000**3, "T": 1000**4}
UNITS |= {"KI": 1024, "MI": 1024**2, "GI": 1024**3, "TI": 1024**4}


def recipes_of(named: Sequence[Path]) -> list[Path]:
    """Each recipe once; a lock stands for its recipe, as `recipes/*.yaml` names both."""
    return list(dict.fromkeys(p.with_name(p.name.replace(".lock.", ".")) for p in named))


def given_as(recipe: Path) -> str:
    """What names this recipe on a command line here: its path, or its name in the library."""
    from assetbuild.library import INSTALLED, robots

    if recipe.is_relative_to(Path.cwd()) and recipe.parent != INSTALLED:
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
        message = f"names no file, and {error.message}; {error.hint}"
        raise argparse.ArgumentTypeError(message) from None


def number(least: N, most: N | None = None, what: str = "a whole number") -> Callable[[str], N]:
    """The type of an argument that is a number from `least` to `most`, of the type of `least`."""
    bounds = f"of at least {least}" if most is None else f"from {least} to {most}"

    def read(text: str) -> N:
        with suppress(ValueError):
            value = type(least)(text)
            if least <= value and (most is None or value <= most):
                return value
        raise argparse.ArgumentTypeError(f"must be {what} {bounds}, not `{text}`")

    return read


def size_of_text(text: str) -> int:
    """Bytes of `5GB`, `500 MB`, `2GiB` or `1000`."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?I?)B?", text.strip().upper())
    if match is None or match[2] not in UNITS:
        message = f"must be a size such as `500MB`, `5GB` or `2GiB`, not `{text}`"
        raise argparse.ArgumentTypeError(message)
    return int(float(match[1]) * UNITS[match[2]])


def named_path(text: str) -> tuple[str, Path]:
    """`NAME=PATH`."""
    name, folder = named_value(text)
    return name, Path(folder)


def named_value(text: str) -> tuple[str, str]:
    """`NAME=VALUE`; of `NAME:=VALUE` too, as ROS writes it."""
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise argparse.ArgumentTypeError("must be NAME=VALUE")
    return name.removesuffix(":"), value
