"""The files of the asset, and how a prim gets its place.

<robot>.usda                 interface: default prim, payload, variant set `Physics`
payloads/base.usda           bodies and frames; sublayers instances.usda and materials.usda
payloads/instances.usda      what is seen: instances of the meshes, primitives
payloads/materials.usda      materials for the eye, textures/ beside it
payloads/geometries.usdc     each mesh once
payloads/physics.usda        masses, joints, drives, colliders in USD's own words
payloads/<engine>.usda       what PhysX, Newton and MuJoCo add, for the variants of `VARIANTS`
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, Vt

from assetbuild.errors import StepError
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.targets.usd.names import PrimPaths

PAYLOADS = "payloads"
GEOMETRIES = "geometries.usdc"
CRATE_VERSIONS = ((0, 8, 0), (0, 10, 0))
"""First and last version of the binary format that usd-core 24.5 reads and writes."""
VARIANTS = {
    "none": (),
    "physics": ("physics", "physx", "newton", "mujoco"),
    "physx": ("physics", "physx"),
    "newton": ("physics", "newton", "mujoco"),
    "mujoco": ("physics", "newton", "mujoco"),
}
"""Payloads of the variants of `Physics`. Newton runs MuJoCo's solver and reads its words, and
MuJoCo's schema builds on Newton's."""
_UNSIGNED = frozenset({"timeStepsPerSecond"})
"""Whole numbers that their schema declares without a sign."""


def new_stage(path: Path) -> Usd.Stage:
    """An empty stage in a new file: metres, kilograms, z up."""
    path.parent.mkdir(parents=True, exist_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    return stage


def new_layer(path: Path, names: PrimPaths) -> Usd.Stage:
    """A new stage for one layer of the robot; its default prim is an over of the robot.

    An over, because only `<robot>.usda` and `base.usda` define it: the others add to it.
    """
    stage = new_stage(path)
    stage.SetDefaultPrim(stage.OverridePrim(f"/{names.root}"))
    return stage


def save(stage: Usd.Stage) -> None:
    """Write the layer; raises StepError when a binary one is newer than usd-core 24.5 reads."""
    layer = stage.GetRootLayer()
    for spec in _prims(layer.pseudoRoot):
        # Untyped definitions become overs again: defining a child has turned them over.
        if not spec.typeName and spec.specifier == Sdf.SpecifierDef:
            spec.specifier = Sdf.SpecifierOver
    layer.Save()
    path = Path(layer.realPath)
    if path.suffix == ".usdc":
        with path.open("rb") as file:
            version = tuple(file.read(11)[8:])
        first, last = CRATE_VERSIONS
        if not first <= version <= last:
            number = ".".join(map(str, version))
            raise StepError(
                f"usd-core wrote binary USD {number}, which usd-core 24.5 cannot read",
                hint="unset USD_WRITE_NEW_USDC_FILES_AS_VERSION, or build with another usd-core",
            )


def new_interface(path: Path, names: PrimPaths) -> Usd.Stage:
    """`<robot>.usda`: composes the payloads and selects the variant `physics`.

    Without an authored selection a runtime composes no bodies and no joints, silently.
    """
    stage = new_layer(path, names)
    prim = UsdGeom.Xform.Define(stage, f"/{names.root}").GetPrim()
    Usd.ModelAPI(prim).SetKind(Kind.Tokens.component)
    prim.GetPayloads().AddPayload(f"./{PAYLOADS}/base.usda")
    variants = prim.GetVariantSets().AddVariantSet("Physics")
    for variant, payloads in VARIANTS.items():
        variants.AddVariant(variant)
        variants.SetVariantSelection(variant)
        with variants.GetVariantEditContext():
            for payload in payloads:
                prim.GetPayloads().AddPayload(f"./{PAYLOADS}/{payload}.usda")
    variants.SetVariantSelection("physics")
    return stage


def place(prim: Usd.Prim, pose: Pose, scale: Vec3 = (1.0, 1.0, 1.0)) -> None:
    """Author translate, orient and (unless it is 1) scale, in double precision.

    Translate and orient are written even when they are identities: Isaac Lab moves prims by them.
    """
    xform = UsdGeom.Xformable(prim)
    double = UsdGeom.XformOp.PrecisionDouble
    xform.AddTranslateOp(double)
    xform.AddOrientOp(double)
    set_place(prim, pose)
    if scale != (1.0, 1.0, 1.0):
        xform.AddScaleOp(double).Set(Gf.Vec3d(*scale))


def set_place(prim: Usd.Prim, pose: Pose) -> None:
    """Values for the ops that `place` made, here or in a layer below."""
    for op, kind, value in (
        ("translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(*pose.xyz)),
        ("orient", Sdf.ValueTypeNames.Quatd, Gf.Quatd(*pose.quat)),
    ):
        prim.CreateAttribute(f"xformOp:{op}", kind, custom=False).Set(value)


def label(prim: Usd.Prim, name: str) -> None:
    """Keep a name that is no identifier as the prim's displayName."""
    if prim.GetName() != name:
        prim.SetMetadata("displayName", name)


