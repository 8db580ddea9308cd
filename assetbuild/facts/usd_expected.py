"""What a USD of the robot must say: its facts in what USD can hold, and the words of the format.

Derived from the robot and from the recipe's `usd` alone.
"""

from __future__ import annotations

import itertools
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
from assetbuild.facts.reference import Reference, filtered_pairs, pose_value
from assetbuild.facts.table import Key, Table, Value, Writer, pair_name
from assetbuild.facts.usd_options import rigid_of, solver_of, touches_itself
from assetbuild.robot.model import MOVING, Actuator, Camera, Contact, Joint
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import Mesh, Shape

HULL_VERTICES = 64.0
"""Most vertices of a convex hull that PhysX collides on a GPU."""
CLIPPING_M = (0.01, 1000.0)
"""Nearest and farthest depth that a camera sees."""
ROOT_JOINT = "root_joint"
SOLVER = {
    "solver_position_iterations": "solverPositionIterationCount",
    "solver_velocity_iterations": "solverVelocityIterationCount",
    "sleep_threshold": "sleepThreshold",
    "stabilization_threshold": "stabilizationThreshold",
}
RIGID = {
    "linear_damping": "linearDamping",
    "angular_damping": "angularDamping",
    "max_linear_velocity": "maxLinearVelocity",
    "max_angular_velocity": "maxAngularVelocity",
    "max_depenetration_velocity": "maxDepenetrationVelocity",
}
"""Keys of the recipe's `usd.articulation` and `usd.rigid_body` -> PhysX's attributes."""
Options = Mapping[str, Any]  # Any: plain JSON


def usd_table(own: Table, reference: Reference) -> Table:
    """Everything that `<robot>.usda` says. own: the robot's facts that USD holds."""
    options: Options = reference.options.get("usd") or {}
    return _Expectation(own, reference, options).table()


