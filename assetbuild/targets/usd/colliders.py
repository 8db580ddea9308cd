"""Collision geometry, its surface, and the pairs that never touch."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

from assetbuild.findings import Finding, Rule
from assetbuild.robot.contact_filter import passing_pairs
from assetbuild.robot.model import Contact, Control
from assetbuild.robot.pose import Vec3
from assetbuild.robot.shapes import Mesh, Shape, Shapes
from assetbuild.simulators.usd_names import PHYSICS_MATERIALS
from assetbuild.targets.usd.geometry import define_shape
from assetbuild.targets.usd.layers import apply_foreign
from assetbuild.targets.usd.names import PrimPaths

HULL_VERTICES = 64
"""Most vertices of a convex hull that PhysX collides on a GPU."""
SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's defaults for the softness of a contact."""

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
    stage: Usd.Stage, names: PrimPaths, shapes: Shapes, control: Control
) -> Iterator[Finding]:
    """Collision shapes below their bodies, invisible (purpose guide), each with its surface."""
    if not shapes.of("collision"):
        return
    UsdGeom.Scope.Define(stage, f"/{names.root}/{PHYSICS_MATERIALS}")
    surfaces: dict[Vec3, object] = {}
    for shape in shapes.of("collision"):
        contact = control.surface_of(shape)
        friction = contact.friction
        if friction not in surfaces:
            surfaces[friction] = define_surface(
                stage, names.surface(friction, control.contact.friction), friction
            )
        prim = define_shape(stage, names, shape)
        if isinstance(shape.geometry, Mesh):
            _apply_hull(prim)
            yield from _hull_findings(shape, shape.geometry, shapes)
        UsdPhysics.CollisionAPI.Apply(prim)
        _apply_contact(prim, contact)
        UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(
            surfaces[friction], UsdShade.Tokens.weakerThanDescendants, "physics"
        )


def _apply_contact(prim: Usd.Prim, contact: Contact) -> None:
    """What only MuJoCo's contacts have; Newton reads it, PhysX does not.

    Newton has words of its own for the margin; without a gap it takes one that suits its search.
    """
    values: dict[str, int | float | tuple[float, ...]] = {
        "condim": contact.condim,
        "priority": contact.priority,
        "solref": tuple(contact.solref or SOLREF),
        "solimp": tuple(contact.solimp or SOLIMP),
        "margin": contact.margin,
        "gap": contact.gap,
    }
    apply_foreign(prim, "MjcCollisionAPI", "mjc", values)
    if contact.margin or contact.gap:
        offsets = {"contactMargin": contact.margin, "contactGap": contact.gap or None}
        apply_foreign(prim, "NewtonCollisionAPI", "newton", offsets)


def _apply_hull(prim: Usd.Prim) -> None:
    # PhysX makes hulls of moving meshes whatever one asks; ours are hulls already.
    mesh = UsdPhysics.MeshCollisionAPI.Apply(prim)
    mesh.CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
    name = "physxConvexHullCollision"
    apply_foreign(prim, "PhysxConvexHullCollisionAPI", name, {"hullVertexLimit": HULL_VERTICES})
    apply_foreign(prim, "NewtonMeshCollisionAPI", "newton", {})


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


def define_surface(stage: Usd.Stage, path: str, friction: Vec3) -> UsdShade.Material:
    """The physics material: MuJoCo has one sliding friction, so static equals dynamic.

    As in MuJoCo the larger friction of two surfaces acts; PhysX would take their mean.
    """
    material = UsdShade.Material.Define(stage, path)
    sliding, torsional, rolling = friction
    surface = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    surface.CreateStaticFrictionAttr(sliding)
    surface.CreateDynamicFrictionAttr(sliding)
    surface.CreateRestitutionAttr(0.0)
    beyond = {"torsionalFriction": torsional, "rollingFriction": rolling}
    apply_foreign(material.GetPrim(), "NewtonMaterialAPI", "newton", beyond)
    combined = {"frictionCombineMode": "max"}
    apply_foreign(material.GetPrim(), "PhysxMaterialAPI", "physxMaterial", combined)
    return material


def apply_filtered_pairs(
    stage: Usd.Stage, names: PrimPaths, shapes: Shapes, control: Control
) -> None:
    """FilteredPairsAPI for the pairs that never touch and that no joint filters already.

    These are the excluded ones, and those that MuJoCo drops: see `robot.contact_filter`.

    Never between a body and the root link itself: on a floating base it carries the articulation,
    and a pair there would speak for the whole robot. Its colliders stand in for it.
    """
    tree = names.tree
    jointed = {frozenset((joint.parent, joint.child)) for joint in tree.joints}
    pairs = sorted({*control.excludes, *passing_pairs(tree, shapes, control)})
    targets: dict[str, list[str]] = {}
    for pair in pairs:
        first, second = sorted(pair, key=lambda body: body == tree.root)
        if frozenset(pair) not in jointed:
            targets.setdefault(first, []).extend(_standing_for(second, names, shapes))
    for body, paths in targets.items():
        _filter(stage, names.body(body), paths)


def touching_neighbours(names: PrimPaths, shapes: Shapes, control: Control) -> set[frozenset[str]]:
    """Jointed pairs that may touch: most often, the parent is fixed to the world; and of loops."""
    tree = names.tree
    solid: dict[str, list[Contact]] = {}
    for shape in shapes.of("collision"):
        body = tree.placement(shape.link)[0]
        solid.setdefault(body, []).append(control.surface_of(shape))
    apart = {frozenset(pair) for pair in (*control.excludes, *passing_pairs(tree, shapes, control))}
    jointed = [(joint.parent, joint.child) for joint in tree.joints]
    jointed += [(loop.a.body, loop.b.body) for loop in control.loops]
    return {
        frozenset(pair)
        for pair in jointed
        if frozenset(pair) not in apart
        and any(
            one.meets(two) for one, two in product(solid.get(pair[0], ()), solid.get(pair[1], ()))
        )
    }


def _filter(stage: Usd.Stage, path: str, others: list[str]) -> None:
    if others:
        api = UsdPhysics.FilteredPairsAPI.Apply(stage.OverridePrim(path))
        api.CreateFilteredPairsRel().SetTargets(others)


def apply_masks(stage: Usd.Stage, names: PrimPaths, shapes: Shapes, control: Control) -> None:
    """Filtered pairs of shapes whose MuJoCo bits never meet; USD has no such bits.

    A shape that meets nothing at all, not even a plain floor, does not collide.
    """
    surfaces = [(shape, control.surface_of(shape)) for shape in shapes.of("collision")]
    if all(s.contype == s.conaffinity == 1 for _, s in surfaces):
        return
    for index, (shape, surface) in enumerate(surfaces):
        if not surface.contype and not surface.conaffinity:
            prim = stage.OverridePrim(names.shape(shape))
            UsdPhysics.CollisionAPI(prim).CreateCollisionEnabledAttr(False)
            continue
        apart = [
            names.shape(other)
            for other, theirs in surfaces[index + 1 :]
            if (theirs.contype or theirs.conaffinity)
            and not surface.meets(theirs)
            and names.tree.placement(shape.link)[0] != names.tree.placement(other.link)[0]
        ]
        _filter(stage, names.shape(shape), apart)


def _standing_for(body: str, names: PrimPaths, shapes: Shapes) -> list[str]:
    if body != names.tree.root:
        return [names.body(body)]
    colliders = shapes.of("collision")
    return [names.shape(s) for s in colliders if names.tree.placement(s.link)[0] == body]
