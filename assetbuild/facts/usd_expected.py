"""What a USD of the robot must say: its facts in what USD can hold, and the words of the format.

Derived from the robot and from the recipe's `usd` alone.
"""

from __future__ import annotations

import itertools

from assetbuild.facts.reference import SOLIMP, SOLREF, Reference, filtered_pairs, pose_value
from assetbuild.facts.sketch import SKETCH
from assetbuild.facts.table import Key, Table, Value, Writer, pair_name
from assetbuild.facts.usd_about import expected_metadata
from assetbuild.facts.usd_actuators import expected_actuators
from assetbuild.facts.usd_inventory import inventory
from assetbuild.facts.usd_isaac_expected import expected_schema
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.joint_springs import as_drives
from assetbuild.robot.lost_motion import whole_gravity
from assetbuild.robot.mimic import first_leader
from assetbuild.robot.model import MOVING, Actuator, Joint, Tree
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import Material, Mesh, Shape
from assetbuild.robot.softness import limit_springs
from assetbuild.simulators.usd_names import (
    body_identifiers,
    camera_identifiers,
    frame_identifiers,
    joint_identifiers,
    loop_identifiers,
    usd_identifier,
    usd_identifiers,
)
from assetbuild.simulators.usd_options import UsdArticulation, UsdOptions, UsdRigidBody

HULL_VERTICES = 64.0
"""Most vertices of a convex hull that PhysX collides on a GPU."""


CLIPPING_M = (0.01, 1000.0)
"""Nearest and farthest depth that a camera sees."""


def usd_table(robot: str, own: Table, reference: Reference) -> Table:
    """Everything that `<robot>.usda` says. own: the robot's facts that USD holds."""
    book = Writer()
    book.facts |= own.facts
    tree, control = reference.tree, reference.control
    weightless = whole_gravity(control.mjcf_only)
    options = UsdOptions.model_validate(reference.options.get("usd") or {})
    _stage(robot, reference, book)
    _root(tree, options.articulation.solving(control.loops), book)
    for body in tree.bodies:
        if body.is_massless:  # PhysX would take a mass of 0 for none, and make one up
            for quantity in ("centre of mass", "inertia"):
                book.facts.pop(Key("body", body.name, quantity), None)
        book.put("body", body.name, {"usd:type": "Xform"} | rigid_body_words(options.rigid_body))
        if body.name in weightless:
            book.put("body", body.name, {"usd:physxRigidBody:disableGravity": True})
    starts = dict(initial_pose(tree, control).joints)
    touching, sprung = _jointed_that_touch(reference), as_drives(control)
    soft = dict(control.soft_limits)
    for name, (stiffness, damping) in limit_springs(tree, control).items():
        book.put("joint", name, {
            "usd:newton:limitStiffness": stiffness,
            "usd:newton:limitDamping": damping,
            "usd:solreflimit": soft[name].solref if name in soft else SOLREF,
            "usd:solimplimit": soft[name].solimp if name in soft else SOLIMP,
        })  # fmt: skip
    for joint in tree.joints:
        book.put("joint", joint.name, {
            "usd:child pose": pose_value(joint.X_parent_joint),
            "usd:collisionEnabled": frozenset((joint.parent, joint.child)) in touching,
        })  # fmt: skip
        if joint.kind in MOVING:
            _driven(joint, control.by_joint.get(joint.name), starts[joint.name], options, book)
            if joint.name in sprung:
                rest = sprung[joint.name].rest
                book.put("joint", joint.name, {
                    "kp": sprung[joint.name].stiffness, "drive target": rest,
                    "usd:drive type": "force", "usd:targetVelocity": 0.0,
                })  # fmt: skip
            _mimic(tree, joint, options, book)
    for loop in control.loops:
        ends = frozenset((loop.a.body, loop.b.body))
        book.put("loop", loop.name, {
            "usd:collisionEnabled": ends in touching,
            "usd:solref": loop.solref,
            "usd:solimp": loop.solimp,
        })  # fmt: skip
        if loop.kind == "connect":
            book.put("loop", loop.name, {"usd:torqueScale": 0.0})
    for camera in control.cameras:
        width, height = camera.resolution
        book.put("camera", camera.name, {
            "usd:aspect": width / height, "usd:clippingRange": CLIPPING_M,
        })  # fmt: skip
    expected_actuators(control.actuators, book)
    expected_metadata(robot, reference, book)
    expected_schema(reference, options, book)
    for shape in reference.shapes.shapes:
        _shape(shape, reference, options, book)
    _shape_pairs(reference, book)
    for material in reference.shapes.materials:
        _material(material, reference, book)
    _identifiers(reference, book)
    book.facts |= dict(inventory(robot, reference, book.facts))
    return book.table()


