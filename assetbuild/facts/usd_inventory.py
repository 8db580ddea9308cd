"""Every prim that a USD of the robot must have: its path, its type and its applied schemas.

A prim that is renamed, doubled, left undefined or stripped of a schema is then a fact that differs,
whether or not a runtime looks for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Value
from assetbuild.facts.usd_actuators import EXPLICIT, clamp_of
from assetbuild.facts.usd_actuators import LAW as LAW_OF_DRIVE
from assetbuild.facts.usd_isaac_expected import JOINT, LINK, ROBOT, SITE, overrides, pose_prims
from assetbuild.robot.joint_springs import as_drives
from assetbuild.robot.model import MOVING, Actuator, Body, Joint
from assetbuild.robot.pose import Vec3
from assetbuild.robot.shapes import Box, Mesh, Shape
from assetbuild.simulators.usd_names import (
    ACTUATORS,
    JOINTS,
    LOOKS,
    LOOPS,
    PHYSICS_MATERIALS,
    POSES,
    ROOT_JOINT,
    body_identifiers,
    camera_identifiers,
    frame_identifiers,
    joint_identifiers,
    loop_identifiers,
    usd_identifier,
    usd_identifiers,
)

BY_PAIRS = "PhysicsFilteredPairsAPI"
"""Either of two bodies may carry this schema; the pairs that never touch are compared instead."""
ARTICULATION = ("PhysicsArticulationRootAPI", "PhysxArticulationAPI", "NewtonArticulationRootAPI")
BODY = ("PhysicsRigidBodyAPI", "PhysxRigidBodyAPI")
SURFACE = ("PhysicsMaterialAPI", "NewtonMaterialAPI", "PhysxMaterialAPI")
MESH = ("PhysicsMeshCollisionAPI", "PhysxConvexHullCollisionAPI", "NewtonMeshCollisionAPI")
LAW = "PhysxMimicJointAPI"
"""Applied once for an axis, whose name the facts of the joint hold."""
BOUND = frozenset({"PhysicsCollisionAPI", "MaterialBindingAPI"})
STRENGTH = "usd:material:binding:physics bindMaterialAs"
"""This metadata says how the physics material of a collider is bound."""
JOINT_TYPES = {"fixed": "PhysicsFixedJoint", "prismatic": "PhysicsPrismaticJoint"}

Row = tuple[str, str, Iterable[str]]
"""Path, type, applied schemas."""


def prim_facts(path: str, kind: str, schemas: Iterable[str]) -> Iterator[tuple[Key, Value]]:
    """The facts of one prim; a schema that is applied for an axis counts for each of them."""
    yield Key("prim", path, "usd:type"), kind
    for schema in schemas:
        name = LAW if schema.startswith(f"{LAW}:") else schema
        if name != BY_PAIRS:
            yield Key("prim", path, f"usd:schema {name}"), "applied"


def inventory(
    robot: str, reference: Reference, facts: Mapping[Key, Value]
) -> Iterator[tuple[Key, Value]]:
    """The facts of all prims of the composed stage. facts: those of the robot that USD holds."""
    top = f"/{usd_identifier(robot)}"
    tree, shapes = reference.tree, reference.shapes
    bodies = {name: f"{top}/{short}" for name, short in body_identifiers(tree).items()}
    hinted = ("GeomModelAPI",) if shapes.shapes else ()
    rows: list[Row] = [(top, "Xform", (ROBOT, *hinted))]
    rows += _bodies(reference, top, bodies)
    rows += _joints(reference, f"{top}/{JOINTS}", facts)
    rows += _loops(reference, f"{top}/{LOOPS}")
    rows += _actuators(reference, f"{top}/{ACTUATORS}")
    rows += pose_prims(reference.control, f"{top}/{POSES}")
    rows += _shapes(reference, bodies)
    materials = usd_identifiers(material.name for material in shapes.materials)
    rows += [(f"{top}/{LOOKS}", "Scope", ())] if materials else []
    for material in shapes.materials:
        path = f"{top}/{LOOKS}/{materials[material.name]}"
        shaders = ("surface", "st", "image") if material.texture is not None else ("surface",)
        rows += [(path, "Material", ()), *((f"{path}/{name}", "Shader", ()) for name in shaders)]
    if shapes.of("collision"):
        surfaces = f"{top}/{PHYSICS_MATERIALS}"
        rows.append((surfaces, "Scope", ()))
        rows += [(f"{surfaces}/{name}", "Material", SURFACE) for name in _surfaces(reference)]
    for row in rows:
        yield from prim_facts(*row)
        if set(row[2]) >= BOUND:
            yield Key("prim", row[0], STRENGTH), "weakerThanDescendants"
    for path, word, name in overrides(reference, top, f"{top}/{JOINTS}"):
        yield Key("prim", path, word), name
    for name, short in joint_identifiers(tree).items():
        if facts.get(Key("joint", name, "velocity"), 0.0) is None:
            for attribute in _velocities(tree.by_joint[name]):
                yield Key("prim", f"{top}/{JOINTS}/{short}", f"usd:{attribute}"), "not stated"


def _bodies(reference: Reference, top: str, paths: Mapping[str, str]) -> Iterator[Row]:
    tree = reference.tree
    for body in tree.bodies:
        root = tree.base == "floating" and body.name == tree.root
        yield (
            paths[body.name],
            "Xform",
            (LINK, *BODY, *_mass(body), *(ARTICULATION if root else ())),
        )
    frames = frame_identifiers(tree)
    for frame in tree.frames:
        yield f"{paths[frame.body]}/{frames[frame.name]}", "Xform", (SITE,)
    cameras = camera_identifiers(tree, reference.control.cameras)
    for camera in reference.control.cameras:
        above = paths[tree.placement(camera.link)[0]] if camera.link else top
        yield f"{above}/{cameras[camera.name]}", "Camera", ()


def _mass(body: Body) -> tuple[str, ...]:
    """PhysX would take a mass of 0 for none, and make one up."""
    return ("PhysicsMassAPI",) if body.inertial is not None and not body.is_massless else ()


def _joints(reference: Reference, scope: str, facts: Mapping[Key, Value]) -> Iterator[Row]:
    tree, control = reference.tree, reference.control
    if tree.joints or tree.base == "fixed":
        yield scope, "Scope", ()
    if tree.base == "fixed":
        yield f"{scope}/{ROOT_JOINT}", "PhysicsFixedJoint", (JOINT, *ARTICULATION)
    names, springs = joint_identifiers(tree), as_drives(control)
    for joint in tree.joints:
        kind = JOINT_TYPES.get(joint.kind, "PhysicsRevoluteJoint")
        schemas = [JOINT, *_moving(joint, control.by_joint.get(joint.name), joint.name in springs)]
        if Key("joint", joint.name, "usd:solreflimit") in facts:
            schemas.append("MjcJointAPI")
        if Key("joint", joint.name, "mimics") in facts:
            schemas += [LAW, "NewtonMimicAPI"]
        yield f"{scope}/{names[joint.name]}", kind, schemas


def _loops(reference: Reference, scope: str) -> Iterator[Row]:
    loops = reference.control.loops
    if loops:
        yield scope, "Scope", ()
    names = loop_identifiers(loops)
    for loop in loops:
        kind = "PhysicsFixedJoint" if loop.kind == "weld" else "PhysicsSphericalJoint"
        yield f"{scope}/{names[loop.name]}", kind, ("MjcEqualityWeldAPI",)


def _actuators(reference: Reference, scope: str) -> Iterator[Row]:
    names = joint_identifiers(reference.tree)
    explicit = [row for row in reference.control.actuators if row.model in EXPLICIT]
    if explicit:
        yield scope, "Scope", ()
    for row in explicit:
        yield f"{scope}/{names[row.joint]}", "NewtonActuator", (LAW_OF_DRIVE, clamp_of(row))


def _moving(joint: Joint, row: Actuator | None, sprung: bool) -> Iterator[str]:
    if joint.kind not in MOVING:
        return
    axis = _axis(joint)
    yield from ("PhysxJointAPI", f"PhysxJointAxisAPI:{axis}", "NewtonJointAPI")
    yield f"PhysicsJointStateAPI:{axis}"
    if sprung or (row is not None and row.model != "passive"):
        yield f"PhysicsDriveAPI:{axis}"


def _axis(joint: Joint) -> str:
    return "linear" if joint.kind == "prismatic" else "angular"


def _velocities(joint: Joint) -> tuple[str, ...]:
    """The three spellings of the limit of a joint's velocity."""
    axis = f"physxJointAxis:{_axis(joint)}:maxJointVelocity"
    return axis, "physxJoint:maxJointVelocity", "newton:velocityLimit"


