"""`assetbuild init`: a commented recipe for a robot."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from assetbuild import library
from assetbuild.errors import UsageError
from assetbuild.init import propose, write
from assetbuild.pipeline.recipes import schema_text
from assetbuild.recipe.loader import shown_path

SCHEMA_FILE = "recipe.schema.json"
"""Beside the recipe, whose first line names it: editors complete and check the recipe by it."""


def run(arguments: argparse.Namespace) -> int:
    """Write the recipe; says what to do next."""
    if (arguments.robot is None) == (arguments.origin is None):
        raise UsageError("`init` takes a robot's file, or `--from NAME`")
    printed = str(arguments.out) == "-"
    if arguments.origin is not None:
        path = Path(f"{arguments.origin}.yaml")
        if printed:
            print(library.text(library.recipe(arguments.origin), path), end="")
            return 0
        path = arguments.out or path
        library.copy(arguments.origin, path, force=arguments.force)
        return _written(path, str(path))
    out = None if printed else arguments.out
    proposal = propose(arguments.robot, out, dict(arguments.package), dict(arguments.arg))
    for problem in proposal.unmended:
        print(f"not ready: {problem}", file=sys.stderr)
    if proposal.undecided:
        print(f"undecided: {proposal.undecided}", file=sys.stderr)
    if printed:
        print(proposal.text, end="")
        return 0
    write(proposal, force=arguments.force)
    return _written(proposal.path, shown_path(proposal.path))


def _written(path: Path, shown: str) -> int:
    write_schema(path.with_name(SCHEMA_FILE))
    print(f"wrote {shown}")
    print(f"next: read it, then `assetbuild build {shown}`", file=sys.stderr)
    return 0


def write_schema(path: Path) -> None:
    """Write the schema of recipes, or renew an older one; a file of another kind is left alone."""
    text = schema_text()
    title = next(line for line in text.splitlines() if '"title"' in line)
    try:
        old = path.read_text(encoding="utf-8", errors="replace") if path.exists() else title
        if title in old and old != text:
            path.write_text(text, encoding="utf-8")
    except OSError as problem:  # the recipe builds without it
        print(f"not written: {path.name}, for editors: {problem.strerror}", file=sys.stderr)