# --- stage and root --------------------------------------------------------------------------


def _stage(robot: str, reference: Reference, book: Writer) -> None:
    """Metres, kilograms, z up, in every layer; physics in a variant that is selected."""
    identifier = usd_identifier(robot)
    book.put("robot", "", {"up axis": "Z", "metres per unit": 1.0, "kilograms per unit": 1.0})
    book.put("stage", "", {
        "usd:defaultPrim": identifier,
        "usd:displayName": robot if identifier != robot else None,
        "usd:kind": "component",
        "usd:extentsHint": "its bounds" if reference.shapes.shapes else None,
        "usd:type": "Xform",
        "usd:upAxis of layers": ("Z",),
        "usd:metersPerUnit of layers": ("1.0",),
        "usd:kilogramsPerUnit of layers": ("1.0",),
        "usd:variants of Physics": ("mujoco", "newton", "none", "physics", "physx"),
        "usd:selected Physics": "physics",
        "usd:variant Physics=none": "",
        "usd:amiss in Physics=mujoco": (),
        "usd:amiss in Physics=newton": (),
        "usd:amiss in Physics=physx": (),
    })  # fmt: skip


def _root(tree: Tree, options: UsdArticulation, book: Writer) -> None:
    """The articulation is on the root body of a floating base, else on the joint with the world."""
    fixed = tree.base == "fixed"
    touching = options.self_collisions
    book.put("robot", "", {
        "articulation root": "the joint with the world" if fixed else f"body {tree.root}",
        "self-collision": touching,
        "usd:newton:selfCollisionEnabled": touching,
        "usd:robot prim pose": pose_value(tree.X_world_root if fixed else IDENTITY),
        "usd:physxArticulation:solverPositionIterationCount":
            float(options.solver_position_iterations),
        "usd:physxArticulation:solverVelocityIterationCount":
            float(options.solver_velocity_iterations or 0),
        "usd:physxArticulation:sleepThreshold": options.sleep_threshold,
        "usd:physxArticulation:stabilizationThreshold": options.stabilization_threshold,
    })  # fmt: skip
    if fixed:
        book.put("robot", "", {
            "usd:world joint holds": tree.root,
            "usd:world joint pose": pose_value(tree.X_world_root),
        })  # fmt: skip


def rigid_body_words(options: UsdRigidBody) -> dict[str, Value]:
    """What PhysX adds to every body; m, s, rad."""
    return {
        "usd:physxRigidBody:linearDamping": options.linear_damping,
        "usd:physxRigidBody:angularDamping": options.angular_damping,
        "usd:physxRigidBody:maxLinearVelocity": options.max_linear_velocity,
        "usd:physxRigidBody:maxAngularVelocity": options.max_angular_velocity,
        "usd:physxRigidBody:maxDepenetrationVelocity": options.max_depenetration_velocity,
    }


# --- joints ----------------------------------------------------------------------------------


def _driven(
    joint: Joint, row: Actuator | None, start: float, options: UsdOptions, book: Writer
) -> None:
    """Gains where the simulator integrates the drive; all models but `passive` have a drive.

    The others compute an effort outside of it, so its drive must add none.
    """
    name, facts = joint.name, book.facts
    model = row.model if row else "passive"
    armature, friction, damping, velocity = (
        facts[Key("joint", name, quantity)]
        for quantity in ("armature", "friction", "damping", "velocity")
    )
    book.put("joint", name, {
        "start": start,
        "usd:dynamicFrictionEffort": friction,
        "usd:physxJoint:armature": armature,
        "usd:physxJoint:jointFriction": friction,
        "usd:physxJoint:maxJointVelocity": velocity,
        "usd:newton:armature": armature,
        "usd:newton:friction": friction,
        "usd:newton:damping": damping,
        "usd:newton:velocityLimit": velocity,
    })  # fmt: skip
    book.put("joint", name, {
        "kp": row.kp if row and model == "pd" else 0.0,
        "kd": row.kd if row and model in ("pd", "velocity") else 0.0,
        "effort": row.effort if row and model != "passive" else None,
        "drive target": start if model == "pd" else None,
    })  # fmt: skip
    if model != "passive":
        book.put("joint", name, {
            "usd:drive type": options.drive_type, "usd:targetVelocity": 0.0,
        })  # fmt: skip


