"""Joints: what they connect, how they move, and what drives, brakes and couples them.

PhysX 2026 (`physxJointAxis`), PhysX before it and Newton each have attributes of their own for
armature, friction, damping and velocity limit. The first one that a joint has is the fact; another
one is a word of the format, in SI units, where it says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from assetbuild.facts.reference import pose_value
from assetbuild.facts.table import Table, Value
from assetbuild.facts.usd_prims import AXES, Places, Prim, pose_of
from assetbuild.robot.pose import Array, Pose, rotation_of

TYPES = {
    "PhysicsRevoluteJoint": "rotary",
    "PhysicsPrismaticJoint": "linear",
    "PhysicsFixedJoint": "fixed",
    "PhysicsSphericalJoint": "ball",
    "PhysicsJoint": "free",
}
MOVING = ("rotary", "linear")
COUPLED = math.radians(1e8)
"""Stands for no limit of a hinge: PhysX couples two angles only within limits."""
BRAKES: Mapping[str, tuple[str, ...]] = {
    "armature": ("physxJointAxis:armature", "physxJoint:armature", "newton:armature"),
    "friction": ("physxJointAxis:staticFrictionEffort", "physxJoint:jointFriction",
                 "newton:friction", "physxJointAxis:dynamicFrictionEffort"),
    "damping": ("physxJointAxis:viscousFrictionCoefficient", "newton:damping"),
    "velocity": ("physxJointAxis:maxJointVelocity", "physxJoint:maxJointVelocity",
                 "newton:velocityLimit"),
}  # fmt: skip
"""Quantity -> its attributes, by schema and name."""


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
        scale: Array = places.rigid(body)[1] if body else np.ones(3)
        position = self.prim.value(f"physics:localPos{side}")
        turn = self.prim.value(f"physics:localRot{side}")
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

    @property
    def word(self) -> str:
        """What schemas that are applied for an axis call it."""
        return "angular" if self.angular else "linear"


def joint_facts(joints: Sequence[JointPrim], table: Table) -> None:
    """Facts of all joints but those that hold the base; of those that close loops, as loops."""
    by_path = {joint.prim.path: joint for joint in joints}
    for joint in joints:
        if joint.holds_base:
            continue
        if joint.closes_loop:
            table.put("loop", joint.prim.named("loop", table), _loop(joint))
            continue
        names = joint.names
        facts: dict[str, Value] = {
            "type": joint.kind,
            "body": names.get(joint.child, joint.child),
            "parent": names.get(joint.parent, joint.parent),
            "anchor": joint.anchor,
            "usd:child pose": pose_value(joint.X_parent_child),
        }
        if joint.kind in MOVING:
            facts |= _motion(joint) | _drive(joint) | _passive(joint)
            facts |= _mimic(joint, by_path)
        table.put("joint", joint.prim.named("joint", table), facts)


def _loop(joint: JointPrim) -> dict[str, Value]:
    """A joint outside of the articulation, and how soft MuJoCo holds it."""
    facts: dict[str, Value] = {
        "type": {"ball": "connect", "fixed": "weld"}.get(joint.kind, joint.kind)
    }
    ends = zip("ab", (joint.parent, joint.child), joint.frames, strict=True)
    for side, body, frame in ends:
        facts[f"body {side}"] = joint.names.get(body, body)
        facts[f"end {side}"] = pose_value(Pose(frame.xyz) if joint.kind == "ball" else frame)
    scale = "torque scale" if facts["type"] == "weld" else "usd:mjc:torqueScale"
    return facts | {scale: joint.prim.number("mjc:torqueScale", "MjcEqualityWeldAPI")}


def _motion(joint: JointPrim) -> dict[str, Value]:
    prim, unit = joint.prim, joint.units.length(joint.angular)
    axis = joint.turn @ np.array(AXES.get(joint.token, (0.0, 0.0, 0.0)))
    word = joint.word
    return {
        "axis": tuple(float(v) for v in axis),
        "lower": _limit(prim.number("physics:lowerLimit", unit=unit)),
        "upper": _limit(prim.number("physics:upperLimit", unit=unit)),
        "start": prim.number(
            f"state:{word}:physics:position", f"PhysicsJointStateAPI:{word}", unit
        ),
    }


def _limit(stated: float | None) -> float | None:
    is_none = stated is None or math.isclose(abs(stated), COUPLED, rel_tol=1e-6)
    return None if is_none else stated


def _drive(joint: JointPrim) -> dict[str, Value]:
    """The presence of the API is what makes a drive."""
    prim, units = joint.prim, joint.units
    schema = f"PhysicsDriveAPI:{joint.word}"
    if not prim.has(schema):
        return {}
    start, gain = f"drive:{joint.word}:physics", units.gain(joint.angular)
    unit = units.length(joint.angular)
    return {
        "kp": prim.number(f"{start}:stiffness", unit=gain) or 0.0,
        "kd": prim.number(f"{start}:damping", unit=gain) or 0.0,
        "effort": prim.number(f"{start}:maxForce", unit=units.effort(joint.angular)),
        "drive target": prim.number(f"{start}:targetPosition", unit=unit),
        "usd:drive type": prim.text(f"{start}:type") or "force",
    }


def _passive(joint: JointPrim) -> dict[str, Value]:
    """What brakes a joint."""
    units, angular = joint.units, joint.angular
    unit = {"armature": units.inertia(angular), "friction": units.effort(angular),
            "damping": units.gain(angular), "velocity": units.length(angular)}  # fmt: skip
    schemas = {
        "physxJointAxis": f"PhysxJointAxisAPI:{joint.word}",
        "physxJoint": "PhysxJointAPI",
        "newton": "NewtonJointAPI",
    }
    engines = [name for name, schema in schemas.items() if joint.prim.has(schema)]
    facts: dict[str, Value] = {"usd:engines": ", ".join(engines)} if engines else {}
    for quantity, spellings in BRAKES.items():
        stated: dict[str, float | None] = {}
        for spelling in spellings:
            engine, _, word = spelling.partition(":")
            if engine in engines:
                name = f"{engine}:{joint.word}:{word}" if engine == "physxJointAxis" else spelling
                stated[f"usd:{spelling}"] = joint.prim.number(name, unit=unit[quantity])
        first = next(iter(stated.values()), None)
        facts |= {name: "none" if v is None else v for name, v in stated.items() if v != first}
        facts |= {} if first is None else {quantity: first}
    return facts


def _mimic(joint: JointPrim, by_path: dict[str, JointPrim]) -> dict[str, Value]:
    """PhysX: q + gearing q' + offset = 0, in the file's units. Newton: q = coef0 + coef1 q', where
    coef1 is in SI.
    """
    prim, unit = joint.prim, joint.units.length(joint.angular)
    facts: dict[str, Value] = {}
    words: dict[str, Value] = {}
    if newton := prim.targets("newton:mimicJoint", "NewtonMimicAPI"):
        facts = {
            "mimics": _leader(newton, by_path),
            "mimic multiplier": prim.number("newton:mimicCoef1"),
            "mimic offset": prim.number("newton:mimicCoef0", unit=unit),
        }
        words = {f"usd:newton:{quantity}": value for quantity, value in facts.items()}
    for schema in (s for s in prim.applied if s.startswith("PhysxMimicJointAPI:")):
        where = schema.partition(":")[2]
        start = f"physxMimicJoint:{where}"
        leader = prim.targets(f"{start}:referenceJoint")
        led = by_path[leader[0]] if leader and leader[0] in by_path else joint
        ratio = unit / joint.units.length(led.angular)
        gearing = prim.number(f"{start}:gearing", unit=ratio)
        shift = prim.number(f"{start}:offset", unit=unit) or 0.0
        facts = {"mimics": _leader(leader, by_path), "mimic offset": 0.0 - shift,
                 "mimic multiplier": None if gearing is None else 0.0 - gearing}  # fmt: skip
        words["usd:mimic axis"] = _agrees(where, joint.token)
        if led is not joint:
            axis = prim.text(f"{start}:referenceJointAxis")
            words["usd:reference axis"] = _agrees(str(axis), led.token)
    return facts | words


def _agrees(axis: str, token: str) -> str:
    """Whether PhysX's name of an axis is the axis of the joint."""
    return "the joint's own" if axis == f"rot{token}" else f"{axis} of a joint about {token}"


def _leader(paths: tuple[str, ...], by_path: dict[str, JointPrim]) -> str:
    return ", ".join(by_path[p].prim.name if p in by_path else p for p in paths)
