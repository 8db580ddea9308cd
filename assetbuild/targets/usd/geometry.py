"""What is seen: the mesh library, its instances, primitives and materials."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from assetbuild.errors import StepError
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.model import (
    Box,
    Capsule,
    Cylinder,
    Geometry,
    Material,
    Mesh,
    Shape,
    Shapes,
    Sphere,
)
from assetbuild.robot.pose import Array, Pose, Vec3
from assetbuild.simulators.usd_names import LOOKS
from assetbuild.targets.usd.layers import GEOMETRIES, label, new_layer, new_stage, place, save
from assetbuild.targets.usd.names import VISUALS, Names

if TYPE_CHECKING:
    from pxr import Usd

ONE: Vec3 = (1.0, 1.0, 1.0)
LIBRARY = "/Geometries"


def write_library(folder: Path, names: Names, shapes: Shapes, mesh_dir: Path) -> None:
    """`geometries.usdc`: `/Geometries/<asset>/mesh` for each asset, no more than once.

    An instance needs a parent to share, a collider the mesh itself: hence the two levels.
    """
    from pxr import UsdGeom

    stage = new_stage(folder / GEOMETRIES)
    library = UsdGeom.Scope.Define(stage, LIBRARY)
    stage.SetDefaultPrim(library.GetPrim())
    for asset in shapes.meshes:
        path = f"{LIBRARY}/{names.assets[asset.name]}"
        # No displayName here: it would come through the reference and name the shapes wrongly.
        UsdGeom.Xform.Define(stage, path)
        data = (mesh_dir / asset.file).read_bytes()
        _define_mesh(stage, f"{path}/mesh", read_triangles(data, f"mesh {asset.file}"))
    save(stage)


def _define_mesh(stage: Usd.Stage, path: str, triangles: TriangleMesh) -> None:
    from pxr import Sdf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(triangles.vertices.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(triangles.faces), 3))
    mesh.CreateFaceVertexIndicesAttr(
        Vt.IntArray.FromNumpy(triangles.faces.astype(np.int32).ravel())
    )
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    # Robot meshes are often open shells: seen from both sides, as MuJoCo shows them.
    mesh.CreateDoubleSidedAttr(True)
    if triangles.uv is not None:
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, UsdGeom.Tokens.faceVarying)
        primvar.Set(Vt.Vec2fArray.FromNumpy(triangles.uv.astype(np.float32).reshape(-1, 2)))
    # Polygons without normals are shown flat: one normal per face says the same aloud.
    normals, kind = face_normals(triangles), UsdGeom.Tokens.uniform
    if triangles.normals is not None:
        normals, kind = triangles.normals, UsdGeom.Tokens.faceVarying
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32).reshape(-1, 3)))
    mesh.SetNormalsInterpolation(kind)


def face_normals(triangles: TriangleMesh) -> Array:
    """(n, 3) unit normals by the winding of the faces; +z for a face without area."""
    a, b, c = (triangles.vertices[triangles.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    flat = lengths[:, 0] <= 0.0
    normals[flat], lengths[flat] = (0.0, 0.0, 1.0), 1.0
    out: Array = normals / lengths
    return out


def write_instances(folder: Path, names: Names, shapes: Shapes, *, instanceable: bool) -> None:
    """`instances.usda`: visual shapes below their bodies, materials bound."""
    from pxr import UsdGeom, UsdShade

    stage = new_layer(folder / "instances.usda", names)
    for shape in shapes.of("visual"):
        body, X_body_link = names.tree.placement(shape.link)
        UsdGeom.Xform.Define(stage, f"{stage.OverridePrim(names.body(body)).GetPath()}/{VISUALS}")
        prim = _define_visual(stage, names, shape, X_body_link @ shape.X_link_shape)
        if instanceable and isinstance(shape.geometry, Mesh):
            prim.SetInstanceable(True)
        label(prim, shape.name)
        if shape.material is not None:
            binding = UsdShade.MaterialBindingAPI.Apply(prim)
            material = stage.OverridePrim(names.material(shape.material))
            binding.Bind(UsdShade.Material(material))
    save(stage)


def _define_visual(stage: Usd.Stage, names: Names, shape: Shape, X_body_shape: Pose) -> Usd.Prim:
    from pxr import UsdGeom

    path, geometry = names.shape(shape), shape.geometry
    if not isinstance(geometry, Mesh):
        return define_primitive(stage, path, geometry, X_body_shape)
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    # The material is bound on the instance, above the shared mesh: a binding inside of it could
    # not reach the robot's materials, and meshes of two colours would not be shared.
    prim.GetReferences().AddReference(f"./{GEOMETRIES}", asset_path(names, geometry))
    place(prim, X_body_shape)
    return prim


def asset_path(names: Names, geometry: Mesh) -> str:
    """Prim path of a mesh asset in the library; its Mesh is the child `mesh`."""
    return f"{LIBRARY}/{names.assets[geometry.mesh]}"


def define_primitive(
    stage: Usd.Stage, path: str, geometry: Box | Sphere | Cylinder | Capsule, pose: Pose
) -> Usd.Prim:
    """A Cube, Sphere, Cylinder or Capsule with its extent, placed at `pose`."""
    from pxr import UsdGeom

    scale = ONE
    if isinstance(geometry, Box):
        prim = UsdGeom.Cube.Define(stage, path)
        prim.CreateSizeAttr(1.0)
        scale = geometry.size  # a Cube has one edge length: the scale makes it a box
    elif isinstance(geometry, Sphere):
        prim = UsdGeom.Sphere.Define(stage, path)
        prim.CreateRadiusAttr(geometry.radius)
    else:
        kind = UsdGeom.Cylinder if isinstance(geometry, Cylinder) else UsdGeom.Capsule
        prim = kind.Define(stage, path)
        prim.CreateAxisAttr(UsdGeom.Tokens.z)
        prim.CreateRadiusAttr(geometry.radius)
        prim.CreateHeightAttr(geometry.length)
    prim.CreateExtentAttr(_extent(geometry))
    place(prim.GetPrim(), pose, scale)
    return prim.GetPrim()


def _extent(geometry: Geometry) -> list[tuple[float, float, float]]:
    """Lower and upper corner in the prim's own frame, m (for a box: before its scale)."""
    if isinstance(geometry, Box):
        x = y = z = 0.5
    elif isinstance(geometry, Sphere):
        x = y = z = geometry.radius
    elif isinstance(geometry, Cylinder):
        x = y = geometry.radius
        z = geometry.length / 2
    elif isinstance(geometry, Capsule):
        x = y = geometry.radius
        z = geometry.length / 2 + geometry.radius
    else:
        raise TypeError("a mesh has its extent in the library")
    return [(-x, -y, -z), (x, y, z)]


