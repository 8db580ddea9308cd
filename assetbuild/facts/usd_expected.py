"""What a USD of the robot must say: its facts in what USD can hold, and the words of the format.

Derived from the robot and from the recipe's `usd` alone.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

from assetbuild.facts.derived import (
    SOLIMP,
    SOLREF,
    explicit_law,
    free_springs,
    leader_of,
    limit_springs,
    start_of,
    weightless,
)
from assetbuild.facts.reference import (
    Reference,
    filtered_pairs,
    masks_meet,
    mimic_facts,
    pose_value,
)
from assetbuild.facts.table import Key, Table, Value, pair_name
from assetbuild.grouping import grouped
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import MOVING, Actuator, Contact, Mimic, Tree
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import Mesh, Shape

HULL_LIMIT = "usd:physxConvexHullCollision:hullVertexLimit"
HULL_VERTICES = 64.0
"""Most vertices of a convex hull that PhysX collides on a GPU."""
WORLD_JOINT = "root_joint"
"""The prim of the joint that holds a fixed base."""
ENGINES = "physxJointAxis, physxJoint, newton"
"""Whose words say what brakes a joint."""
DEPTHS_M = (0.01, 1000.0)
"""Nearest and farthest that a camera sees."""
DEGREE = math.pi / 180.0
"""rad; what engines alone know stands in the file's own units."""
SOLVER = {
    "solver_position_iterations": ("solverPositionIterationCount", 8),
    "solver_velocity_iterations": ("solverVelocityIterationCount", None),
    "sleep_threshold": ("sleepThreshold", 0.0),
    "stabilization_threshold": ("stabilizationThreshold", 0.0),
}
RIGID = {
    "linear_damping": ("linearDamping", 0.0),
    "angular_damping": ("angularDamping", 0.0),
    "max_linear_velocity": ("maxLinearVelocity", 1000.0),
    "max_angular_velocity": ("maxAngularVelocity", 1000.0),
    "max_depenetration_velocity": ("maxDepenetrationVelocity", 1.0),
}
"""Keys of the recipe's `usd.articulation` and `usd.rigid_body` -> PhysX's attributes, and what
holds where the recipe says nothing."""
Options = Mapping[str, Any]  # Any: plain JSON


def usd_table(robot_facts: Table, reference: Reference) -> Table:
    """Everything that `<robot>.usda` says. robot_facts: the robot's facts that USD holds."""
    options: Options = reference.options.get("usd") or {}
    tree, control, table = reference.tree, reference.control, Table()
    table.facts |= robot_facts.facts
    table.put("robot", "", _root(reference))
    root = ("robot", "") if tree.base == "fixed" else ("body", tree.root)
    solver = solver_of(reference).items()
    table.put(*root, {f"usd:physxArticulation:{SOLVER[key][0]}": v for key, v in solver})
    table.put(*root, {"usd:newton:selfCollisionEnabled": touches_itself(reference)})
    _bodies(reference, table)
    _joints(reference, options, table)
    for loop in control.loops:  # a `connect` is a weld that leaves the turn free
        free: dict[str, Value] = {"usd:mjc:torqueScale": 0.0} if loop.kind == "connect" else {}
        softness: dict[str, Value] = {"usd:mjc:solref": loop.solref, "usd:mjc:solimp": loop.solimp}
        table.put("loop", loop.name, softness | free)
    for camera in control.cameras:
        width, height = camera.resolution
        table.put("camera", camera.name, {"usd:aspect": width / height, "usd:depths": DEPTHS_M})
    own_surfaces = dict(control.contacts)
    for shape in reference.shapes.shapes:
        instanced = shape.role == "visual" and options.get("instanceable", True)
        table.put("shape", shape.name, _drawn(shape, instanced=instanced))
    for shape in reference.shapes.of("collision"):
        surface = own_surfaces.get(shape.name, control.contact)
        table.put("shape", shape.name, _collider(shape, surface))
    for a, b in _shape_pairs(reference):
        table.put("shape pair", pair_name(a, b), {"usd:filtered": True})
    return table


# --- what PhysX is asked for


