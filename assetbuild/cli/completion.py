"""`assetbuild completion`: a script for the shell; nothing of it runs when a verb starts."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

HELP = "print a completion script for bash, zsh or fish"

BASH = """_assetbuild() {
  local current="${COMP_WORDS[COMP_CWORD]}" words="" verb="${COMP_WORDS[1]}"
  if [ "$COMP_CWORD" -eq 1 ]; then
    words="@VERBS@"
  else
    case "$verb" in
@CASES@
    esac
  fi
  COMPREPLY=($(compgen -W "$words" -- "$current"))
}
complete -o default -F _assetbuild assetbuild
"""
ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"))


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    words = words_by_verb()
    if arguments.shell == "fish":
        print(_fish(words), end="")
    else:
        print((ZSH if arguments.shell == "zsh" else "") + _bash(words), end="")
    return 0


def words_by_verb() -> dict[str, tuple[str, ...]]:
    """Options and fixed choices of each verb, from the verbs' own declarations."""
    from assetbuild.cli import VERBS, module_of

    found = {}
    for verb in VERBS:
        parser = argparse.ArgumentParser(prog=verb)
        module_of(verb).add_arguments(parser)
        words: list[str] = []
        for action in parser._actions:
            words += action.option_strings
            if action.choices is not None and not action.option_strings:
                words += [str(choice) for choice in action.choices]
        found[verb] = tuple(words)
    return found


def _bash(words: Mapping[str, tuple[str, ...]]) -> str:
    cases = "\n".join(f'      {verb}) words="{" ".join(own)}" ;;' for verb, own in words.items())
    return BASH.replace("@VERBS@", " ".join(words)).replace("@CASES@", cases)


def _fish(words: Mapping[str, tuple[str, ...]]) -> str:
    lines = []
    for verb, own in words.items():
        lines.append(f"complete -c assetbuild -n __fish_use_subcommand -a {verb}")
        for word in own:
            what = f"-l {word[2:]}" if word.startswith("--") else f"-a {word}"
            if not word.startswith("-") or word.startswith("--"):
                lines.append(
                    f"complete -c assetbuild -n '__fish_seen_subcommand_from {verb}' {what}"
                )
    return "\n".join(lines) + "\n"
