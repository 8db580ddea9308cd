"""The comparer of a file, by its ending."""

from __future__ import annotations

import os
from pathlib import Path

from assetbuild.facts.again.row import Row


def rows_of(again: Path, there: Path, stages: tuple[Path, ...] = ()) -> list[Row]:
    """What two files say differently; none where they mean the same. NotParsedError.

    Each lies in a folder of its own, among the same other files. stages: the files of USD that a
    layer may be part of, in the folder of `again`.
    """
    ending = there.suffix.lower()
    if ending in (".xml", ".urdf"):
        return _xml(again, there)
    if ending in (".usda", ".usdc", ".usd"):
        from assetbuild.facts.again.usd import usd_rows  # pxr takes a second, which only USD needs

        roots = tuple(os.path.relpath(stage, again.parent) for stage in stages)
        return usd_rows(again, there, roots)
    if ending == ".py":
        from assetbuild.facts.again.python import python_rows

        return python_rows(again.read_bytes(), there.read_bytes())
    if ending in (".yaml", ".yml", ".json", ".xrdf"):
        from assetbuild.facts.again.keys import key_rows

        return key_rows(again.read_bytes(), there.read_bytes())
    if ending in (".obj", ".mtl"):
        from assetbuild.facts.again.mesh import mesh_rows

        return mesh_rows(again, there)
    if ending in (".png", ".jpg", ".jpeg"):
        from assetbuild.facts.again.picture import picture_rows

        return picture_rows(again, there)
    return _lines(again, there)


def _xml(again: Path, there: Path) -> list[Row]:
    from assetbuild.facts.again.mjcf import is_mjcf, mjcf_rows
    from assetbuild.facts.again.xml import xml_rows

    if is_mjcf(there.read_bytes()):
        return mjcf_rows(again, there)
    return xml_rows(again.read_bytes(), there.read_bytes())


def _lines(again: Path, there: Path) -> list[Row]:
    """A kind of file that is known to nobody here: the first line that differs."""
    ours, theirs = again.read_bytes().splitlines(), there.read_bytes().splitlines()
    for number in range(max(len(ours), len(theirs))):
        one, other = (_line(lines, number) for lines in (ours, theirs))
        if one != other:
            return [Row("file", there.name, f"line {number + 1}", one, other, number + 1)]
    return []


def _line(lines: list[bytes], number: int) -> str | None:
    return lines[number].decode("utf-8", "replace")[:200] if number < len(lines) else None