def solver_of(reference: Reference) -> dict[str, float]:
    """How PhysX solves: the light rods of loops need 16 velocity iterations, others 1."""
    stated = _stated(reference, "articulation")
    usual = 16 if reference.control.loops else 1
    options = {key: stated.get(key, value) for key, (_, value) in SOLVER.items()}
    return {key: float(usual if value is None else value) for key, value in options.items()}


def rigid_of(reference: Reference) -> dict[str, float]:
    """What PhysX adds to every body."""
    stated = _stated(reference, "rigid_body")
    return {key: float(stated.get(key, value)) for key, (_, value) in RIGID.items()}


def touches_itself(reference: Reference) -> bool:
    """Whether parts of the robot touch one another."""
    return bool(_stated(reference, "articulation").get("self_collisions", True))


def _stated(reference: Reference, section: str) -> Options:
    options: Options = (reference.options.get("usd") or {}).get(section) or {}
    return options


# --- root and bodies


def _root(reference: Reference) -> dict[str, Value]:
    """The articulation is on the root body of a floating base, else on what holds the base."""
    tree = reference.tree
    fixed = tree.base == "fixed"
    joints: Value = (*((WORLD_JOINT,) if fixed else ()), *tree.by_joint)
    frames = grouped(tree.frames, lambda frame: frame.body)  # each body has its own behind it
    links = [(b.name, *(f.name for f in frames.get(b.name, ()))) for b in tree.bodies]
    held: dict[str, Value] = {
        "usd:world joint holds": tree.root,
        "usd:world joint pose": pose_value(tree.X_world_root),
    }
    return {
        "up axis": "Z",
        "metres per unit": 1.0,
        "kilograms per unit": 1.0,
        "articulation root": "the joint with the world" if fixed else f"body {tree.root}",
        "usd:robot prim pose": pose_value(tree.X_world_root if fixed else IDENTITY),
        "self-collision": touches_itself(reference),
        "usd:isaac:robotType": (reference.options.get("usd") or {}).get("robot_type"),
        "usd:kind": "component",
        "usd:mass": total_mass(tree),
        "usd:rigid_body_count": len(tree.bodies),
        "usd:isaac:robotLinks": sum(links, ()),
        **({"usd:isaac:robotJoints": joints} if joints else {}),
        **(held if fixed else {}),
    }


def _bodies(reference: Reference, table: Table) -> None:
    light = weightless(reference.control)
    rigid = rigid_of(reference)
    rigid["max_angular_velocity"] /= DEGREE
    words: dict[str, Value] = {f"usd:physxRigidBody:{RIGID[key][0]}": v for key, v in rigid.items()}
    for body in reference.tree.bodies:
        if body.is_massless:  # PhysX would take a mass of 0 for none, and make one up
            for quantity in ("centre of mass", "inertia"):
                table.facts.pop(Key("body", body.name, quantity), None)
        table.put("body", body.name, words)
        if body.name in light:
            table.put("body", body.name, {"usd:physxRigidBody:disableGravity": True})


# --- joints


def _joints(reference: Reference, options: Options, table: Table) -> None:
    tree, control = reference.tree, reference.control
    starts = dict(start_of(tree, control).joints)
    springs = free_springs(control)
    for joint in tree.joints:
        name, row = joint.name, control.by_joint.get(joint.name)
        table.put("joint", name, {"usd:child pose": pose_value(joint.X_parent_joint)})
        if joint.kind in MOVING:
            drive_type = options.get("drive_type", "force")
            driven = _driven(row, starts[name], springs.get(name), drive_type)
            table.put("joint", name, driven | {"usd:engines": ENGINES})
        if row and (law := explicit_law(row)):
            words = {f"usd:newton:{word}": value for word, value in law.items()}
            table.put("actuator", name, {"usd:drives": (name,), **words})
        if joint.mimic is not None:
            _mimic(name, joint.mimic, tree, table, coupled=options.get("mimics", True))
    for name, (stiffness, damping) in limit_springs(tree, control).items():
        limit = dict(control.soft_limits).get(name)
        per_unit = 1.0 if tree.by_joint[name].kind == "prismatic" else DEGREE
        table.put("joint", name, {
            "usd:newton:limitStiffness": stiffness * per_unit,
            "usd:newton:limitDamping": damping * per_unit,
            "usd:mjc:solreflimit": limit.solref if limit else SOLREF,
            "usd:mjc:solimplimit": limit.solimp if limit else SOLIMP,
        })  # fmt: skip


