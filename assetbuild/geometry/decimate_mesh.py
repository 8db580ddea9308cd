"""Fewer triangles for the eye, stopped where the shape would suffer."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding, Rule
from assetbuild.geometry.convert_mesh import write_converted
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.arrays import PARTS, read_meshes
from assetbuild.mesh.material import ConvertedMesh, MaterialPart
from assetbuild.mesh.quality import surface_distance
from assetbuild.mesh.simplify import simplified
from assetbuild.mesh.triangles import TriangleMesh, area, merged
from assetbuild.robot.codec import decode_file

AREA = (0.98, 1.02)
"""Area after / before. Quadric decimation eats thin parts and small components first: a ruined
mesh measured 0.18, clean ones 0.99 and more."""
P99 = 0.003
"""99 % of both surfaces within this share of the diagonal: 1.5 mm on a trunk of 0.5 m."""
FARTHEST = 0.02
"""No sample farther than this share of the diagonal: a clean calf measured 0.013, lost parts
0.04 and more."""
BOX = 0.005
"""No side of the box around it moves by more than this share of the diagonal: the tip of a
propeller is less than 1 % of its surface, which samples miss."""
DECIMALS = 7
"""Decimals of a metre: far below the error of decimation, and the text is half as long."""

DECIMATED = Rule(
    "visual.decimated",
    "info",
    "a mesh was simplified; the finding states distance and area",
    "raise `visual.max_faces` if it shows",
)
BUDGET = Rule(
    "visual.budget",
    "info",
    "simplification stopped early to keep the shape",
    "accept it, or simplify the source by hand",
)
TEXTURED = Rule(
    "visual.textured", "info", "a textured mesh was not simplified", "simplify the source by hand"
)


class _Attempt:
    """Meshes with fewer triangles; area: after / before; distance: between both surfaces."""

    def __init__(self, meshes: Sequence[TriangleMesh], before: Sequence[TriangleMesh]) -> None:
        new, old = merged(meshes), merged(before)
        self.meshes = meshes
        self.area = area(new) / area(old)
        self.distance = surface_distance(new, old)
        self.is_good = (
            AREA[0] < self.area < AREA[1]
            and self.distance.p99_m <= P99 * old.diagonal
            and self.distance.max_m <= FARTHEST * old.diagonal
            and np.abs(np.subtract(new.bounds, old.bounds)).max() <= BOX * old.diagonal
        )


class DecimateMesh(Step):
    """Quadric decimation by fast-simplification, shared by the parts in proportion.

    Gated: when the area or the two-sided distance says that the shape suffers, the goal is
    doubled until it does not. A mesh within the goal stays as it is.
    """

    shares = True
    usual_s = 0.3
    outputs = ("parts/", "mesh.json")
    isolated = True
    preload = MESH_MODULES
    limits: ClassVar[Limits] = Limits(wall_s=180.0, memory_mb=4096)

    max_faces: int = Field(ge=4)
    """The goal for the whole mesh."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Decimate `parts/` towards `max_faces`."""
        record = decode_file(ConvertedMesh, files.inputs / "mesh.json")
        if record.faces <= self.max_faces:
            _pass_on(files)
            return
        meshes = read_meshes(files.inputs / PARTS, surface=True)
        parts = [
            MaterialPart(material, mesh)
            for material, mesh in zip(record.materials, meshes.values(), strict=True)
        ]
        yield from _textured(parts)
        attempt = self._search([part.mesh for part in parts])
        if attempt is None:
            _pass_on(files)
            yield self._stopped(record.faces, record.faces, None)
            return
        out = [MaterialPart(p.material, m) for p, m in zip(parts, attempt.meshes, strict=True)]
        write_converted(files.outputs, out)
        for picture in sorted({m.texture for m in record.materials if m.texture}):
            shutil.copyfile(files.inputs / "parts" / picture, files.outputs / "parts" / picture)
        reached = sum(len(part.mesh.faces) for part in out)
        yield _decimated(record.faces, reached, attempt)
        if reached > self.max_faces:
            yield self._stopped(record.faces, reached, attempt)

    def _search(self, meshes: Sequence[TriangleMesh]) -> _Attempt | None:
        """The first goal, doubling, that keeps the shape; None when only the original does."""
        fixed = sum(len(mesh.faces) for mesh in meshes if mesh.uv is not None)
        total = sum(len(mesh.faces) for mesh in meshes) - fixed
        budget = max(self.max_faces - fixed, 4)
        while budget < total:
            share = budget / total
            made = [
                mesh
                if mesh.uv is not None
                else simplified(mesh, max(4, int(len(mesh.faces) * share)), DECIMALS)
                for mesh in meshes
            ]
            reached = sum(len(mesh.faces) for mesh in made) - fixed
            is_whole = all(len(mesh.faces) for mesh in made) and reached < total
            if is_whole and (attempt := _Attempt(made, meshes)).is_good:
                return attempt
            budget = max(2 * budget, reached)
        return None

    def _stopped(self, before: int, after: int, attempt: _Attempt | None) -> Finding:
        kept = f"keeps its {after} triangles, above the goal of {self.max_faces}: fewer would "
        kept += "change its shape"
        less = (
            f"stopped at {after} triangles, above the goal of {self.max_faces}, to keep the shape"
        )
        return BUDGET(
            "mesh",
            kept if after == before else less,
            hint=f"set `visual.max_faces` to {after} to accept it",
            data={
                "from": before,
                "to": after,
                "goal": self.max_faces,
                "area_ratio": None if attempt is None else round(attempt.area, 5),
            },
        )


def _textured(parts: Sequence[MaterialPart]) -> Iterator[Finding]:
    textured = [part for part in parts if part.mesh.uv is not None]
    if textured:
        faces = sum(len(part.mesh.faces) for part in textured)
        yield TEXTURED(
            "mesh",
            f"{len(textured)} textured parts with {faces} triangles are left as they "
            "are: decimation would lose their texture coordinates",
            data={"parts": len(textured), "faces": faces},
        )


def _decimated(before: int, after: int, attempt: _Attempt) -> Finding:
    p99 = 1e3 * attempt.distance.p99_m
    return DECIMATED(
        "mesh",
        f"{before} -> {after} triangles; 99 % of the surface within {p99:.2g} mm, "
        f"area x {attempt.area:.4f}",
        data={
            "from": before,
            "to": after,
            "p99_mm": round(p99, 4),
            "max_mm": round(1e3 * attempt.distance.max_m, 4),
            "mean_mm": round(1e3 * attempt.distance.mean_m, 4),
            "area_ratio": round(attempt.area, 5),
        },
    )


def _pass_on(files: Files) -> None:
    """All as it is."""
    shutil.copytree(files.inputs / "parts", files.outputs / "parts")
    shutil.copyfile(files.inputs / "mesh.json", files.outputs / "mesh.json")