def _shapes(reference: Reference, bodies: Mapping[str, str]) -> Iterator[Row]:
    """Visual meshes lie below the prim that names and shares them; a collider is its mesh."""
    tree, shapes = reference.tree, reference.shapes
    own, common = dict(reference.control.contacts), reference.control.contact
    names = usd_identifiers(shape.name for shape in shapes.shapes)
    groups = set()
    for shape in shapes.shapes:
        collides = shape.role == "collision"
        body, _ = tree.shape_placement(shape)
        group = f"{bodies[body]}/{'collisions' if collides else 'visuals'}"
        groups.add(group)
        path, is_mesh = f"{group}/{names[shape.name]}", isinstance(shape.geometry, Mesh)
        bound = ("MaterialBindingAPI",) if collides or shape.material is not None else ()
        if not is_mesh or collides:
            solid = ("PhysicsCollisionAPI", "MjcCollisionAPI") if collides else ()
            if collides and any(
                (own.get(shape.name, common).margin, own.get(shape.name, common).gap)
            ):
                solid = (*solid, "NewtonCollisionAPI")
            yield path, _type(shape), (*bound, *solid, *(MESH if is_mesh else ()))
        else:
            yield path, "Xform", bound
            yield f"{path}/mesh", "Mesh", ()
    yield from ((group, "Xform", ()) for group in sorted(groups))


def _type(shape: Shape) -> str:
    return "Cube" if isinstance(shape.geometry, Box) else type(shape.geometry).__name__


def _surfaces(reference: Reference) -> Iterator[str]:
    """A physics material for each friction, named by its numbers; `contact` is most shapes'."""
    own, common = dict(reference.control.contacts), reference.control.contact
    found: dict[Vec3, str] = {}
    for shape in reference.shapes.of("collision"):
        friction = own.get(shape.name, common).friction
        numbers = "_".join(usd_identifier(repr(float(value)))[1:] for value in friction)
        found[friction] = "contact" if friction == common.friction else f"contact_{numbers}"
    yield from dict.fromkeys(found.values())