def _mimic(tree: Tree, joint: Joint, options: UsdOptions, book: Writer) -> None:
    """`mimics: false` couples none."""
    if joint.mimic is None:
        return
    if not options.mimics:
        for quantity in ("mimics", "mimic multiplier", "mimic offset"):
            book.facts.pop(Key("joint", joint.name, quantity), None)
        return
    first = first_leader(tree, joint.mimic)
    book.put("joint", joint.name, {
        "usd:newton:mimicJoint": first.joint,
        "usd:newton:mimicCoef0": first.offset,
        "usd:newton:mimicCoef1": first.multiplier,
        "usd:mimic axis": "the joint's own",
        "usd:reference axis": "the joint's own",
    })  # fmt: skip


# --- shapes ----------------------------------------------------------------------------------


def _shape(shape: Shape, reference: Reference, options: UsdOptions, book: Writer) -> None:
    """Colliders are hulls and guides, which no picture shows; visual meshes are shared."""
    collides = shape.role == "collision"
    facts: dict[str, Value] = {
        "usd:purpose": "guide" if collides else "default",
        "usd:group": "collisions" if collides else "visuals",
        "usd:extent": "its bounds",
    }
    if collides or shape.material is not None:
        facts["usd:binding strength"] = "weakerThanDescendants"
    if isinstance(shape.geometry, Mesh):
        # Any other scheme would smooth it; shells that are open show from both sides in MuJoCo.
        facts |= {"usd:subdivisionScheme": "none", "usd:doubleSided": True}
        facts |= _normals(shape, shape.geometry.mesh, reference)
        if collides:
            facts |= {"usd:approximation": "convexHull", "usd:hullVertexLimit": HULL_VERTICES}
        elif options.instanceable:
            facts["usd:instanceable"] = True
    if collides:
        surface = dict(reference.control.contacts).get(shape.name, reference.control.contact)
        facts["collides"] = bool(surface.mask or surface.partners)
        facts["usd:dynamicFriction"] = surface.friction[0]
        facts["usd:frictionCombineMode"] = "max"
        if surface.margin or surface.gap:
            facts["usd:newton:contactMargin"] = surface.margin
            facts["usd:newton:contactGap"] = surface.gap or None
    book.put("shape", shape.name, facts)


def _normals(shape: Shape, mesh: str, reference: Reference) -> dict[str, Value]:
    """Its triangles; the normals that the mesh states, in its body's axes, else its faces'."""
    surface = dict(reference.assets.surfaces)[mesh]
    facts: dict[str, Value] = {f"usd:{SKETCH}": surface.sketch or None}
    if not surface.normals:
        return facts | {"usd:normals": "of its faces"}
    _, pose = reference.tree.shape_placement(shape)
    normals = surface.moved(pose).normals
    return facts | {"usd:normals": "of its corners", "usd:corner normals": normals}


def _solid_bodies(reference: Reference) -> dict[str, list[Shape]]:
    found: dict[str, list[Shape]] = {}
    for shape in reference.shapes.of("collision"):
        found.setdefault(reference.tree.placement(shape.link)[0], []).append(shape)
    return found


def _filtered(reference: Reference) -> set[frozenset[str]]:
    pairs = filtered_pairs(reference.tree, reference.shapes, reference.control)
    return {frozenset(pair) for pair in pairs}


