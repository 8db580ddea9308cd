"""`assetbuild completion`: a script for the shell; nothing of it runs when a verb starts."""

from __future__ import annotations

import argparse

HELP = "print a completion script for a shell"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish", "tcsh"))


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from assetbuild.cli import make_parser

    print(shtab.complete(make_parser(), arguments.shell))
    return 0