def _driven(
    row: Actuator | None, start: float, spring: tuple[float, float] | None, drive_type: str
) -> dict[str, Value]:
    """Gains where the simulator integrates the drive; all models but `passive` have a drive.

    The others compute an effort outside of it, so its drive must add none. A spring is the drive
    of a joint that has no other.
    """
    model = row.model if row else "passive"
    facts: dict[str, Value] = {"start": start, "kp": 0.0, "kd": 0.0, "effort": None}
    if spring is not None:
        facts |= {"kp": spring[0], "drive target": spring[1], "usd:drive type": "force"}
    elif row and model != "passive":
        facts |= {
            "kp": row.kp if model == "pd" else 0.0,
            "kd": row.kd if model in ("pd", "velocity") else 0.0,
            "effort": row.effort,
            "drive target": start if model == "pd" else None,
            "usd:drive type": drive_type,
        }
    return facts


def _mimic(name: str, mimic: Mimic, tree: Tree, table: Table, *, coupled: bool) -> None:
    """`mimics: false` couples none. Newton follows the joint at the head of a chain."""
    if not coupled:
        for quantity in mimic_facts(mimic):
            table.facts.pop(Key("joint", name, quantity), None)
        return
    first = mimic_facts(leader_of(tree, mimic))
    table.put("joint", name, {f"usd:newton:{quantity}": v for quantity, v in first.items()})
    axes = ("usd:mimic axis", "usd:reference axis")
    table.put("joint", name, dict.fromkeys(axes, "the joint's own"))


# --- shapes


def _drawn(shape: Shape, *, instanced: bool) -> dict[str, Value]:
    """Colliders are guides; meshes are seen from both sides, as MuJoCo shows them."""
    facts: dict[str, Value] = {"usd:purpose": "guide" if shape.role == "collision" else "default"}
    if isinstance(shape.geometry, Mesh):
        facts |= {"usd:instanced": instanced, "usd:doubleSided": True}
        facts |= {"usd:subdivisionScheme": "none", "usd:normals": True}
    return facts


def _collider(shape: Shape, surface: Contact) -> dict[str, Value]:
    """Meshes are their hulls; the larger friction of two surfaces acts, as in MuJoCo."""
    facts: dict[str, Value] = {
        "collides": bool(surface.contype or surface.conaffinity),
        "usd:dynamicFriction": surface.friction[0],
        "usd:frictionCombineMode": "max",
    }
    if isinstance(shape.geometry, Mesh):
        facts |= {"usd:physics:approximation": "convexHull", HULL_LIMIT: HULL_VERTICES}
    if surface.margin or surface.gap:
        facts["usd:newton:contactMargin"] = surface.margin
        facts["usd:newton:contactGap"] = surface.gap or None
    return facts


def _shape_pairs(reference: Reference) -> Iterator[tuple[str, str]]:
    """Single shapes whose masks never meet, of bodies that may touch otherwise."""
    tree = reference.tree
    control, contacts = reference.control, dict(reference.control.contacts)
    surfaces = [
        (s, contacts.get(s.name, control.contact)) for s in reference.shapes.of("collision")
    ]
    able = [(s, surface) for s, surface in surfaces if surface.contype or surface.conaffinity]
    solid = grouped(able, lambda one: tree.placement(one[0].link)[0])
    pairs = filtered_pairs(tree, reference.shapes, control)
    filtered = {frozenset(pair) for pair in pairs}
    for one, two in itertools.combinations(solid, 2):
        if frozenset((one, two)) in filtered:
            continue
        for (a, first), (b, second) in itertools.product(solid[one], solid[two]):
            if not masks_meet(first, second):
                yield a.name, b.name