def write_materials(folder: Path, names: Names, shapes: Shapes, mesh_dir: Path) -> None:
    """`materials.usda`: one UsdPreviewSurface per material; textures are copied beside it."""
    from pxr import UsdGeom

    stage = new_layer(folder / "materials.usda", names)
    if shapes.materials:
        UsdGeom.Scope.Define(stage, f"/{names.root}/{LOOKS}")
    for material in shapes.materials:
        _define_material(stage, names.material(material.name), material)
        if material.texture is not None:
            (folder / "textures").mkdir(exist_ok=True)
            try:
                shutil.copyfile(mesh_dir / material.texture, folder / "textures" / material.texture)
            except OSError as error:
                raise StepError(f"cannot copy texture `{material.texture}`: {error}") from error
    save(stage)


def _define_material(stage: Usd.Stage, path: str, material: Material) -> None:
    from pxr import Gf, Sdf, UsdShade

    look = UsdShade.Material.Define(stage, path)
    label(look.GetPrim(), material.name)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.Set(Gf.Vec3f(*material.rgba[:3]))
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(material.rgba[3])
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.5)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
    look.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    if material.texture is None:
        return
    reader = UsdShade.Shader.Define(stage, f"{path}/st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    image = UsdShade.Shader.Define(stage, f"{path}/image")
    image.CreateIdAttr("UsdUVTexture")
    file = f"./textures/{material.texture}"
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    for wrap in ("wrapS", "wrapT"):  # coordinates beyond 1 repeat the picture, as in MuJoCo
        image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
    # The connection below replaces the colour, which tints the picture: hence here.
    image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*material.rgba[:3], 1.0))
    coordinates = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    color.ConnectToSource(image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
