"""`assetbuild init`: look at a robot, write a commented recipe that builds.

Everything is decided here once, in the open: each choice stands in the recipe with its reason
beside it, and a build never guesses.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path

from assetbuild.errors import MachineError, SourceError, UsageError, Where, quoted
from assetbuild.init.anatomy import study
from assetbuild.init.draft import Proposal
from assetbuild.init.home import on_its_legs
from assetbuild.init.look import judge, look
from assetbuild.init.mjcf import find_mjcf, is_mjcf, mjcf_recipe
from assetbuild.init.sections import recipe_name, urdf_recipe
from assetbuild.init.source import find_source, mended
from assetbuild.recipe.loader import read_small_file, shown_path

DESCRIPTIONS = (".urdf", ".urdf.xacro")
MOST_LOOKED_AT = 20_000
"""Files below a folder among which descriptions are looked for: it may be a whole disk."""
NO_DESCRIPTIONS = {
    (".zip", ".gz", ".tgz", ".tar", ".bz2", ".xz"): "unpack it and name the file in it; its recipe "
    "may then say `source: {path: ARCHIVE, root: FOLDER}`",
    (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf", ".step", ".stp"): "a mesh states no joints "
    "and no masses: name the description that refers to it",
    (".usd", ".usda", ".usdc", ".usdz"): "a USD is written, not read: start from the description "
    "that it was made of; `assetbuild validate` and `diff` read a USD",
    (".sdf", ".world"): "convert it to URDF first",
    (".yaml", ".yml"): "a recipe is built as it is: `assetbuild build`",
}
"""Endings of files that hold no description which `init` reads, and what to do."""


def propose(
    file: Path,
    out: Path | None,
    packages: Mapping[str, Path],
    args: Mapping[str, str] | None = None,
) -> Proposal:
    """Look at the robot and word its recipe; writes nothing.

    out: default `<robot>.yaml` in the working folder; paths in the recipe are relative to its
    folder. packages: package:// name -> folder, as the user says; the others are looked for
    upwards from the file. args: of a xacro file. Raises SourceError with file and line for a
    description that no recipe can save.
    """
    _refuse_what_is_no_description(file)
    if is_mjcf(read_small_file(file, SourceError)):
        mjcf = find_mjcf(file)
        path = out or Path(f"{recipe_name(mjcf.robot.links.name)}.yaml")
        return mjcf_recipe(mjcf, path)
    source = mended(find_source(file, packages, args or {}))
    robot = look(source)
    anatomy = on_its_legs(robot.tree, study(robot))
    robot = judge(robot, anatomy.base)
    path = out or Path(f"{recipe_name(robot.links.name)}.yaml")
    return urdf_recipe(robot, anatomy, source, path)


def _refuse_what_is_no_description(file: Path) -> None:
    """SourceError that names the way on from a folder, an archive, a mesh or an address."""
    wanted = "a .urdf, .xacro or .xml file"
    if file.is_dir():
        looked_at = itertools.islice(file.rglob("*"), MOST_LOOKED_AT)
        below = sorted(path for path in looked_at if path.name.endswith(DESCRIPTIONS))
        names = quoted(map(shown_path, below), 3, " and {} more")
        hint = f"name one of its files: {names}" if below else f"name {wanted}"
        raise SourceError("this is a folder", where=Where(shown_path(file)), hint=hint)
    hint = next(
        (hint for words, hint in NO_DESCRIPTIONS.items() if file.name.lower().endswith(words)), ""
    )
    if hint or str(file).startswith(("http:", "https:", "git@")):
        hint = hint or f"clone or download it, then name {wanted}"
        raise SourceError(f"`init` reads {wanted}", where=Where(shown_path(file)), hint=hint)


def write(proposal: Proposal, *, force: bool) -> None:
    """Write the recipe and the folder it lies in; `force` replaces an existing file."""
    where = Where(shown_path(proposal.path))
    try:
        proposal.path.parent.mkdir(parents=True, exist_ok=True)
        with proposal.path.open("w" if force else "x", encoding="utf-8") as file:
            file.write(proposal.text)
    except FileExistsError:
        if not proposal.path.exists():  # a file stands where the folder should be
            hint = "give another file to `-o`"
            raise UsageError("its folder cannot be made", where=where, hint=hint) from None
        hint = "`--force` replaces it, `-o FILE` writes another"
        raise UsageError("this file exists", where=where, hint=hint) from None
    except OSError as problem:
        raise MachineError(f"cannot be written: {problem.strerror}", where=where) from None
