"""What the package itself knows: its completion for a shell, its schema, its library of robots."""

from __future__ import annotations

import argparse


def completion(arguments: argparse.Namespace) -> int:
    """Print a script for the shell; nothing of it runs when a verb starts."""
    import shtab

    from assetbuild.cli.verbs import make_parser

    print(shtab.complete(make_parser(), arguments.shell))
    return 0


def schema(_: argparse.Namespace) -> int:
    """Print the JSON Schema of recipes."""
    from assetbuild.pipeline.recipes import schema_text

    print(schema_text(), end="")
    return 0


def library(_: argparse.Namespace) -> int:
    """A line for each robot."""
    from assetbuild.library import robots, sentence

    found = robots()
    width = max(map(len, found))
    for name, path in found.items():
        print(f"{name:{width}}  {sentence(path)}")
    return 0
