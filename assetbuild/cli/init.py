"""`assetbuild init`: a commented recipe for a robot."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from assetbuild.errors import UsageError

SCHEMA_FILE = "recipe.schema.json"
"""Beside the recipe, whose first line names it: editors complete and check the recipe by it."""
HELP = "look at a robot and write a commented recipe that builds"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("robot", type=Path, nargs="?", metavar="ROBOT.urdf|.xacro|.xml")
    parser.add_argument(
        "--from", dest="origin", metavar="NAME", help="copy the recipe of a robot of the library"
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="RECIPE", help="default: <robot>.yaml, - prints it"
    )
    add_package_argument(parser)
    parser.add_argument(
        "--arg",
        action="append",
        default=[],
        type=_argument,
        metavar="NAME=VALUE",
        help="an argument of a xacro file",
    )
    parser.add_argument("--force", action="store_true", help="replace a recipe that exists")


def add_package_argument(parser: argparse.ArgumentParser) -> None:
    """`--package NAME=PATH`, as often as wanted: pairs in `arguments.package`."""
    parser.add_argument(
        "--package",
        action="append",
        default=[],
        type=_package,
        metavar="NAME=PATH",
        help="the folder that package://NAME stands for; others are looked for above the URDF",
    )


def _package(text: str) -> tuple[str, Path]:
    name, equals, folder = text.partition("=")
    if not name or not equals or not folder:
        raise argparse.ArgumentTypeError("must be NAME=PATH")
    return name, Path(folder)


def _argument(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise argparse.ArgumentTypeError("must be NAME=VALUE")
    return name.removesuffix(":"), value


def run(arguments: argparse.Namespace) -> int:
    """Write the recipe; says what to do next."""
    if (arguments.robot is None) == (arguments.origin is None):
        raise UsageError("`init` takes a robot's file, or `--from NAME`")
    if arguments.origin is not None:
        return _copy(arguments.origin, arguments.out)
    from assetbuild.init import propose, write
    from assetbuild.recipe.loader import shown_path

    printed = str(arguments.out) == "-"
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
    write_schema(proposal.path.with_name(SCHEMA_FILE))
    return _written(shown_path(proposal.path))


def _copy(name: str, out: Path | None) -> int:
    from assetbuild.library import copy

    path = out or Path(f"{name}.yaml")
    copy(name, path)
    write_schema(path.with_name(SCHEMA_FILE))
    return _written(str(path))


def _written(shown: str) -> int:
    print(f"wrote {shown}")
    print(f"next: read it, then `assetbuild build {shown}`", file=sys.stderr)
    return 0


def write_schema(path: Path) -> None:
    """Write the schema of recipes, or renew an older one; a file of another kind is left alone."""
    from assetbuild.pipeline.recipes import schema_text

    text = schema_text()
    title = next(line for line in text.splitlines() if '"title"' in line)
    try:
        old = path.read_text(encoding="utf-8", errors="replace") if path.exists() else title
        if title in old and old != text:
            path.write_text(text, encoding="utf-8")
    except OSError as problem:  # the recipe builds without it
        print(f"not written: {path.name}, for editors: {problem.strerror}", file=sys.stderr)
