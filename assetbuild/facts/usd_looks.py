"""Materials: what shapes look like, and how their surfaces rub."""

from __future__ import annotations

from pathlib import Path

from pxr import Sdf, Usd, UsdShade

from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.picture import pixel_digest
from assetbuild.facts.table import Value, Writer
from assetbuild.facts.usd_prims import Prim

SURFACE = "UsdPreviewSurface"
BINDING = "MaterialBindingAPI"


class Looks:
    """The materials of a stage by path, read when the first shape asks for one."""

    def __init__(
        self, materials: list[Prim], shaders: list[Prim], book: Writer, known: KnownFiles
    ) -> None:
        self.book, self.known = book, known
        self.materials = {prim.path: prim for prim in materials}
        self.used: set[str] = set()
        self.colours: dict[str, tuple[float, ...]] = {}
        self.textures: dict[str, str] = {}
        self.surfaces: dict[str, dict[str, Value]] = {}
        self.names: dict[str, str] = {}
        for path, prim in self.materials.items():
            if prim.has("PhysicsMaterialAPI"):
                self.surfaces[path] = surface_material(prim)
            else:
                self.names[path] = prim.named("material")
                source = prim.source("outputs:surface")
                book.put("material", self.names[path], {"usd:surface source": source})
        for shader in shaders:
            self._shader(shader)

    def _shader(self, prim: Prim) -> None:
        """Each input as a word of the shader's kind; colour and picture are facts of shapes."""
        owner = next((p for p in self.names if prim.path.startswith(f"{p}/")), "")
        name = self.names.get(owner, prim.path)
        kind = prim.text("info:id") or prim.path
        ports = [key for key in prim.left if key.startswith(("inputs:", "outputs:"))]
        inputs = [key for key in ports if key.startswith("inputs:")]
        types = {key: str(prim.left[key].GetMetadata("typeName")) for key in ports}
        self.book.put("material", name, {f"usd:{kind}:type of {k}": t for k, t in types.items()})
        values: dict[str, object] = {}
        for key in inputs:
            source = prim.source(key)
            if source:
                self.book.put("material", name, {f"usd:{kind}:{key[7:]} source": source})
            values[key[7:]] = prim.take(key)
        if kind == SURFACE:
            colour = values.pop("diffuseColor", None)
            opacity = values.pop("opacity", None)
            self.colours[owner] = (*_numbers(colour), *_numbers(opacity))
        file = values.pop("file", None)
        if isinstance(file, Sdf.AssetPath):
            self.textures[owner] = _pixels(file, self.known)
        for key, value in values.items():
            if value is not None:
                self.book.put("material", name, {f"usd:{kind}:{key}": _plain(value)})

    def of(self, prim: Usd.Prim) -> dict[str, Value]:
        """Material of a visual shape; without one its own colour stays unread."""
        material, relation = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        path = str(material.GetPath()) if material else ""
        if path not in self.names:
            return {}
        self.used.add(path)
        return {
            "material": self.names[path],
            "rgba": self.colours.get(path),
            "texture": self.textures.get(path),
            "usd:binding strength": str(_strength(relation)),
        }

    def surface(self, prim: Usd.Prim) -> dict[str, Value]:
        """Physics material of a collision shape."""
        material, relation = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
        path = str(material.GetPath()) if material else ""
        if path not in self.surfaces:
            return {}
        self.used.add(path)
        return self.surfaces[path] | {"usd:binding strength": str(_strength(relation))}

    def unbound(self) -> None:
        """What no shape has, said of the material itself."""
        for path, name in self.names.items():
            if path not in self.used:
                self.book.put("material", name, {
                    "usd:rgba": self.colours.get(path), "usd:texture": self.textures.get(path),
                })  # fmt: skip
        for path in self.surfaces:
            if path not in self.used:
                self.book.skip(path, "prim", "a physics material that no shape has")


def take_bindings(prim: Prim) -> None:
    """What a prim binds: the materials that shapes end up with are compared."""
    for name in ("material:binding", "material:binding:physics"):
        prim.targets(name, BINDING)
        strength = prim.note(name, "bindMaterialAs")
        if strength is not None:
            prim.book.put("prim", prim.path, {f"usd:{name} bindMaterialAs": strength})


def _strength(relation: Usd.Relationship) -> object:
    return UsdShade.MaterialBindingAPI.GetMaterialBindingStrength(relation)


def surface_material(prim: Prim) -> dict[str, Value]:
    """Frictions and bounciness. Three numbers where Newton's are stated, else the sliding one."""
    schema = "PhysicsMaterialAPI"
    static = prim.number("physics:staticFriction", schema) or 0.0
    beyond = [prim.number(f"newton:{name}Friction", "NewtonMaterialAPI")
              for name in ("torsional", "rolling")]  # fmt: skip
    found: dict[str, Value] = {
        "friction": (static, *(value for value in beyond if value is not None)),
        "restitution": prim.number("physics:restitution", schema) or 0.0,
        "usd:dynamicFriction": prim.number("physics:dynamicFriction", schema) or 0.0,
    }
    mode = prim.text("physxMaterial:frictionCombineMode", "PhysxMaterialAPI")
    return found | {"usd:frictionCombineMode": mode} if mode else found


def _pixels(file: Sdf.AssetPath, known: KnownFiles) -> str:
    found = str(file.resolvedPath)
    return (pixel_digest(Path(found), known) if found else "") or f"unreadable {file.path}"


def _numbers(value: object) -> tuple[float, ...]:
    if value is None:
        return ()
    return (float(value),) if isinstance(value, int | float) else tuple(map(float, value))  # type: ignore[call-overload] # a Gf vector


def _plain(value: object) -> Value:
    if isinstance(value, bool | str | float | int):
        return float(value) if isinstance(value, int) and not isinstance(value, bool) else value
    try:
        return _numbers(value)
    except TypeError:
        return str(value)
