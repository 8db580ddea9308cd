"""`assetbuild diff`: what changed between two robots, worst first."""

from __future__ import annotations

import argparse
import posixpath
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from assetbuild.cli.progress import progress
from assetbuild.errors import UsageError
from assetbuild.pipeline.building import Request, build_all
from assetbuild.report.diff import changes, diff_markdown, diff_text
from assetbuild.report.sides import Side, bundle_side, config_side, foreign_side


def run(arguments: argparse.Namespace) -> int:
    """Print the changes; 0, or with `--exit-code` 1 when there are any."""
    names = (arguments.before, arguments.after)
    with tempfile.TemporaryDirectory(prefix="assetbuild-diff-") as folder:
        sides: list[Side | None] = [
            None if _config_of(name) else side_of(name, Path(folder, str(place)))
            for place, name in enumerate(names)
        ]
        known = next((side for side in sides if side is not None), None)
        before, after = (
            side or config_side(*(_config_of(name) or (Path(name), "")), known)
            for side, name in zip(sides, names, strict=True)
        )
        diff = changes(before, after)
    write = diff_markdown if arguments.markdown else diff_text
    print(write(before, after, diff), end="")
    return 1 if arguments.exit_code and diff.rows else 0


def _config_of(name: str) -> tuple[Path, str] | None:
    """(file, configuration) of `FILE.py` or `FILE.py:NAME`: Isaac Lab's; None for all else.

    Its patterns mean joints of the other side, so it is read after it.
    """
    file, _, config = name.rpartition(":") if ".py:" in name else (name, "", "")
    path = Path(file)
    return (path, config) if path.suffix == ".py" and path.is_file() else None


def side_of(name: str, folder: Path) -> Side:
    """Facts of whatever `name` names; recipes are built below `folder`."""
    path = Path(name)
    if path.is_dir():
        return bundle_side(path)
    if path.suffix in (".yaml", ".yml") and path.is_file():
        return _built(path, name, folder)
    if not path.exists() and ":" in name:
        revision, _, inside = name.partition(":")
        return _built(_checked_out(revision, inside, folder), name, folder)
    if not path.is_file():
        raise UsageError(f"there is no `{name}`")
    return foreign_side(path)


def _built(recipe: Path, name: str, folder: Path) -> Side:
    with progress(recipe.name) as shown:
        request = Request(recipe=recipe, out=folder / "bundle", fail_on="never")
        (outcome,) = build_all([request], shown.on_event, shown.say)
    if outcome.out is None:
        if outcome.errors:
            raise outcome.errors[0]
        raise UsageError(f"`{name}` was not built")
    return bundle_side(outcome.out, name)


def _checked_out(revision: str, inside: str, folder: Path) -> Path:
    """The recipe in a copy of the whole revision, so that its relative paths hold."""
    git = shutil.which("git")
    if git is None or revision.startswith("-"):
        raise UsageError(f"`{revision}:{inside}` needs git and a revision")
    words = [git, "rev-parse", "--show-toplevel", "--show-prefix"]
    top, _, prefix = subprocess.run(words, capture_output=True, text=True).stdout.partition("\n")
    if inside.startswith(("./", "../")):  # as git reads them: from here
        inside = posixpath.normpath(posixpath.join(prefix.strip(), inside))
    tree = folder / "revision"
    tree.mkdir(parents=True)
    archive = [git, "archive", "--format=tar", revision]
    packed = subprocess.run(archive, capture_output=True, cwd=top or None)
    if packed.returncode != 0:
        lines = packed.stderr.decode("utf-8", "replace").strip().splitlines()
        raise UsageError(f"git has no revision `{revision}`: {lines[-1] if lines else ''}")
    subprocess.run(["tar", "-x", "-C", str(tree)], input=packed.stdout, check=True)
    recipe = tree / inside
    if not recipe.is_file():
        raise UsageError(f"revision `{revision}` has no `{inside}`")
    print(f"{revision}:{inside} is built from a copy of that revision", file=sys.stderr)
    return recipe
