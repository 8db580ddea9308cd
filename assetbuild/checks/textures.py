"""Does every shape wear its own picture? By content, per shape, in the MJCF and in the USD."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.shapes import Shapes

EXCHANGED = Rule(
    "texture.exchanged",
    "warning",
    "a shape wears the picture of another material, compared with the source or the robot",
    "look at the materials in the source; if only one format is wrong, report it: this is a bug",
)
VISUALS = "visuals"
"""Group below each body of the USD that holds its visual shapes."""


class Textures(Check):
    """Findings `texture.exchanged`; figures: how many shapes of each format wear a picture.

    Robot and formats are compared by the content of the picture. The source is compared by the
    name of the picture that each link's materials state, which the robot's file names keep.
    """

    isolated = True
    preload = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")
    needs = ("source",)
    also: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads = ("shapes.json", "meshes/")

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the shapes, the pictures, `source.urdf`, and the formats that were built."""
        robot = RobotFiles(files.inputs)
        textures = {m.name: m.texture for m in robot.shapes.materials if m.texture}
        figures: dict[str, object] = {"materials": len(textures)}
        if textures:
            yield from _against_source(robot.shapes, files.inputs / "source.urdf")
            wanted = {
                shape.name: _digest(robot.mesh_dir / textures[shape.material])
                for shape in robot.shapes.of("visual")
                if shape.material in textures
            }
            materials = {s.name: s.material or "" for s in robot.shapes.of("visual")}
            mjcf = files.inputs / "mjcf" / f"{self.robot}.xml"
            usd = files.inputs / "usd" / f"{self.robot}.usda"
            for name, path, read in (("MJCF", mjcf, _in_mjcf), ("USD", usd, _in_usd)):
                if path.is_file():
                    worn = {shape: digest for shape, digest in read(path).items() if digest}
                    figures[name] = len(worn)
                    yield from _compare(name, wanted, worn, materials)
        write_figures(files, figures)


def _compare(
    where: str, wanted: Mapping[str, str], worn: Mapping[str, str], materials: Mapping[str, str]
) -> Iterator[Finding]:
    """One finding for each material of which a shape wears another picture."""
    owner = {digest: materials[shape] for shape, digest in list(wanted.items())[::-1]}
    wrong: dict[str, list[str]] = {}
    for shape, digest in wanted.items():
        if worn.get(shape, digest) != digest:
            wrong.setdefault(materials[shape], []).append(shape)
    for material, shapes in wrong.items():
        other = owner.get(worn[shapes[0]])
        what = f"the picture of `{other}`" if other else "a picture that the robot does not have"
        yield EXCHANGED(
            f"material {material}",
            f"in the {where} it shows {what}, on {len(shapes)} shapes such as `{shapes[0]}`",
            hint="compare the file with the robot's; a rebuilt bundle has the right one",
            data={"shapes": len(shapes)},
        )


def _against_source(shapes: Shapes, source: Path) -> Iterator[Finding]:
    """Pictures that the description's own materials name, link by link."""
    stated = _stated(source)
    known = {stem for stems in stated.values() for stem in stems}
    textures = {m.name: m.texture for m in shapes.materials if m.texture}
    told: set[tuple[str, str]] = set()
    for shape in shapes.of("visual"):
        texture = textures.get(shape.material or "")
        stems = stated.get(shape.link)
        if texture is None or not stems or _names_of(texture) & stems:
            continue
        if _names_of(texture) & known and (shape.link, texture) not in told:
            told.add((shape.link, texture))
            yield EXCHANGED(
                f"material {shape.material}",
                f"`{shape.link}` shows `{texture}`, but its materials in the source name "
                f"{', '.join(f'`{stem}`' for stem in sorted(stems))}",
                hint="are two textures exchanged?",
                data={"link": shape.link},
            )


def _stated(source: Path) -> dict[str, set[str]]:
    """Names of pictures, without folder and ending, by link."""
    from defusedxml.ElementTree import fromstring

    root = fromstring(source.read_bytes())
    named = {m.get("name"): m.find("texture") for m in root.findall("material")}
    found: dict[str, set[str]] = {}
    for link in root.findall("link"):
        for material in link.findall("visual/material"):
            texture = material.find("texture")
            texture = named.get(material.get("name")) if texture is None else texture
            file = texture.get("filename") if texture is not None else None
            if file:
                stem = _plain(PurePosixPath(file).stem)
                found.setdefault(str(link.get("name")), set()).add(stem)
    return found


def _names_of(texture: str) -> set[str]:
    """What a picture may be called in a source: `skin-3f2a91c0` is `skin` there, or itself."""
    stem = PurePosixPath(texture).stem
    return {_plain(stem), _plain(stem.rpartition("-")[0] or stem)}


def _plain(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]+", "_", stem)


def _digest(path: Path) -> str:
    """Return the SHA-256 of the content; "" where there is no file."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def _in_mjcf(path: Path) -> dict[str, str]:
    """Digest of the picture on each geom, by name."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    role = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
    folder = path.parent / (spec.texturedir or spec.meshdir or "")
    files = {texture.name: texture.file for texture in spec.textures}
    pictures = {
        material.name: files.get(material.textures[role] or "", "") for material in spec.materials
    }
    worn = {geom.name: pictures.get(geom.material, "") for geom in spec.geoms}
    return {name: _digest(folder / file) if file else "" for name, file in worn.items()}


def _in_usd(path: Path) -> dict[str, str]:
    """Digest of the picture on each visual shape, by name."""
    from pxr import Usd, UsdShade

    stage = Usd.Stage.Open(str(path))
    found = {}
    for prim in stage.Traverse():
        if prim.GetParent().GetName() == VISUALS:
            name = str(prim.GetMetadata("displayName") or prim.GetName())
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
            found[name] = _picture_of(material.GetPrim()) if material else ""
    return found


def _picture_of(material: Any) -> str:  # Any: Usd.Prim
    for shader in material.GetChildren():
        picture = shader.GetAttribute("inputs:file").Get()
        if picture is not None:
            return _digest(Path(picture.resolvedPath)) if picture.resolvedPath else ""
    return ""
