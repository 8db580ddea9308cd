"""Put the built meshes and collision pieces in the places of the source's geometry."""

from __future__ import annotations

import functools
import hashlib
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from assetbuild.collision import read_pieces
from assetbuild.engine.step import Files, Step
from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.arrays import PARTS, read_meshes, write_meshes
from assetbuild.mesh.material import ConvertedMesh, SurfaceMaterial
from assetbuild.mesh.obj import obj_bytes
from assetbuild.mesh.picture import mean_colour, picture_name
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.shapes import (
    Geometry,
    Material,
    Mesh,
    MeshAsset,
    MeshFile,
    Role,
    Shape,
    Shapes,
    SourceShape,
    SourceShapes,
)

PNG = "texture.png"
"""What `convert_texture` writes."""
WHITE = (1.0, 1.0, 1.0, 1.0)
"""Under a texture: it is shown as it is."""

# Links that show the same mesh share its arrays and its text.
_parts = functools.lru_cache(16)(functools.partial(read_meshes, surface=True))
_text = functools.lru_cache(16)(obj_bytes)

TEXTURE_MISSING = Rule(
    "texture.missing",
    "warning",
    "a texture of the description is not in the source",
    "add the file",
)
NO_COORDINATES = Rule(
    "texture.no_coordinates",
    "warning",
    "a textured material is on a primitive, or on a mesh without texture coordinates",
    "use a mesh with texture coordinates; until then it has the mean colour of the picture",
)
OWN_MATERIAL = Rule(
    "material.of_mesh",
    "info",
    "a mesh file brings its own materials, which override the URDF's, as in RViz; MuJoCo and "
    "PyBullet use the URDF's colour",
    "remove the one that is not meant",
)
NO_COLLISION = Rule(
    "collision.none",
    "info",
    "links that have geometry have no collision geometry here",
    "change the rule of the link if it should collide",
)


@dataclass(frozen=True)
class Use:
    """What `link` is seen by or hits with, in order of preference of what is set.

    pieces: folder with the result of a collision method, in the frame of `shape` when that is
    set, else in the link's. mesh: folder of a converted mesh, taken as it is. Neither: the
    primitive `shape` of the source, as it is. named: what is made of one shape of the source of
    that role keeps its name, as the shapes of an MJCF do; else it is called after link and role.
    """

    link: str
    role: Role
    shape: str | None = None
    pieces: str | None = None
    mesh: str | None = None
    stem: str = ""
    named: bool = False


class Assemble(Step):
    """Source shapes + meshes + pieces -> the final shapes, file paths swapped for digests."""

    shares = True
    outputs = ("shapes.json", "meshes/", "triangles.npz")

    uses: tuple[Use, ...]
    textures: tuple[str, ...] = ()
    """Pictures that the source's materials name; `textures/<n>/` holds one if it can be read."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `shapes.json` of the source and the folders that the fields name."""
        source = RobotFiles(files.inputs).source_shapes
        by_name = {shape.name: shape for shape in source.shapes}
        library = _Library(files.outputs / "meshes")
        folder = files.inputs / "textures"
        pictures = {name: folder / str(n) / PNG for n, name in enumerate(self.textures)}
        palette = _Palette(source.materials, pictures, library)
        shapes: list[Shape] = []
        for use in self.uses:
            origin = by_name[use.shape] if use.shape else None
            made = _built(use, origin, files.inputs, library, palette)
            # Collision made of a visual shape does not take its name, which that one has already.
            is_own = origin is not None and origin.role == use.role
            shapes += called(made, use.shape if is_own and use.named else None)
        final = Shapes(_named(shapes), palette.used(), library.assets())
        (files.outputs / "shapes.json").write_bytes(encode(final))
        meshes = {asset.name: library.meshes[asset.name] for asset in final.meshes}
        write_meshes(files.outputs / "triangles.npz", meshes)
        yield from palette.findings
        yield from _without_collision(source, self.uses)


