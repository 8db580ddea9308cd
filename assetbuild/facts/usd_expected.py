"""What a USD of the robot must say: its facts in what USD can hold, and the words of the format.

Derived from the robot and from the recipe's `usd` alone.
"""

from __future__ import annotations

import itertools

from assetbuild.facts.reference import SOLIMP, SOLREF, Reference, filtered_pairs, pose_value
from assetbuild.facts.table import Key, Table, Value, Writer, pair_name
from assetbuild.facts.usd_actuators import explicit_law, spelled
from assetbuild.facts.usd_isaac import expected_schema
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.joint_springs import as_drives
from assetbuild.robot.lost_motion import whole_gravity
from assetbuild.robot.mimic import first_leader
from assetbuild.robot.model import MOVING, Actuator, Camera, Joint, Loop
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import Mesh, Shape
from assetbuild.robot.softness import limit_springs
from assetbuild.simulators.usd_options import UsdOptions

HULL_VERTICES = 64.0
"""Most vertices of a convex hull that PhysX collides on a GPU."""
CLIPPING_M = (0.01, 1000.0)
"""Nearest and farthest depth that a camera sees."""


def usd_table(own: Table, reference: Reference) -> Table:
    """Everything that `<robot>.usda` says. own: the robot's facts that USD holds."""
    book = Writer()
    book.facts |= own.facts
    tree, control = reference.tree, reference.control
    options = UsdOptions.model_validate(reference.options.get("usd") or {})
    touching = _jointed_that_touch(reference)
    _root(reference, options, book)
    _engines(reference, book)
    expected_schema(tree, book)
    _bodies(reference, options, book)
    _limit_springs(reference, book)
    for joint in tree.joints:
        book.put("joint", joint.name, {
            "usd:child pose": pose_value(joint.X_parent_joint),
            "usd:collisionEnabled": frozenset((joint.parent, joint.child)) in touching,
        })  # fmt: skip
        _mimic(joint, reference, options, book)
    _drives(reference, options, book)
    for loop in control.loops:
        book.put("loop", loop.name, _loop(loop, touches=frozenset(
            (loop.a.body, loop.b.body)) in touching))  # fmt: skip
    for camera in control.cameras:
        book.put("camera", camera.name, _camera(camera))
    for shape in reference.shapes.of("collision"):
        book.put("shape", shape.name, _collider(shape, reference))
    _shape_pairs(reference, book)
    return book.table()


# --- root and bodies


def _root(reference: Reference, options: UsdOptions, book: Writer) -> None:
    """The articulation is on the root body of a floating base, else on the joint with the world.

    PhysX holds the light rods of loops with 16 velocity iterations, any other robot with 1.
    """
    tree, articulation = reference.tree, options.articulation
    fixed, touching = tree.base == "fixed", articulation.self_collisions
    velocity = articulation.solver_velocity_iterations
    if velocity is None:
        velocity = 16 if reference.control.loops else 1
    book.put("robot", "", {
        "up axis": "Z",
        "metres per unit": 1.0,
        "kilograms per unit": 1.0,
        "articulation root": "the joint with the world" if fixed else f"body {tree.root}",
        "usd:robot prim pose": pose_value(tree.X_world_root if fixed else IDENTITY),
        "self-collision": touching,
        "usd:newton:selfCollisionEnabled": touching,
        "usd:physxArticulation:solverPositionIterationCount":
            float(articulation.solver_position_iterations),
        "usd:physxArticulation:solverVelocityIterationCount": float(velocity),
        "usd:physxArticulation:sleepThreshold": articulation.sleep_threshold,
        "usd:physxArticulation:stabilizationThreshold": articulation.stabilization_threshold,
    })  # fmt: skip
    if fixed:
        book.put("robot", "", {
            "usd:world joint holds": tree.root,
            "usd:world joint pose": pose_value(tree.X_world_root),
        })  # fmt: skip


def _engines(reference: Reference, book: Writer) -> None:
    """Whose words each variant has. MuJoCo's are those of limits, loops and contacts."""
    control, colliders = reference.control, reference.shapes.of("collision")
    soft = control.loops or colliders or limit_springs(reference.tree, control)
    newton = ("newton", "mjc") if soft else ("newton",)
    book.put("robot", "", {
        "usd:engines of none": (),
        "usd:engines of physics": ("physx", *newton),
        "usd:engines of physx": ("physx",),
        "usd:engines of newton": newton,
        "usd:engines of mujoco": newton,
    })  # fmt: skip