def apply_foreign(
    prim: Usd.Prim,
    schema: str,
    prefix: str,
    values: Mapping[str, bool | int | float | str | tuple[float, ...] | None],
) -> None:
    """Apply a schema that usd-core does not ship; its attributes are called `<prefix>:<name>`.

    One whose value is None is left out. MuJoCo's own, `mjc:<name>`, are uniform and of double
    precision, in SI and radians.
    NVIDIA's schema packages may not be vendored; runtimes that have them read these as theirs.
    """
    kinds, mujoco = Sdf.ValueTypeNames, prefix == "mjc"
    types = {bool: kinds.Bool, int: kinds.Int, float: kinds.Float, str: kinds.Token}
    if mujoco:
        types |= {float: kinds.Double, tuple: kinds.DoubleArray}
    varies = Sdf.VariabilityUniform if mujoco else Sdf.VariabilityVarying
    prim.AddAppliedSchema(schema)
    for name, value in values.items():
        if value is not None:
            kind = kinds.UInt if name in _UNSIGNED else types[type(value)]
            made = prim.CreateAttribute(f"{prefix}:{name}", kind, custom=False, variability=varies)
            made.Set(Vt.DoubleArray(value) if isinstance(value, tuple) else value)


# --- each engine's own words in a layer of their own ---------------------------------------------


WORDS = {"physx": ("Physx", "physx"), "newton": ("Newton", "newton:"), "mujoco": ("Mjc", "mjc:")}
"""Engine, which is a layer -> how its schemas and its properties start."""


def save_by_engine(stage: Usd.Stage, folder: Path, names: PrimPaths) -> None:
    """Save `physics.usda` with USD's own words, and the layer of each engine beside it.

    So a variant can leave the others' out; `physics` has them all, which do not contradict each
    other.
    """
    physics = stage.GetRootLayer()
    prims = list(_prims(physics.pseudoRoot))
    for engine, (schemas, properties) in WORDS.items():
        engine_stage = new_layer(folder / f"{engine}.usda", names)
        for prim in prims:
            if not prim.expired:
                _move(prim, engine_stage.GetRootLayer(), schemas, properties)
        save(engine_stage)
    save(stage)


def _prims(parent: Sdf.PrimSpec) -> Iterator[Sdf.PrimSpec]:
    for prim in parent.nameChildren:
        yield prim
        yield from _prims(prim)


def _move(prim: Sdf.PrimSpec, layer: Sdf.Layer, schemas: str, properties: str) -> None:
    """The whole prim where its type is the engine's, else its schemas and properties."""
    if prim.typeName.startswith(schemas):
        Sdf.CreatePrimInLayer(layer, prim.path.GetParentPath())
        Sdf.CopySpec(prim.layer, prim.path, layer, prim.path)
        del prim.nameParent.nameChildren[prim.name]
        return
    moved = [each for each in prim.properties if each.name.startswith(properties)]
    applied = prim.GetInfo("apiSchemas").prependedItems
    foreign = [name for name in applied if name.startswith(schemas)]
    if not (moved or foreign):
        return
    there = Sdf.CreatePrimInLayer(layer, prim.path)
    for each in moved:
        Sdf.CopySpec(prim.layer, each.path, layer, each.path)
        prim.RemoveProperty(each)
    if foreign:
        there.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=foreign))
        rest = [name for name in applied if name not in foreign]
        if rest:
            prim.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=rest))
        else:
            prim.ClearInfo("apiSchemas")
