"""Collision geometry, its surface, and the pairs that never touch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control, Mesh, Shape, Shapes, Tree
from assetbuild.robot.pose import Vec3
from assetbuild.simulators.usd_names import PHYSICS_MATERIALS
from assetbuild.targets.usd.geometry import asset_path, define_primitive
from assetbuild.targets.usd.layers import GEOMETRIES, apply_foreign, label, place
from assetbuild.targets.usd.names import COLLISIONS, Names

if TYPE_CHECKING:
    from pxr import Usd

HULL_VERTICES = 64
"""Most vertices of a convex hull that PhysX collides on a GPU."""

LARGE_HULL = Rule(
    "usd.hull_vertices",
    "info",
    "a hull has more than 64 vertices, so PhysX simplifies it",
    "`max_vertices: 64`",
)
CONCAVE_COLLISION = Rule(
    "usd.concave_collision",
    "info",
    "the simulators use the hull of a concave collision mesh",
    "`method: hull` or a decomposition",
)


def define_colliders(
    stage: Usd.Stage, names: Names, shapes: Shapes, control: Control
) -> Iterator[Finding]:
    """Collision shapes below their bodies, invisible (purpose guide), each with its surface."""
    from pxr import UsdGeom, UsdPhysics, UsdShade

    if not shapes.of("collision"):
        return
    UsdGeom.Scope.Define(stage, f"/{names.root}/{PHYSICS_MATERIALS}")
    own = dict(control.contacts)
    surfaces: dict[Vec3, object] = {}
    for shape in shapes.of("collision"):
        friction = own.get(shape.name, control.contact).friction
        if friction not in surfaces:
            surfaces[friction] = _define_surface(
                stage, names.surface(friction, control.contact.friction), friction
            )
        body, X_body_link = names.tree.placement(shape.link)
        UsdGeom.Xform.Define(stage, f"{names.body(body)}/{COLLISIONS}")
        pose, geometry = X_body_link @ shape.X_link_shape, shape.geometry
        if isinstance(geometry, Mesh):
            prim = UsdGeom.Mesh.Define(stage, names.shape(shape)).GetPrim()
            path = f"{asset_path(names, geometry)}/mesh"
            prim.GetReferences().AddReference(f"./{GEOMETRIES}", path)
            place(prim, pose, geometry.scale)
            _apply_hull(prim)
            yield from _hull_findings(shape, geometry, shapes)
        else:
            prim = define_primitive(stage, names.shape(shape), geometry, pose)
        label(prim, shape.name)
        UsdPhysics.CollisionAPI.Apply(prim)
        UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(
            surfaces[friction], UsdShade.Tokens.weakerThanDescendants, "physics"
        )


def _apply_hull(prim: Usd.Prim) -> None:
    from pxr import UsdPhysics

    # PhysX makes hulls of moving meshes whatever one asks; ours are hulls already.
    mesh = UsdPhysics.MeshCollisionAPI.Apply(prim)
    mesh.CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
    apply_foreign(
        prim,
        "PhysxConvexHullCollisionAPI",
        {"physxConvexHullCollision:hullVertexLimit": ("Int", HULL_VERTICES)},
    )


def _hull_findings(shape: Shape, geometry: Mesh, shapes: Shapes) -> Iterator[Finding]:
    asset = next(mesh for mesh in shapes.meshes if mesh.name == geometry.mesh)
    if not asset.convex:
        yield CONCAVE_COLLISION(
            f"link {shape.link}",
            f"the collision mesh `{asset.name}` is filled up to its convex hull",
            hint="`method: coacd` follows hollows; `hull` says what is meant",
            data={"faces": asset.faces},
        )
    elif asset.vertices > HULL_VERTICES:
        yield LARGE_HULL(
            f"link {shape.link}",
            f"PhysX simplifies the hull `{asset.name}` from {asset.vertices} to "
            f"{HULL_VERTICES} vertices",
            hint=f"`max_vertices: {HULL_VERTICES}` makes all simulators use the same hull",
            data={"vertices": asset.vertices, "limit": HULL_VERTICES},
        )


def _define_surface(stage: Usd.Stage, path: str, friction: Vec3) -> object:
    """The physics material: MuJoCo has one sliding friction, so static equals dynamic."""
    from pxr import UsdPhysics, UsdShade

    material = UsdShade.Material.Define(stage, path)
    sliding, torsional, rolling = friction
    surface = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    surface.CreateStaticFrictionAttr(sliding)
    surface.CreateDynamicFrictionAttr(sliding)
    surface.CreateRestitutionAttr(0.0)
    apply_foreign(
        material.GetPrim(),
        "NewtonMaterialAPI",
        {
            "newton:torsionalFriction": ("Float", torsional),
            "newton:rollingFriction": ("Float", rolling),
        },
    )
    return material


def apply_filtered_pairs(
    stage: Usd.Stage, names: Names, tree: Tree, shapes: Shapes, control: Control
) -> None:
    """FilteredPairsAPI for the excluded pairs that no joint filters already.

    Never between a body and the root link itself: on a floating base it carries the articulation,
    and a pair there would speak for the whole robot. Its colliders stand in for it.
    """
    from pxr import UsdPhysics

    jointed = {frozenset((joint.parent, joint.child)) for joint in tree.joints}
    targets: dict[str, list[str]] = {}
    for pair in control.excludes:
        first, second = sorted(pair, key=lambda body: body == tree.root)
        if frozenset(pair) not in jointed:
            targets.setdefault(first, []).extend(_standing_for(second, names, tree, shapes))
    for body, paths in targets.items():
        if paths:
            api = UsdPhysics.FilteredPairsAPI.Apply(stage.OverridePrim(names.body(body)))
            api.CreateFilteredPairsRel().SetTargets(paths)


def apply_masks(
    stage: Usd.Stage, names: Names, tree: Tree, shapes: Shapes, control: Control
) -> None:
    """Filtered pairs of shapes whose MuJoCo bits never meet; USD has no such bits.

    A shape that meets nothing at all, not even a plain floor, does not collide.
    """
    from pxr import UsdPhysics

    own = dict(control.contacts)
    surfaces = [(shape, own.get(shape.name, control.contact)) for shape in shapes.of("collision")]
    if all(s.mask == s.partners == 1 for _, s in surfaces):
        return
    for index, (shape, surface) in enumerate(surfaces):
        prim = stage.OverridePrim(names.shape(shape))
        if not surface.mask and not surface.partners:
            UsdPhysics.CollisionAPI(prim).CreateCollisionEnabledAttr(False)
            continue
        apart = [
            names.shape(other)
            for other, theirs in surfaces[index + 1 :]
            if (theirs.mask or theirs.partners)
            and not (surface.mask & theirs.partners or theirs.mask & surface.partners)
            and tree.placement(shape.link)[0] != tree.placement(other.link)[0]
        ]
        if apart:
            api = UsdPhysics.FilteredPairsAPI.Apply(prim)
            api.CreateFilteredPairsRel().SetTargets(apart)


def _standing_for(body: str, names: Names, tree: Tree, shapes: Shapes) -> list[str]:
    if body != tree.root:
        return [names.body(body)]
    colliders = shapes.of("collision")
    return [names.shape(s) for s in colliders if tree.placement(s.link)[0] == body]
