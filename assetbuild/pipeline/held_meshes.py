"""The robot's meshes and pictures, wherever in a bundle a file holds them as they were built."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.digest import digest_bytes
from assetbuild.facts.again.row import Row
from assetbuild.facts.again.tree import same
from assetbuild.facts.reference import Assets

LOOKS = (b"mtllib ", b"usemtl ")
"""First words of the lines that a URDF's copy of a mesh has before the mesh."""


@dataclass(frozen=True)
class Held:
    """One file. path: in the bundle, of the copy; edited: no copy is as it was built."""

    path: str
    data: bytes
    edited: bool


def held_meshes(bundle: Path, wanted: Mapping[str, str]) -> dict[str, Held]:
    """File -> the copy that is as it was built, else any. wanted: file -> its SHA-256."""
    copies: dict[str, list[Path]] = {}
    for path in sorted(path for path in bundle.rglob("*") if path.name in wanted):
        copies.setdefault(path.name, []).append(path)
    return {
        name: _best(bundle, found, wanted[name])
        for name, found in copies.items()
        if found and all(path.is_file() for path in found)
    }


def _best(bundle: Path, copies: list[Path], digest: str) -> Held:
    for path in copies:
        data = path.read_bytes()
        for content in (data, _without_looks(data)):
            if digest_bytes(content) == digest:
                return Held(path.relative_to(bundle).as_posix(), content, edited=False)
    first = copies[0]
    content = _without_looks(first.read_bytes())
    return Held(first.relative_to(bundle).as_posix(), content, edited=True)


def _without_looks(data: bytes) -> bytes:
    while data.startswith(LOOKS):
        data = data.partition(b"\n")[2]
    return data


def edited_rows(file: str, data: bytes, assets: Assets) -> Iterator[Row]:
    """What an edited mesh or picture shows otherwise than the one that was measured."""
    if file.endswith(".obj"):
        yield from _mesh_rows(file, data, assets)
        return
    from assetbuild.facts.surface import pixels_of

    expected, found = dict(assets.pixels).get(file, ""), pixels_of(data)
    if expected != found:
        yield Row("picture", file, "pixels", expected, found)


def _mesh_rows(file: str, data: bytes, assets: Assets) -> Iterator[Row]:
    from assetbuild.facts.surface import measure
    from assetbuild.mesh.obj import read_triangles

    name = file.removesuffix(".obj")
    mesh = read_triangles(data, file)
    theirs = measure(mesh.corners, mesh.uv).facts()
    ours = dict(assets.surfaces)[name].facts()
    for quantity in dict.fromkeys((*ours, *theirs)):
        one, other = ours.get(quantity), theirs.get(quantity)
        if not same(one, other):
            yield Row("mesh", name, quantity, one, other)
