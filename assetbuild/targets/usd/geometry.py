"""What is seen: the mesh library, its instances, primitives and materials."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from assetbuild.errors import StepError
from assetbuild.mesh.arrays import read_meshes
from assetbuild.mesh.triangles import TriangleMesh, face_normals
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Material, Mesh, Shape, Shapes, Sphere
from assetbuild.simulators.usd_names import LOOKS
from assetbuild.targets.usd.layers import GEOMETRIES, label, new_layer, new_stage, place, save
from assetbuild.targets.usd.names import PrimPaths, asset_names

LIBRARY = "/Geometries"


def write_library(folder: Path, shapes: Shapes, triangles: Path) -> None:
    """`geometries.usdc`: `/Geometries/<asset>/mesh` for each asset, no more than once.

    An instance needs a parent to share, a collider the mesh itself: hence the two levels.
    """
    names = asset_names(shapes)
    stage = new_stage(folder / GEOMETRIES)
    library = UsdGeom.Scope.Define(stage, LIBRARY)
    stage.SetDefaultPrim(library.GetPrim())
    for name, mesh in read_meshes(triangles, surface=True).items():
        path = f"{LIBRARY}/{names[name]}"
        # No displayName here: it would come through the reference and name the shapes wrongly.
        UsdGeom.Xform.Define(stage, path)
        _define_mesh(stage, f"{path}/mesh", mesh)
    save(stage)


def _define_mesh(stage: Usd.Stage, path: str, triangles: TriangleMesh) -> None:
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
    if triangles.normals is not None:
        normals, kind = triangles.normals, UsdGeom.Tokens.faceVarying
    else:
        normals, kind = face_normals(triangles), UsdGeom.Tokens.uniform
        normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)  # a face without area has none
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32).reshape(-1, 3)))
    mesh.SetNormalsInterpolation(kind)


def write_instances(folder: Path, names: PrimPaths, shapes: Shapes, *, instanceable: bool) -> None:
    """`instances.usda`: visual shapes below their bodies, materials bound."""
    stage = new_layer(folder / "instances.usda", names)
    for shape in shapes.of("visual"):
        prim = define_shape(stage, names, shape)
        if instanceable and isinstance(shape.geometry, Mesh):
            prim.SetInstanceable(True)
        # The material is bound on the instance, above the shared mesh: a binding inside of it could
        # not reach the robot's materials, and meshes of two colours would not be shared.
        if shape.material is not None:
            binding = UsdShade.MaterialBindingAPI.Apply(prim)
            material = stage.OverridePrim(names.material(shape.material))
            binding.Bind(UsdShade.Material(material))
    save(stage)


def define_shape(stage: Usd.Stage, names: PrimPaths, shape: Shape) -> Usd.Prim:
    """The shape below its body, with its name.

    A mesh refers to the library: a collider to the mesh itself, a visual to the asset around it.
    """
    path, geometry = names.shape(shape), shape.geometry
    _, pose = names.tree.shape_placement(shape)
    UsdGeom.Xform.Define(stage, path.rpartition("/")[0])
    if isinstance(geometry, Mesh):
        collides = shape.role == "collision"
        prim = (UsdGeom.Mesh if collides else UsdGeom.Xform).Define(stage, path).GetPrim()
        asset = f"{LIBRARY}/{names.assets[geometry.mesh]}" + ("/mesh" if collides else "")
        prim.GetReferences().AddReference(f"./{GEOMETRIES}", asset)
        place(prim, pose)
    else:
        prim = define_primitive(stage, path, geometry, pose)
    label(prim, shape.name)
    return prim


def define_primitive(
    stage: Usd.Stage, path: str, geometry: Box | Sphere | Cylinder | Capsule, pose: Pose
) -> Usd.Prim:
    """A Cube, Sphere, Cylinder or Capsule with its extent, placed at `pose`."""
    scale: Vec3 = (1.0, 1.0, 1.0)
    if isinstance(geometry, Box):
        prim = UsdGeom.Cube.Define(stage, path)
        prim.CreateSizeAttr(1.0)
        scale = geometry.size  # a Cube has one edge length: the scale makes it a box
        x = y = z = 0.5
    elif isinstance(geometry, Sphere):
        prim = UsdGeom.Sphere.Define(stage, path)
        prim.CreateRadiusAttr(geometry.radius)
        x = y = z = geometry.radius
    else:
        round_ends = isinstance(geometry, Capsule)
        prim = (UsdGeom.Capsule if round_ends else UsdGeom.Cylinder).Define(stage, path)
        prim.CreateAxisAttr(UsdGeom.Tokens.z)
        prim.CreateRadiusAttr(geometry.radius)
        prim.CreateHeightAttr(geometry.length)
        x = y = geometry.radius
        z = geometry.length / 2 + (geometry.radius if round_ends else 0.0)
    prim.CreateExtentAttr([(-x, -y, -z), (x, y, z)])  # in its own frame, m: before the scale
    place(prim.GetPrim(), pose, scale)
    return prim.GetPrim()


def write_materials(folder: Path, names: PrimPaths, shapes: Shapes, mesh_dir: Path) -> None:
    """`materials.usda`: one UsdPreviewSurface per material; textures are copied beside it."""
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