def called(made: list[Shape], source: str | None) -> list[Shape]:
    """Give them the source's name where that is wanted, numbered from the second piece on.

    What ends in `_collision` goes on doing so: that is how configs of trainers find it.
    """
    if source is None:
        return made
    stem, _, end = source.rpartition("_collision")
    kept = bool(stem) and (end.isdigit() or not end)
    names = [
        f"{stem}_{number}_collision{end}" if kept else f"{source}_{number}"
        for number in range(2, len(made) + 1)
    ]
    return [replace(s, name=name) for s, name in zip(made, [source, *names], strict=True)]


def _without_collision(source: SourceShapes, uses: tuple[Use, ...]) -> Iterator[Finding]:
    """One finding for all links that have geometry in the source and hit nothing here."""
    covered = {use.link for use in uses if use.role == "collision"}
    bare = [link for link in dict.fromkeys(s.link for s in source.shapes) if link not in covered]
    if bare:
        yield NO_COLLISION(
            "recipe collision",
            f"links with geometry but without collision geometry, {len(bare)}: {quoted(bare, 6)}",
            hint="their rule says `none`, or the geometry that it asks for is not in the source",
            data={"links": len(bare)},
        )


def _built(
    use: Use, shape: SourceShape | None, inputs: Path, library: _Library, palette: _Palette
) -> list[Shape]:
    X_link_source = shape.X_link_shape if shape else IDENTITY
    made: list[tuple[Geometry, Pose, str | None]] = []
    if use.pieces is not None:
        for piece in read_pieces(inputs / use.pieces):
            geometry: Geometry | TriangleMesh = piece.solid
            if isinstance(geometry, TriangleMesh):
                geometry = Mesh(library.add(geometry, use.stem, convex=True))
            made.append((geometry, X_link_source @ piece.X_frame_piece, None))
    elif shape is not None and use.mesh is not None:
        folder = inputs / use.mesh
        looks = decode_file(ConvertedMesh, folder / "mesh.json").materials
        for look, mesh in zip(looks, _parts(folder / PARTS).values(), strict=True):
            uv = mesh.uv is not None
            material = palette.of_mesh(use, shape, look, folder / "parts", uv=uv)
            made.append((Mesh(library.add(mesh, use.stem)), X_link_source, material))
    elif shape is not None and not isinstance(shape.geometry, MeshFile):
        material = palette.of_source(use, shape, uv=False)
        made.append((shape.geometry, X_link_source, material))
    return [Shape("", use.link, use.role, *one) for one in made]


def _named(shapes: list[Shape]) -> tuple[Shape, ...]:
    """`FR_foot_collision` when the link has one, `trunk_collision1`, `...2` when it has more.

    A name that a shape already has stays; a second shape cannot take it.
    """
    taken = {shape.name for shape in shapes if shape.name}
    totals = Counter((shape.link, shape.role) for shape in shapes)
    seen: Counter[tuple[str, str]] = Counter()
    named = []
    for shape in shapes:
        key = (shape.link, shape.role)
        seen[key] += 1
        number = str(seen[key]) if totals[key] > 1 else ""
        name = shape.name or f"{shape.link}_{shape.role}{number}"
        while not shape.name and name in taken:
            name += "_"
        named.append(replace(shape, name=name))
    return tuple(named)