def _bodies(reference: Reference, options: UsdOptions, book: Writer) -> None:
    weightless, words = whole_gravity(reference.control.mjcf_only), options.rigid_body
    for body in reference.tree.bodies:
        if body.is_massless:  # PhysX would take a mass of 0 for none, and make one up
            for quantity in ("centre of mass", "inertia"):
                book.facts.pop(Key("body", body.name, quantity), None)
        book.put("body", body.name, {
            "usd:physxRigidBody:linearDamping": words.linear_damping,
            "usd:physxRigidBody:angularDamping": words.angular_damping,
            "usd:physxRigidBody:maxLinearVelocity": words.max_linear_velocity,
            "usd:physxRigidBody:maxAngularVelocity": words.max_angular_velocity,
            "usd:physxRigidBody:maxDepenetrationVelocity": words.max_depenetration_velocity,
        })  # fmt: skip
        if body.name in weightless:
            book.put("body", body.name, {"usd:physxRigidBody:disableGravity": True})


def _camera(camera: Camera) -> dict[str, Value]:
    width, height = camera.resolution
    return {"usd:aspect": width / height, "usd:clippingRange": CLIPPING_M}


# --- joints


def _limit_springs(reference: Reference, book: Writer) -> None:
    """How soft Newton and MuJoCo hold the limits."""
    soft = dict(reference.control.soft_limits)
    springs = limit_springs(reference.tree, reference.control)
    for name, (stiffness, damping) in springs.items():
        book.put("joint", name, {
            "usd:newton:limitStiffness": stiffness,
            "usd:newton:limitDamping": damping,
            "usd:solreflimit": soft[name].solref if name in soft else SOLREF,
            "usd:solimplimit": soft[name].solimp if name in soft else SOLIMP,
        })  # fmt: skip


def _drives(reference: Reference, options: UsdOptions, book: Writer) -> None:
    tree, control = reference.tree, reference.control
    starts = dict(initial_pose(tree, control).joints)
    for joint in tree.joints:
        if joint.kind in MOVING:
            row = control.by_joint.get(joint.name)
            _driven(joint, row, starts[joint.name], options, book)
            book.put("joint", joint.name, spelled(explicit_law(row)) if row else {})
    for name, spring in as_drives(control).items():
        book.put("joint", name, {
            "kp": spring.stiffness, "drive target": spring.rest,
            "usd:drive type": "force", "usd:targetVelocity": 0.0,
        })  # fmt: skip


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
        "usd:physxJointAxis:dynamicFrictionEffort": friction,
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


def _mimic(joint: Joint, reference: Reference, options: UsdOptions, book: Writer) -> None:
    """`mimics: false` couples none. Newton follows the joint at the head of a chain."""
    if joint.mimic is None:
        return
    if not options.mimics:
        for quantity in ("mimics", "mimic multiplier", "mimic offset"):
            book.facts.pop(Key("joint", joint.name, quantity), None)
        return
    first = first_leader(reference.tree, joint.mimic)
    book.put("joint", joint.name, {
        "usd:newton:mimics": first.joint,
        "usd:newton:mimic offset": first.offset,
        "usd:newton:mimic multiplier": first.multiplier,
        "usd:mimic axis": "the joint's own",
        "usd:reference axis": "the joint's own",
    })  # fmt: skip


def _loop(loop: Loop, *, touches: bool) -> dict[str, Value]:
    """A `connect` is a weld that leaves the turn free."""
    facts: dict[str, Value] = {
        "usd:collisionEnabled": touches, "usd:solref": loop.solref, "usd:solimp": loop.solimp,
    }  # fmt: skip
    return facts | ({"usd:torqueScale": 0.0} if loop.kind == "connect" else {})


# --- colliders


def _collider(shape: Shape, reference: Reference) -> dict[str, Value]:
    """Meshes are their hulls; the larger friction of two surfaces acts, as in MuJoCo."""
    surface = dict(reference.control.contacts).get(shape.name, reference.control.contact)
    facts: dict[str, Value] = {
        "collides": bool(surface.mask or surface.partners),
        "usd:dynamicFriction": surface.friction[0],
        "usd:frictionCombineMode": "max",
    }
    if isinstance(shape.geometry, Mesh):
        facts |= {"usd:approximation": "convexHull", "usd:hullVertexLimit": HULL_VERTICES}
    if surface.margin or surface.gap:
        facts["usd:newton:contactMargin"] = surface.margin
        facts["usd:newton:contactGap"] = surface.gap or None
    return facts


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
