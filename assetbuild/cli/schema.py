"""`assetbuild schema`: the JSON Schema of a recipe."""

from __future__ import annotations

import argparse

HELP = "print the JSON Schema of recipes, for editors"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(arguments: argparse.Namespace) -> int:
    """Print the schema."""
    from assetbuild.pipeline.recipes import schema_text

    print(schema_text(), end="")
    return 0
