"""Joints: what they connect, how they move, and what drives, brakes and couples them.

UsdPhysics, PhysX and Newton each have attributes of their own for armature, friction, damping,
velocity limit and mimic joints. The facts are those of PhysX 2026 (`physxJointAxis`), or of the
first of the others where that schema is not applied; what the others say is a word of the format,
in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from assetbuild.facts.reference import pose_value
from assetbuild.facts.table import Value, Writer
from assetbuild.facts.usd_actuators import CLAMPS, LAW, spelled
from assetbuild.facts.usd_prims import Places, Prim, Units, pose_of
from assetbuild.robot.pose import Array, Pose, rotation_of

TYPES = {
    "PhysicsRevoluteJoint": "rotary",
    "PhysicsPrismaticJoint": "linear",
    "PhysicsFixedJoint": "fixed",
    "PhysicsSphericalJoint": "ball",
    "PhysicsJoint": "free",
}
MOVING = ("rotary", "linear")
UNLIMITED = 1e6
"""rad or m: from here on a limit limits nothing; PhysX couples two angles only within limits."""
LIMIT_SPRING = ("limitStiffness", "limitDamping")
"""What Newton holds a joint limit with."""
SOFT_LOOP = "MjcEqualityWeldAPI"
"""How soft MuJoCo holds a loop."""
AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


class JointPrim:
    """A joint prim with what it connects.

    parent, child: paths of bodies, "" for the world; X_parent_child: at q = 0; anchor (m) and
    turn (3, 3): the joint's frame in the child.
    """

    def __init__(self, prim: Prim, names: dict[str, str], places: Places) -> None:
        self.prim, self.names, self.units = prim, names, places.units
        self.kind = TYPES.get(prim.type, prim.type)
        self.bodies = [", ".join(prim.targets(f"physics:body{side}")) for side in "01"]
        self.parent, self.child = self.bodies
        frames = [self._frame(side, places) for side in "01"]
        if self.parent and not self.child:  # held by its first body: the same joint from behind
            self.parent, self.child = self.child, self.parent
            frames.reverse()
        self.X_parent_child = frames[0] @ frames[1].inverse()
        self.anchor, self.turn = frames[1].xyz, rotation_of(frames[1].quat)
        self.touching = bool(prim.flag("physics:collisionEnabled"))
        self.closes_loop = bool(prim.flag("physics:excludeFromArticulation"))
        self.frames = frames
        self.token = prim.text("physics:axis") or "X"

    def _frame(self, side: str, places: Places) -> Pose:
        body = self.prim.prim.GetStage().GetPrimAtPath(self.bodies[int(side)] or "/")
        scale: Array = (
            np.ones(3) if not body or not self.bodies[int(side)] else places.rigid(body)[1]
        )
        position = self.prim.take(f"physics:localPos{side}")
        name = f"physics:localRot{side}"
        turn = self.prim.turned(name, self.prim.take(name))
        return pose_of(position, turn, scale * places.units.metre)

    @property
    def ends(self) -> tuple[str, ...]:
        """The bodies that it connects."""
        return tuple(body for body in (self.parent, self.child) if body)

    @property
    def holds_base(self) -> bool:
        """Whether it fixes a body to the world."""
        return self.kind == "fixed" and not self.parent and bool(self.child)

    @property
    def angular(self) -> bool:
        """Whether its coordinate is an angle."""
        return self.kind != "linear"


def joint_facts(joints: Sequence[JointPrim], units: Units, book: Writer) -> None:
    """Facts of all joints but those that hold the base; of those that close loops, as loops."""
    by_path = {joint.prim.path: joint for joint in joints}
    for joint in joints:
        if joint.holds_base:
            continue
        if joint.closes_loop:
            _loop(joint, book)
            continue
        name = joint.prim.named("joint")
        names = joint.names
        book.put("joint", name, {
            "type": joint.kind,
            "body": names.get(joint.child, joint.child),
            "parent": names.get(joint.parent, joint.parent),
            "anchor": joint.anchor,
            "usd:child pose": pose_value(joint.X_parent_child),
            "usd:collisionEnabled": joint.touching,
        })  # fmt: skip
        if joint.kind in MOVING:
            _motion(joint, name, book)
            _drive(joint, name, book)
            _passive(joint, name, book)
            _mimic(joint, name, by_path, book)


def _loop(joint: JointPrim, book: Writer) -> None:
    """A joint outside of the articulation."""
    facts: dict[str, Value] = {
        "type": {"ball": "connect", "fixed": "weld"}.get(joint.kind, joint.kind),
        "usd:collisionEnabled": joint.touching,
    }
    ends = zip("ab", (joint.parent, joint.child), joint.frames, strict=True)
    for side, body, frame in ends:
        facts[f"body {side}"] = joint.names.get(body, body)
        facts[f"end {side}"] = pose_value(Pose(frame.xyz) if joint.kind == "ball" else frame)
    prim = joint.prim
    for word in ("solref", "solimp"):
        soft = prim.take(f"mjc:{word}", SOFT_LOOP)
        stated = () if soft is None else _numbers(soft)
        facts[f"usd:{word}"] = stated
    weight = prim.number("mjc:torqueScale", SOFT_LOOP)
    facts["torque scale" if facts["type"] == "weld" else "usd:torqueScale"] = weight
    book.put("loop", prim.named("loop"), facts)


def _numbers(stated: object) -> tuple[float, ...]:
    return tuple(map(float, np.ravel(np.asarray(stated))))


def _motion(joint: JointPrim, name: str, book: Writer) -> None:
    prim, unit = joint.prim, joint.units.length(joint.angular)
    axis = joint.turn @ np.array(AXES.get(joint.token, (0.0, 0.0, 0.0)))
    word = "angular" if joint.angular else "linear"
    start = prim.number(f"state:{word}:physics:position", f"PhysicsJointStateAPI:{word}", unit)
    book.put("joint", name, {
        "axis": tuple(float(v) for v in axis),
        "lower": _limit(prim.number("physics:lowerLimit", unit=unit)),
        "upper": _limit(prim.number("physics:upperLimit", unit=unit)),
        "start": start,
    })  # fmt: skip


def _limit(stated: float | None) -> float | None:
    return None if stated is None or abs(stated) >= UNLIMITED else stated


def _drive(joint: JointPrim, name: str, book: Writer) -> None:
    """The presence of the API is what makes a drive."""
    prim, units = joint.prim, joint.units
    word = "angular" if joint.angular else "linear"
    schema = f"PhysicsDriveAPI:{word}"
    if not prim.has(schema):
        return
    start, gain = f"drive:{word}:physics", units.gain(joint.angular)
    unit = units.length(joint.angular)
    book.put("joint", name, {
        "kp": prim.number(f"{start}:stiffness", schema, gain) or 0.0,
        "kd": prim.number(f"{start}:damping", schema, gain) or 0.0,
        "effort": prim.number(f"{start}:maxForce", schema, units.effort(joint.angular)),
        "drive target": prim.number(f"{start}:targetPosition", schema, unit),
        "usd:drive type": prim.text(f"{start}:type", schema) or "force",
        "usd:targetVelocity": prim.number(f"{start}:targetVelocity", schema, unit) or 0.0,
    })  # fmt: skip


def _passive(joint: JointPrim, name: str, book: Writer) -> None:
    prim, units, angular = joint.prim, joint.units, joint.angular
    axis = "angular" if angular else "linear"
    inertia, effort = units.inertia(angular), units.effort(angular)
    gain, speed = units.gain(angular), units.length(angular)
    schemas = {
        "physxJointAxis": (f"PhysxJointAxisAPI:{axis}", f"physxJointAxis:{axis}"),
        "physxJoint": ("PhysxJointAPI", "physxJoint"),
        "newton": ("NewtonJointAPI", "newton"),
    }
    rows: dict[str, tuple[float, dict[str, str]]] = {
        "armature": (inertia, dict.fromkeys(schemas, "armature")),
        "friction": (effort, {"physxJointAxis": "staticFrictionEffort",
                              "physxJoint": "jointFriction", "newton": "friction"}),
        "damping": (gain, {"physxJointAxis": "viscousFrictionCoefficient", "newton": "damping"}),
        "velocity": (speed, {"physxJointAxis": "maxJointVelocity",
                             "physxJoint": "maxJointVelocity", "newton": "velocityLimit"}),
    }  # fmt: skip
    applied = [key for key, (schema, _) in schemas.items() if prim.has(schema)]
    for quantity, (unit, words_of) in rows.items():
        found = {
            key: prim.number(f"{schemas[key][1]}:{words_of[key]}", schemas[key][0], unit)
            for key in applied
            if key in words_of
        }
        if found:
            first = next(iter(found))
            value = found.pop(first)
            if value is not None or quantity == "velocity":
                book.put("joint", name, {quantity: value})
            words = {f"usd:{key}:{words_of[key]}": value for key, value in found.items()}
            book.put("joint", name, words)
    if "newton" in applied:
        springs = {f"newton:{end}": (f"newton:{end}", gain) for end in LIMIT_SPRING}
        prim.words("joint", name, springs, "NewtonJointAPI")
    if prim.has("MjcJointAPI"):
        for word in ("solreflimit", "solimplimit"):
            stated = prim.take(f"mjc:{word}", "MjcJointAPI")
            book.put("joint", name, {f"usd:{word}": () if stated is None else _numbers(stated)})
    dynamic = f"physxJointAxis:{axis}:dynamicFrictionEffort"
    value = prim.number(dynamic, schemas["physxJointAxis"][0], effort)
    book.put("joint", name, {"usd:dynamicFrictionEffort": value})


def _mimic(joint: JointPrim, name: str, by_path: dict[str, JointPrim], book: Writer) -> None:
    """PhysX: q + gearing q' + offset = 0, in the file's units. Newton: q = coef0 + coef1 q', where
    coef1 is in SI.
    """
    prim, unit = joint.prim, joint.units.length(joint.angular)
    physx = [s for s in prim.applied if s.startswith("PhysxMimicJointAPI:")]
    newton = prim.targets("newton:mimicJoint", "NewtonMimicAPI")
    offset = prim.number("newton:mimicCoef0", "NewtonMimicAPI", unit)
    multiplier = prim.number("newton:mimicCoef1", "NewtonMimicAPI")
    facts: dict[str, Value] = {}
    words: dict[str, Value] = {}
    if newton:
        words = {"usd:newton:mimicJoint": _leader(newton, by_path),
                 "usd:newton:mimicCoef0": offset, "usd:newton:mimicCoef1": multiplier}  # fmt: skip
        facts = {"mimics": _leader(newton, by_path), "mimic multiplier": multiplier,
                 "mimic offset": offset}  # fmt: skip
    for schema in physx:
        where = schema.partition(":")[2]
        start = f"physxMimicJoint:{where}"
        leader = prim.targets(f"{start}:referenceJoint", schema)
        led = by_path[leader[0]] if leader and leader[0] in by_path else joint
        ratio = unit / joint.units.length(led.angular)
        gearing = prim.number(f"{start}:gearing", schema, ratio)
        shift = prim.number(f"{start}:offset", schema, unit) or 0.0
        axis = prim.text(f"{start}:referenceJointAxis", schema)
        facts = {"mimics": _leader(leader, by_path), "mimic offset": 0.0 - shift,
                 "mimic multiplier": None if gearing is None else 0.0 - gearing}  # fmt: skip
        words["usd:mimic axis"] = _agrees(where, joint.token)
        if led is not joint:
            words["usd:reference axis"] = _agrees(str(axis), led.token)
    book.put("joint", name, facts | words)


def _agrees(found: str, token: str) -> str:
    """Whether PhysX's name of an axis is the axis of the joint."""
    return "the joint's own" if found == f"rot{token}" else f"{found} of a joint about {token}"


def _leader(paths: tuple[str, ...], by_path: dict[str, JointPrim]) -> str:
    return ", ".join(by_path[p].prim.name if p in by_path else p for p in paths)


def read_actuators(prims: Sequence[Prim], names: Mapping[str, str], book: Writer) -> None:
    """What Newton's actuator prims say of the joints that they drive. names: of joints by path."""
    for prim in prims:
        prim.metadata.pop("displayName", None)
        targets = prim.targets("newton:targets")
        words: dict[str, Value] = {
            "kp": prim.number("newton:kp", LAW),
            "kd": prim.number("newton:kd", LAW),
        }
        for schema, attributes in CLAMPS.items():
            if prim.has(schema):
                words |= {name: prim.number(f"newton:{name}", schema) for name in attributes}
        for path in targets or (prim.path,):
            book.put("joint", names.get(path, path), spelled(words))
