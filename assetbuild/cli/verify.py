"""`assetbuild verify`: every file of a bundle against manifest, provenance, and recipe."""

from __future__ import annotations

import argparse
from pathlib import Path

from assetbuild.pipeline.verifying import against_manifest, against_provenance, against_recipe
from assetbuild.report.bundle import manifest_of


def run(arguments: argparse.Namespace) -> int:
    """Print each difference; 0 when there is none, 1, or 3 when the store cannot tell."""
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