class _Expectation:
    """The table as it grows."""

    def __init__(self, own: Table, reference: Reference, options: Options) -> None:
        self._book, self._reference, self._options = Writer(), reference, options
        self._book.facts |= own.facts
        self._tree, self._control = reference.tree, reference.control
        self._starts = dict(start_of(self._tree, self._control).joints)
        self._springs = free_springs(self._control)
        self._stiff = limit_springs(self._tree, self._control)
        self._surfaces = dict(self._control.contacts)
        self._solid: dict[str, list[Shape]] = {}
        for shape in reference.shapes.of("collision"):
            self._solid.setdefault(self._tree.placement(shape.link)[0], []).append(shape)
        pairs = filtered_pairs(self._tree, reference.shapes, self._control)
        self._filtered = {frozenset(pair) for pair in pairs}

    def table(self) -> Table:
        """All facts."""
        put = self._book.put
        put("robot", "", dict(self._root()) | self._engines() | self._listed())
        self._bodies()
        for joint in self._tree.joints:
            self._joint(joint)
        for loop in self._control.loops:
            put("loop", loop.name, {
                "usd:collisionEnabled": self._touch(loop.a.body, loop.b.body),
                "usd:solref": loop.solref, "usd:solimp": loop.solimp,
            })  # fmt: skip
            if loop.kind == "connect":  # a weld that leaves the turn free
                put("loop", loop.name, {"usd:torqueScale": 0.0})
        for camera in self._control.cameras:
            put("camera", camera.name, _camera(camera))
        for shape in self._reference.shapes.shapes:
            put("shape", shape.name, self._shown(shape))
            if shape.role == "collision":
                put("shape", shape.name, self._collider(shape))
        for a, b in self._shape_pairs():
            put("shape pair", pair_name(a, b), {"usd:filtered": True})
        return self._book.table()

    # --- root and bodies

    def _root(self) -> Iterator[tuple[str, Value]]:
        """The articulation is on the root body of a floating base, else on what holds the base."""
        tree, solver = self._tree, solver_of(self._reference)
        fixed, touching = tree.base == "fixed", touches_itself(self._reference)
        yield from (("up axis", "Z"), ("metres per unit", 1.0), ("kilograms per unit", 1.0))
        yield "articulation root", "the joint with the world" if fixed else f"body {tree.root}"
        yield "usd:stated units", ("upAxis", "metersPerUnit", "kilogramsPerUnit")
        yield "usd:robot prim pose", pose_value(tree.X_world_root if fixed else IDENTITY)
        yield "usd:placed", tree.X_world_root != IDENTITY
        yield from (("self-collision", touching), ("usd:newton:selfCollisionEnabled", touching))
        yield from ((f"usd:physxArticulation:{SOLVER[key]}", v) for key, v in solver.items())
        if fixed:
            yield "usd:world joint holds", tree.root
            yield "usd:world joint pose", pose_value(tree.X_world_root)

    def _engines(self) -> dict[str, Value]:
        """Whose words each variant has. MuJoCo's are those of limits, loops and contacts."""
        soft = self._control.loops or self._solid or self._stiff
        newton = ("newton", "mjc") if soft else ("newton",)
        held = {"none": (), "physics": ("physx", *newton), "physx": ("physx",), "newton": newton,
                "mujoco": newton}  # fmt: skip
        return {f"usd:engines of {variant}": engines for variant, engines in held.items()}

    def _listed(self) -> dict[str, Value]:
        """Isaac Sim's lists: a body and its frames; what holds a fixed base, then the joints."""
        tree = self._tree
        frames = {body: [f.name for f in tree.frames if f.body == body] for body in tree.by_body}
        links = [name for body, own in frames.items() for name in (body, *own)]
        held = [ROOT_JOINT] if tree.base == "fixed" else []
        return {"usd:isaac links": tuple(links), "usd:isaac joints": (*held, *tree.by_joint)}

    def _bodies(self) -> None:
        light, rigid = weightless(self._control), rigid_of(self._reference)
        words = {f"usd:physxRigidBody:{RIGID[key]}": value for key, value in rigid.items()}
        for body in self._tree.bodies:
            if body.is_massless:  # PhysX would take a mass of 0 for none, and make one up
                for quantity in ("centre of mass", "inertia"):
                    self._book.facts.pop(Key("body", body.name, quantity), None)
            self._book.put("body", body.name, words)
            if body.name in light:
                self._book.put("body", body.name, {"usd:physxRigidBody:disableGravity": True})

    # --- joints

    def _joint(self, joint: Joint) -> None:
        name, row = joint.name, self._control.by_joint.get(joint.name)
        self._book.put("joint", name, {
            "usd:child pose": pose_value(joint.X_parent_joint),
            "usd:collisionEnabled": self._touch(joint.parent, joint.child),
        })  # fmt: skip
        if joint.kind in MOVING:
            self._book.put("joint", name, self._brakes(name) | self._driven(name, row))
            law = explicit_law(row) if row else {}
            self._book.put("joint", name, {f"usd:actuator {word}": v for word, v in law.items()})
            self._limits(name)
        if joint.mimic is not None:
            self._mimic(joint)

    def _brakes(self, name: str) -> dict[str, Value]:
        """What PhysX' older schema and Newton say again."""
        armature, friction, damping, velocity = (
            self._book.facts[Key("joint", name, quantity)]
            for quantity in ("armature", "friction", "damping", "velocity")
        )
        return {
            "usd:physxJointAxis:dynamicFrictionEffort": friction,
            "usd:physxJoint:armature": armature,
            "usd:physxJoint:jointFriction": friction,
            "usd:physxJoint:maxJointVelocity": velocity,
            "usd:newton:armature": armature,
            "usd:newton:friction": friction,
            "usd:newton:damping": damping,
            "usd:newton:velocityLimit": velocity,
        }

    def _driven(self, name: str, row: Actuator | None) -> dict[str, Value]:
        """Gains where the simulator integrates the drive; all models but `passive` have a drive.

        The others compute an effort outside of it, so its drive must add none. A spring is the
        drive of a joint that has no other.
        """
        model = row.model if row else "passive"
        start, spring = self._starts[name], self._springs.get(name)
        facts: dict[str, Value] = {"start": start, "kp": 0.0, "kd": 0.0, "effort": None}
        if spring is not None:
            facts |= {"kp": spring[0], "drive target": spring[1], "usd:drive type": "force"}
        elif row and model != "passive":
            facts |= {
                "kp": row.kp if model == "pd" else 0.0,
                "kd": row.kd if model in ("pd", "velocity") else 0.0,
                "effort": row.effort,
                "drive target": start if model == "pd" else None,
                "usd:drive type": self._options.get("drive_type", "force"),
            }
        return facts | ({"usd:targetVelocity": 0.0} if "usd:drive type" in facts else {})

    def _limits(self, name: str) -> None:
        """How soft Newton and MuJoCo hold the limits."""
        soft = dict(self._control.soft_limits).get(name)
        if name in self._stiff:
            self._book.put("joint", name, {
                "usd:newton:limitStiffness": self._stiff[name][0],
                "usd:newton:limitDamping": self._stiff[name][1],
                "usd:solreflimit": soft.solref if soft else SOLREF,
                "usd:solimplimit": soft.solimp if soft else SOLIMP,
            })  # fmt: skip

    def _mimic(self, joint: Joint) -> None:
        """`mimics: false` couples none. Newton follows the joint at the head of a chain."""
        if not self._options.get("mimics", True):
            for quantity in ("mimics", "mimic multiplier", "mimic offset"):
                self._book.facts.pop(Key("joint", joint.name, quantity), None)
        elif joint.mimic is not None:
            first = leader_of(self._tree, joint.mimic)
            self._book.put("joint", joint.name, {
                "usd:newton:mimics": first.joint,
                "usd:newton:mimic offset": first.offset,
                "usd:newton:mimic multiplier": first.multiplier,
                "usd:mimic axis": "the joint's own",
                "usd:reference axis": "the joint's own",
            })  # fmt: skip

    # --- shapes

    def _shown(self, shape: Shape) -> dict[str, Value]:
        """Colliders are hidden; meshes are often open shells, so that both sides are shown.

        A mesh without normals of its own is shown flat.
        """
        purpose = "guide" if shape.role == "collision" else "default"
        facts: dict[str, Value] = {"usd:purpose": purpose, "usd:extent": True}
        if shape.role == "visual" and shape.material is not None:
            facts["usd:gloss"] = (0.5, 0.0)  # half rough and no metal, as in other viewers
        if isinstance(shape.geometry, Mesh):
            surface = dict(self._reference.assets.surfaces)[shape.geometry.mesh]
            facts["usd:doubleSided"] = True
            if shape.role == "visual":
                facts["usd:shared"] = self._options.get("instanceable", True)
            facts["usd:normals"] = surface.normals or "along its faces"
        return facts

    def _collider(self, shape: Shape) -> dict[str, Value]:
        """Meshes are their hulls; the larger friction of two surfaces acts, as in MuJoCo."""
        surface = self._surface(shape)
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

    def _surface(self, shape: Shape) -> Contact:
        return self._surfaces.get(shape.name, self._control.contact)

    def _touch(self, one: str, other: str) -> bool:
        """A joint's flag lets its bodies touch: where both have shapes and nothing filters them."""
        pair = frozenset((one, other))
        return pair <= set(self._solid) and pair not in self._filtered

    def _shape_pairs(self) -> Iterator[tuple[str, str]]:
        """Single shapes whose masks never meet, of bodies that may touch otherwise."""
        for one, two in itertools.combinations(self._solid, 2):
            if frozenset((one, two)) in self._filtered:
                continue
            for a, b in itertools.product(self._solid[one], self._solid[two]):
                first, second = self._surface(a), self._surface(b)
                touch = all(s.mask or s.partners for s in (first, second))
                meet = first.mask & second.partners or second.mask & first.partners
                if touch and not meet:
                    yield a.name, b.name


def _camera(camera: Camera) -> dict[str, Value]:
    width, height = camera.resolution
    return {"usd:aspect": width / height, "usd:clippingRange": CLIPPING_M}
