"""`inertia_from_geometry: {link, density | mass}`: exact mass properties of the link's shapes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from assetbuild.engine.step import Files, Limits
from assetbuild.errors import RecipeError, StepError
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.arrays import PARTS, read_meshes
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.primitives import volume_of
from assetbuild.mesh.triangles import cleaned, merged, solid_moments
from assetbuild.plugin_types import Edited, MassEdit, edit_inertials
from assetbuild.recipe_types import Positive
from assetbuild.robot.inertia import combine, mass_data, move_inertial, tensor_of
from assetbuild.robot.model import Body, Inertial, Tree
from assetbuild.robot.pose import vec3
from assetbuild.robot.shapes import (
    Box,
    Capsule,
    MeshFile,
    SourceGeometry,
    SourceShape,
    SourceShapes,
    Sphere,
)

INERTIA_FROM_GEOMETRY = Rule(
    "edit.inertia_from_geometry",
    "info",
    "mass properties were computed from the shapes of the link",
    "check the density",
)


class InertiaFromGeometry(MassEdit):
    """Solid, of one density: `density` for each shape, or `mass` for the link as a whole.

    A mesh must be closed; `open: hull` takes the convex hull of one that is not. Several shapes
    add up, also where they overlap.
    """

    isolated = True
    limits = Limits(wall_s=120.0)

    density: Positive | None = Field(None, description="kg/m3")
    mass: Positive | None = Field(None, description="kg, of the whole link")
    from_: Literal["visual", "collision"] = Field(
        "visual", alias="from", description="whose geometry"
    )
    open: Literal["refuse", "hull"] = Field("refuse", description="what to do with an open mesh")

    @model_validator(mode="after")
    def _one(self) -> InertiaFromGeometry:
        if (self.density is None) == (self.mass is None):
            raise ValueError("give exactly one of `density`, `mass`")
        return self

    def meshes(self, shapes: SourceShapes) -> tuple[SourceShape, ...]:
        """See `Edit`."""
        return tuple(
            shape
            for shape in shapes.of(self.from_)
            if isinstance(shape.geometry, MeshFile) and re.fullmatch(self.link, shape.link)
        )

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        folder_of = {
            shape.name: files.inputs / "mesh" / str(index)
            for index, shape in enumerate(self.meshes(shapes))
        }

        def change(body: Body) -> tuple[Inertial, Finding]:
            link_shapes = [shape for shape in shapes.of(self.from_) if shape.link == body.name]
            if not link_shapes:
                raise RecipeError(
                    f"inertia_from_geometry: link `{body.name}` has no {self.from_} geometry",
                    hint=f"try `from: {self._other()}`",
                )
            parts = [self._solid(shape, folder_of) for shape in link_shapes]
            volume = math.fsum(part.mass_kg for part in parts)
            density = self.density if self.density is not None else (self.mass or 0.0) / volume
            after = combine([_times(part, density) for part in parts])
            before = body.inertial or Inertial(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
            several = f" of {len(parts)} shapes, overlaps counted twice" if len(parts) > 1 else ""
            return after, INERTIA_FROM_GEOMETRY(
                f"link {body.name}",
                f"mass {before.mass_kg:.6g} -> {after.mass_kg:.6g} kg: {volume:.6g} m3"
                f"{several} at {density:.6g} kg/m3",
                data={
                    **mass_data(before, after),
                    "volume_m3": volume,
                    "density_kg_m3": density,
                    "stated": ("inertia", "mass"),
                },
            )

        tree, findings = edit_inertials(tree, self.link, change)
        return Edited(tree, shapes, findings)

    def _other(self) -> str:
        return "collision" if self.from_ == "visual" else "visual"

    def _solid(self, shape: SourceShape, folder_of: Mapping[str, Path]) -> Inertial:
        """Mass properties at density 1, in the link frame."""
        if isinstance(shape.geometry, MeshFile):
            return move_inertial(self._of_mesh(shape, folder_of[shape.name]), shape.X_link_shape)
        return move_inertial(of_primitive(shape.geometry), shape.X_link_shape)

    def _of_mesh(self, shape: SourceShape, folder: Path) -> Inertial:
        mesh = cleaned(merged([*read_meshes(folder / PARTS).values()]))
        if not mesh.is_closed:
            if self.open == "refuse":
                raise RecipeError(
                    f"inertia_from_geometry: the mesh of `{shape.name}` is open, "
                    "so it has no volume",
                    hint=f"`open: hull` takes its convex hull; or use `from: {self._other()}`",
                )
            try:
                mesh = convex_hull(mesh.vertices, subject=shape.name)
            except StepError as error:
                raise RecipeError(
                    f"inertia_from_geometry: {error.message}",
                    hint=f"take `from: {self._other()}`, or state it: edit `set_inertia`",
                ) from None
        volume, centre, inertia = solid_moments(mesh)
        if volume <= 0.0:
            raise RecipeError(f"inertia_from_geometry: the mesh of `{shape.name}` has no volume")
        return Inertial(volume, vec3(centre), tensor_of(inertia))


def of_primitive(geometry: SourceGeometry) -> Inertial:
    """A solid of density 1 about its own frame: textbook formulas; mass is the volume in m3."""
    if isinstance(geometry, MeshFile):
        raise TypeError("a mesh is no primitive")
    volume = volume_of(geometry)
    if isinstance(geometry, Box):
        x, y, z = (volume * edge * edge / 12.0 for edge in geometry.size)
        return Inertial(volume, (0.0, 0.0, 0.0), (y + z, x + z, x + y, 0.0, 0.0, 0.0))
    r = geometry.radius
    if isinstance(geometry, Sphere):
        about = 0.4 * volume * r * r
        return Inertial(volume, (0.0, 0.0, 0.0), (about, about, about, 0.0, 0.0, 0.0))
    tube = math.pi * r * r * geometry.length
    axial = tube * r * r / 2.0
    across = tube * (r * r / 4.0 + geometry.length**2 / 12.0)
    if isinstance(geometry, Capsule):
        # Two half balls: centroid 3/8 r from the flat side; about the capsule's middle.
        ball, half = volume - tube, geometry.length / 2.0
        axial += 0.4 * ball * r * r
        across += ball * (0.4 * r * r + half * half + 0.75 * half * r)
    return Inertial(volume, (0.0, 0.0, 0.0), (across, across, axial, 0.0, 0.0, 0.0))


def _times(part: Inertial, density: float) -> Inertial:
    xx, yy, zz, xy, xz, yz = (float(v) for v in density * np.asarray(part.inertia_com_kg_m2))
    return Inertial(density * part.mass_kg, part.com_m, (xx, yy, zz, xy, xz, yz))
