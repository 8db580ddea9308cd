"""The recipe's patches as steps between the files of the source and whoever reads them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.engine.world import World
from assetbuild.errors import RecipeError, Where, did_you_mean
from assetbuild.recipe.loader import read_small_file, shown_path
from assetbuild.recipe.source import Patch
from assetbuild.recipe.validation import Key, KeyedError
from assetbuild.source.patch_text import PatchText

_HUNK = re.compile(r"@@ -\d+(?:,(\d+))? \+\d+(?:,(\d+))? @@")


Passages = dict[str, tuple[Key, PatchText]]
"""(key of its patch in the recipe, one replacement) by the label of its node."""


def patch_keys(patches: Sequence[Patch], folder: Path, world: World) -> dict[str, Key]:
    """Key in the recipe of each passage's node, by label."""
    return {label: key for label, (key, _) in passages(patches, folder, world).items()}


def passages(patches: Sequence[Patch], folder: Path, world: World) -> Passages:
    """All of them in order. RecipeError for a diff that is none. folder: of the recipe."""
    made: Passages = {}
    for index, patch in enumerate(patches):
        own = patch.model_dump(exclude={"diff"}) if patch.diff is None else {}
        for step in [PatchText(**own)] if own else _of_diff(patch, folder, world):
            made[f"patch {len(made) + 1} {step.file}"] = ("source", "patches", index), step
    return made


def patched(patches: Passages, texts: Mapping[str, Ref], p: Planner) -> dict[str, Ref]:
    """The texts by path, each behind its patches. KeyedError for a patch of no such text."""
    now = dict(texts)
    for label, (key, step) in patches.items():
        if step.file not in now:
            message = f"`{step.file}` is no text that is read of the source"
            raise KeyedError(key, message, did_you_mean(step.file, now))
        now[step.file] = p.add(label, step, {"text": now[step.file]})["text"]
    return now


# --- unified diffs --------------------------------------------------------------------------


def _of_diff(patch: Patch, folder: Path, world: World) -> list[PatchText]:
    path = Path(os.path.normpath(folder / str(patch.diff)))
    file = shown_path(path)
    data = read_small_file(path, RecipeError, world)
    steps = list(_hunks(data.decode("utf-8", "replace"), file, patch.because))
    if not steps:
        hint = "write it by `diff -u OLD NEW` or `git diff`"
        raise RecipeError("no hunk of a unified diff", where=Where(file), hint=hint)
    return steps


def _hunks(text: str, file: str, because: str) -> Iterator[PatchText]:
    """Yield a replacement of the old lines by the new ones for each hunk."""
    name, lines = "", text.splitlines(keepends=True)
    at = 0
    while at < len(lines):
        line, at = lines[at], at + 1
        if line.startswith("+++ "):
            path = line[4:].partition("\t")[0]  # +++ b/urdf/arm.urdf<tab>date
            name = path.strip().removeprefix("b/")
        if not (head := _HUNK.match(line)):
            continue
        where, body = Where(file, at), list[str]()
        old, new = int(head[1] or 1), int(head[2] or 1)
        while at < len(lines) and (old > 0 or new > 0 or lines[at].startswith("\\")):
            line, at = lines[at], at + 1
            if body and line.startswith("\\"):  # the line before has no line end
                body[-1] = body[-1].rstrip("\n")
                continue
            line = " \n" if line == "\n" else line  # an editor removed its blank
            old -= line[0] in " -"
            new -= line[0] in " +"
            body.append(line)
        find = "".join(line[1:] for line in body if line[0] in " -")
        replace = "".join(line[1:] for line in body if line[0] in " +")
        if old or new or not name:
            raise RecipeError("the diff is cut off or names no file", where=where)
        if not find:
            hint = "write the diff with lines around the change (`diff -U3`)"
            raise RecipeError("a hunk without old lines has no place", where=where, hint=hint)
        yield PatchText(file=name, find=find, replace=replace, because=because)
