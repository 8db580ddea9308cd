"""`assetbuild check`: what can be said without a heavy step; what the pre-commit hook calls."""

from __future__ import annotations

import argparse
from pathlib import Path

from assetbuild.cli import print_error
from assetbuild.cli.summary import every_finding_line
from assetbuild.cli.values import recipes_of
from assetbuild.errors import AssetBuildError, UsageError
from assetbuild.pipeline.checking import check


def run(arguments: argparse.Namespace) -> int:
    """Check each recipe; the worst exit code of all."""
    codes = [0]
    for recipe in _recipes(arguments.recipes):
        try:
            findings = check(recipe)
        except AssetBuildError as error:
            print_error(error)
            codes.append(error.exit_code)
            continue
        errors = [finding for finding in findings if finding.severity == "error"]
        for line in every_finding_line([one for one in findings if one.severity != "info"]):
            print(line)
        codes.append(1 if errors else 0)
        if not errors:
            print(f"{recipe}: ok")
    return max(codes)


def _recipes(named: list[Path]) -> list[Path]:
    """The recipes to check."""
    if not named:
        named = sorted(Path("recipes").glob("*.yaml"))
        if not named:
            raise UsageError("no recipe given, and there is none in `recipes/`")
    return recipes_of(named)
