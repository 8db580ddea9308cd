"""The parser of every verb: what is wrong with a command is said in a sentence, with its usage."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from assetbuild.errors import UsageError, nearest


class Parser(argparse.ArgumentParser):
    """Shows the usage of the verb that is wrong, and one error as all others are shown."""

    def parse_known_args(  # type: ignore[override] # typeshed has overloads by `namespace`
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse, but no argument is left over: the parser of a verb is the one to say so."""
        words = list(sys.argv[1:] if args is None else args)
        if self._subparsers is None:
            self._refuse_unknown_options(words)
        parsed, left = super().parse_known_args(words, namespace)
        for word in left:
            if word.startswith("-"):
                self._refuse_option(word)
            self.refuse(f"`{self.prog}` takes no further argument: `{word}`")
        return parsed, []

    def _refuse_unknown_options(self, words: list[str]) -> None:
        """Before argparse, which first asks for arguments that are missing."""
        if "--" in words:
            words = words[: words.index("--")]
        for word in words:
            if not word.startswith("-") or word == "-" or re.fullmatch(r"-[\d.]+(e-?\d+)?", word):
                continue
            name = word.partition("=")[0] if word.startswith("--") else word[:2]
            found = [o for o in self._option_string_actions if o.startswith(name)]
            if not found:
                self._refuse_option(name)
            if len(found) > 1 and name not in found:
                self.refuse(f"`{name}` may be {_one_of(found)}", hint="write the option in full")

    def _refuse_option(self, name: str) -> NoReturn:
        known = [option for option in self._option_string_actions if option.startswith("--")]
        near = nearest(name, known) if name.startswith("--") else None
        hint = f"did you mean `{near}`?" if near else f"`{self.prog} --help` lists the options"
        self.refuse(f"`{self.prog}` has no option `{name}`", hint=hint)

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
        self.refuse(f"`{name}` must be {_one_of(known)}, not `{value}`", hint=hint)

    def error(self, message: str) -> NoReturn:
        """The words of argparse as ours."""
        about, _, said = message.removeprefix("argument ").partition(": ")
        name = about.rpartition("/")[2]
        if about == "the following arguments are required":
            names = ", ".join(f"`{one.rpartition('/')[2]}`" for one in said.split(", "))
            verbs = [choice for action in self._actions for choice in action.choices or ()]
            hint = f"one of {', '.join(verbs)}" if self._subparsers else ""
            self.refuse(f"`{self.prog}` needs {names}", hint=hint)
        if not said or not message.startswith("argument "):
            self.refuse(message)
        if said.startswith("expected "):
            said = "needs a value"
        elif said.startswith("not allowed with argument "):
            said = f"cannot stand beside `{said.rpartition(' ')[2].rpartition('/')[2]}`"
        elif said.startswith("ignored explicit argument "):
            said = "takes no value"
        else:
            said = said.removeprefix("argument ")
        self.refuse(f"`{name}` {said}")

    def refuse(self, message: str, hint: str = "") -> NoReturn:
        """The usage, the error, and exit code 2."""
        self.print_usage(sys.stderr)
        self.exit(UsageError.exit_code, f"error: {UsageError(message, hint=hint)}\n")


def _one_of(names: Sequence[str]) -> str:
    *most, last = [f"`{name}`" for name in names]
    return f"{', '.join(most)} or {last}" if most else last


def _for_file(word: str) -> str:
    """The command that somebody meant who named a file alone; nothing for any other word."""
    verbs = {"build": (".yaml", ".yml"), "init": (".urdf", ".xacro", ".xml")}
    for verb, suffixes in verbs.items():
        if Path(word).suffix in suffixes and Path(word).is_file():
            return f"`assetbuild {verb} {word}`"
    return ""