class _Library:
    """Mesh files of the bundle, each content once. meshes: what they hold, by the asset's name."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        self.meshes: dict[str, TriangleMesh] = {}
        self._folder = folder
        self._by_digest: dict[str, MeshAsset] = {}

    def add(self, mesh: TriangleMesh, stem: str, *, convex: bool = False) -> str:
        """Name of the asset with this mesh; the first user gives it its stem."""
        text = _text(mesh)
        digest = hashlib.sha256(text).hexdigest()
        if digest not in self._by_digest:
            name = f"{re.sub(r'[^A-Za-z0-9_]+', '_', stem) or 'mesh'}-{digest[:8]}"
            vertices, faces = len(mesh.vertices), len(mesh.faces)
            asset = MeshAsset(name, f"{name}.obj", vertices, faces, convex)
            (self._folder / asset.file).write_bytes(text)
            self._by_digest[digest] = asset
            self.meshes[name] = mesh
        return self._by_digest[digest].name

    def add_picture(self, path: Path, name: str) -> str:
        """The name of the picture, which tells its content."""
        if not (self._folder / name).exists():
            shutil.copyfile(path, self._folder / name)
        return name

    def assets(self) -> tuple[MeshAsset, ...]:
        """All assets, by name."""
        return tuple(sorted(self._by_digest.values(), key=lambda asset: asset.name))


class _Palette:
    """Materials of the source and of its meshes: one name, one look.

    pictures: texture of the source -> its PNG, which is not there when it could not be read.
    """

    def __init__(
        self, source: tuple[Material, ...], pictures: Mapping[str, Path], library: _Library
    ) -> None:
        self._source = {material.name: material for material in source}
        self._pictures, self._library = pictures, library
        self._used: dict[str, Material] = {}
        self._texture_findings: dict[tuple[str, str], Finding] = {}
        self._own: list[str] = []

    def of_source(self, use: Use, shape: SourceShape, *, uv: bool) -> str | None:
        """The material that the description gives; None stays None, as for what is not seen.

        uv: does the shape have texture coordinates? Without them no texture can lie on it, and it
        has the mean colour of the picture; the colour of an MJCF stays as it is.
        """
        material = self._source.get(shape.material) if shape.material is not None else None
        if material is None or use.role != "visual":
            return None
        stated = material.texture
        png = self._pictures.get(stated or "")
        shown = replace(material, texture=None)
        if stated is not None and png is None:
            self._tell(TEXTURE_MISSING, material, "is not in the source", "add the file")
        elif stated is not None and png is not None and png.is_file():  # else its step says why
            data = png.read_bytes()
            if uv:
                name = self._library.add_picture(png, picture_name(stated, data))
                return self._take(replace(material, texture=name))
            what = "lies on shapes without texture coordinates: they get one colour"
            self._tell(NO_COORDINATES, material, what, "use a mesh with coordinates")
            if not use.named:
                pairs = zip(material.rgba, mean_colour(data), strict=False)
                r, g, b = (own * average for own, average in pairs)
                shown = replace(shown, rgba=(r, g, b, material.rgba[3]))
        return self._take(shown)

    def of_mesh(
        self, use: Use, shape: SourceShape, look: SurfaceMaterial, folder: Path, *, uv: bool
    ) -> str | None:
        """The material inside the mesh file, with its picture in `folder`, else the description's.

        uv: as in `of_source`.
        """
        own = self._of_part(look, folder) if use.role == "visual" else None
        if own and not use.named and shape.material in self._source:
            self._own.append(shape.name)
        return own or self.of_source(use, shape, uv=uv)

    def _of_part(self, look: SurfaceMaterial, folder: Path) -> str | None:
        """The material inside the mesh file, when it has a colour or a texture in `folder`."""
        texture = look.texture
        if texture is not None:
            self._library.add_picture(folder / texture, texture)
        elif look.rgba is None:
            return None
        return self._take(Material(look.name or "material", look.rgba or WHITE, texture))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Textures and materials of the source that are not shown, each once."""
        names = list(dict.fromkeys(self._own))
        if not names:
            return tuple(self._texture_findings.values())
        message = f"the meshes of {len(names)} shapes bring materials of their own, which count "
        message += f"instead of the URDF's: {quoted(names, 4)}"
        return (
            *self._texture_findings.values(),
            OWN_MATERIAL("robot", message, data={"shapes": len(names)}),
        )

    def _tell(self, rule: Rule, material: Material, what: str, hint: str) -> None:
        key = (rule.id, material.name)
        message = f"its texture `{material.texture}` {what}"
        subject = f"material {material.name}"
        self._texture_findings[key] = rule(
            subject, message, hint, data={"texture": material.texture or ""}
        )

    def used(self) -> tuple[Material, ...]:
        """The materials in use, in order of first use."""
        return tuple(self._used.values())

    def _take(self, material: Material) -> str:
        name, number = material.name, 1
        while name in self._used:
            known = self._used[name]
            if (known.rgba, known.texture) == (material.rgba, material.texture):
                return name
            number += 1
            name = f"{material.name}_{number}"
        self._used[name] = Material(name, material.rgba, material.texture)
        return name
