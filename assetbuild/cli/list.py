"""`assetbuild list`: the library of robots."""

from __future__ import annotations

import argparse

HELP = "list the robots that `assetbuild build NAME` builds without a recipe of yours"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(arguments: argparse.Namespace) -> int:
    """A line for each robot."""
    from assetbuild.library import robots, sentence

    found = robots()
    width = max(map(len, found))
    for name, path in found.items():
        print(f"{name:{width}}  {sentence(path)}")
    return 0
