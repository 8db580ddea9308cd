"""Materials: how surfaces rub, and the colour and the texture of visual shapes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Sdf, Usd, UsdShade

from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.picture import pixel_digest
from assetbuild.facts.table import Value
from assetbuild.facts.usd_prims import Prim


@dataclass(frozen=True)
class Looks:
    """Materials as shapes are bound to them. known: pictures whose digests are known."""

    known: KnownFiles
    materials: dict[str, dict[str, Value]] = field(default_factory=dict)

    def of(self, shape: Usd.Prim) -> dict[str, Value]:
        """Colour and texture of a visual shape; nothing where no material is bound to it."""
        material, _ = UsdShade.MaterialBindingAPI(shape).ComputeBoundMaterial()
        if not material:
            return {}
        path = str(material.GetPath())
        if path not in self.materials:
            self.materials[path] = self._shown(material)
        return self.materials[path]

    def _shown(self, material: UsdShade.Material) -> dict[str, Value]:
        """Nothing of a material whose output leads to no shader: a viewer draws it grey."""
        if not material.ComputeSurfaceSource()[0]:
            return {}
        facts: dict[str, Value] = {"material": Prim(material.GetPrim()).name}
        for shader in _shaders(material):
            kind = shader.text("info:id")
            if kind == "UsdPreviewSurface":
                colour = shader.numbers("inputs:diffuseColor") or ()
                facts["rgba"] = (*colour, *(shader.numbers("inputs:opacity") or (1.0,)))
                gloss = ("roughness", "metallic")
                facts["usd:gloss"] = tuple(shader.number(f"inputs:{n}") or 0.0 for n in gloss)
            file = shader.value("inputs:file")
            if kind == "UsdUVTexture" and isinstance(file, Sdf.AssetPath):
                facts["texture"] = self._pixels(file)
        return facts

    def _pixels(self, file: Sdf.AssetPath) -> str:
        found = str(file.resolvedPath)
        digest = pixel_digest(Path(found), self.known) if found else ""
        return digest or f"unreadable {file.path}"


def _shaders(material: UsdShade.Material) -> Iterator[Prim]:
    below = (Prim(prim) for prim in Usd.PrimRange(material.GetPrim()))
    return (prim for prim in below if prim.prim.IsA(UsdShade.Shader))


def surface_of(shape: Usd.Prim) -> dict[str, Value]:
    """Friction and restitution of a collision shape, of the physics material bound to it.

    friction has three numbers where Newton's are stated, else the sliding one alone.
    """
    material, _ = UsdShade.MaterialBindingAPI(shape).ComputeBoundMaterial("physics")
    if not material:
        return {}
    prim = Prim(material.GetPrim())
    if not prim.has("PhysicsMaterialAPI"):
        return {}
    beyond = [prim.number(f"newton:{name}Friction", "NewtonMaterialAPI")
              for name in ("torsional", "rolling")]  # fmt: skip
    sliding = prim.number("physics:staticFriction") or 0.0
    facts: dict[str, Value] = {
        "friction": (sliding, *(value for value in beyond if value is not None)),
        "restitution": prim.number("physics:restitution") or 0.0,
        "usd:dynamicFriction": prim.number("physics:dynamicFriction") or 0.0,
    }
    mode = prim.text("physxMaterial:frictionCombineMode", "PhysxMaterialAPI")
    return facts | {"usd:frictionCombineMode": mode or "average"}
