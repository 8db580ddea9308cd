"""`assetbuild verify`: every file of a bundle against manifest, provenance, and recipe."""

from __future__ import annotations

import argparse
from pathlib import Path

from assetbuild.cli.parser import WHICH_CHECK
from assetbuild.cli.recipes import file_or_robot

HELP = "compare a bundle with its manifest, its provenance, and what a recipe makes"
EPILOG = WHICH_CHECK


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", type=Path, help="a folder that `assetbuild build` wrote")
    parser.add_argument(
        "--recipe",
        type=file_or_robot,
        metavar="RECIPE",
        help="is it what this recipe makes? asks the store",
    )
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")


def run(arguments: argparse.Namespace) -> int:
    """Print each difference; 0 when there is none, 1, or 3 when the store cannot tell."""
    from assetbuild.pipeline.bundling import manifest_of
    from assetbuild.pipeline.verifying import (
        against_manifest,
        against_provenance,
        against_recipe,
    )

    bundle: Path = arguments.bundle
    wanted = manifest_of(bundle)
    wrong = [*against_manifest(bundle, wanted), *against_provenance(bundle, wanted)]
    compared = "manifest, provenance"
    if arguments.recipe is not None and not wrong:
        compared += f", {arguments.recipe}"
        wrong += against_recipe(bundle, arguments.recipe, arguments.variant)
    for line in wrong:
        print(line)
    print(f"{bundle}: {len(wanted)} files, {len(wrong)} differences ({compared})")
    return 1 if wrong else 0