def _jointed_that_touch(reference: Reference) -> set[frozenset[str]]:
    """A joint's flag lets its two bodies touch: where both have shapes and nothing filters them."""
    solid, filtered = _solid_bodies(reference), _filtered(reference)
    ends = [frozenset((joint.parent, joint.child)) for joint in reference.tree.joints]
    ends += [frozenset((loop.a.body, loop.b.body)) for loop in reference.control.loops]
    return {pair for pair in ends if pair <= set(solid) and pair not in filtered}


def _shape_pairs(reference: Reference, book: Writer) -> None:
    """Single shapes whose masks never meet, of bodies that may touch otherwise."""
    solid, filtered = _solid_bodies(reference), _filtered(reference)
    own, common = dict(reference.control.contacts), reference.control.contact
    for one, two in itertools.combinations(solid, 2):
        if frozenset((one, two)) in filtered:
            continue
        for a, b in itertools.product(solid[one], solid[two]):
            first, second = own.get(a.name, common), own.get(b.name, common)
            touch = all(s.mask or s.partners for s in (first, second))
            meet = first.mask & second.partners or second.mask & first.partners
            if touch and not meet:
                book.put("shape pair", pair_name(a.name, b.name), {"usd:filtered": True})


SHADERS: dict[str, dict[str, str]] = {
    "UsdPreviewSurface": {
        "inputs:diffuseColor": "color3f", "inputs:opacity": "float", "inputs:roughness": "float",
        "inputs:metallic": "float", "outputs:surface": "token",
    },
    "UsdPrimvarReader_float2": {"inputs:varname": "string", "outputs:result": "float2"},
    "UsdUVTexture": {
        "inputs:file": "asset", "inputs:sourceColorSpace": "token", "inputs:wrapS": "token",
        "inputs:wrapT": "token", "inputs:scale": "float4", "inputs:st": "float2",
        "outputs:rgb": "float3",
    },
}  # fmt: skip
"""Types of the inputs and outputs by kind of shader, as their specification has them."""


# --- materials -------------------------------------------------------------------------------


def _material(material: Material, reference: Reference, book: Writer) -> None:
    """UsdPreviewSurface with its own defaults; a picture repeats beyond its edge, as in MuJoCo."""
    facts: dict[str, Value] = {
        "usd:surface source": "UsdPreviewSurface surface",
        "usd:UsdPreviewSurface:roughness": 0.5,
        "usd:UsdPreviewSurface:metallic": 0.0,
    }
    if material.texture is not None:
        facts |= {
            "usd:UsdPreviewSurface:diffuseColor source": "UsdUVTexture rgb",
            "usd:UsdUVTexture:st source": "UsdPrimvarReader_float2 result",
            "usd:UsdUVTexture:sourceColorSpace": "sRGB",
            "usd:UsdUVTexture:wrapS": "repeat",
            "usd:UsdUVTexture:wrapT": "repeat",
            "usd:UsdUVTexture:scale": (*material.rgba[:3], 1.0),  # the colour tints the picture
            "usd:UsdPrimvarReader_float2:varname": "st",
        }
    kinds = list(SHADERS) if material.texture is not None else ["UsdPreviewSurface"]
    for kind in kinds:
        facts |= {f"usd:{kind}:type of {port}": name for port, name in SHADERS[kind].items()}
    shapes = reference.shapes.of("visual")
    if material.name not in {shape.material for shape in shapes}:
        facts["usd:rgba"] = tuple(material.rgba)
        facts["usd:texture"] = dict(reference.assets.pixels).get(material.texture or "")
    book.put("material", material.name, facts)


def _identifiers(reference: Reference, book: Writer) -> None:
    """Identifiers of what has a name that USD does not allow."""
    tree, shapes = reference.tree, reference.shapes
    for kind, names in (
        ("body", body_identifiers(tree)),
        ("joint", joint_identifiers(tree)),
        ("loop", loop_identifiers(reference.control.loops)),
        ("frame", frame_identifiers(tree)),
        ("camera", camera_identifiers(tree, reference.control.cameras)),
        ("shape", usd_identifiers(s.name for s in shapes.shapes)),
        ("material", usd_identifiers(m.name for m in shapes.materials)),
    ):
        for name, identifier in names.items():
            if name != identifier:
                book.put(kind, name, {"usd:identifier": identifier})
