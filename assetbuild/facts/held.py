"""What a simulator holds once it has loaded a file, as facts, and what it must hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from assetbuild.facts.compare import Precision
from assetbuild.facts.derived import SOLREF, explicit_law, free_springs, leader_of, start_of
from assetbuild.facts.mjcf_model import read_model
from assetbuild.facts.mjcf_parts import Meshes
from assetbuild.facts.reference import (
    Reference,
    mimic_facts,
    pose_value,
    robot_table,
    surface_facts,
)
from assetbuild.facts.surface import Surface
from assetbuild.facts.table import Table, Value
from assetbuild.robot.inertia import tensor_of
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Pose, normalised_quat
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators.mujoco import Model
from assetbuild.simulators.physx.couplings import measurable
from assetbuild.simulators.stages import TURN

PHYSX = Precision(
    {"number": 4e-7, "vector": 4e-7, "direction": 4e-6, "pose": 2e-6, "tensor": 2e-6},
    {
        ("body", "centre of mass"): 1e-6,
        # Measured from motion, while the solver holds the coupling.
        ("joint", "mimic multiplier"): 5e-3,
        ("joint", "mimic offset"): 5e-3,
    },
)
"""A number passes three float32 (in the USD, in PhysX, at its interface) and two changes of unit,
each within 6e-8 of its size. Tensors, places and axes pass a float32 quaternion."""
NEWTON = Precision({"number": 2e-6, "vector": 2e-6, "tensor": 1e-5})
"""Newton holds float32, USD states angles in degrees; the tensor passes a diagonal form."""

SURFACE = ("static friction", "dynamic friction", "restitution")
WEIGHT = ("mass", "centre of mass", "inertia")
OF_DRIVES = frozenset({"kp", "kd", "effort", "damping"})
MIMICS = frozenset({"mimics", "mimic multiplier", "mimic offset"})
OF_JOINTS = frozenset({"type", "axis", "lower", "upper", "armature", "friction"})
HELD_BY_PHYSX: Mapping[str, frozenset[str]] = {
    "robot": frozenset({"base", "base pose"}),
    "body": frozenset({"pose", *WEIGHT}),
    "joint": OF_JOINTS | OF_DRIVES | MIMICS | {"anchor", "velocity", "start", "drive target"},
}
"""What PhysX's interface reports of the vocabulary; the rest is compared in the USD, is measured by
an experiment, or acts outside of the simulator."""
HELD_BY_NEWTON: Mapping[str, frozenset[str]] = {
    "body": frozenset(WEIGHT),
    "joint": OF_JOINTS | OF_DRIVES | MIMICS,
    "shape": frozenset({"friction", "condim", "priority", "solref", "solimp", "margin", "gap"}),
}
"""What Newton's MuJoCo solver reports: what drives, weighs and touches."""
UNLIMITED = 1e6
"""Newton's word for an effort or a range without limit, at least; PhysX's for joints that mimic."""
Held = Mapping[str, Any]
"""What an engine's program says that it holds. Any: JSON."""
STILL_M = 2e-6
"""A body that turns about its own origin stays within this of it."""


# --- what any table says, in what a simulator can hold -------------------------------------------


def as_newton(table: Table) -> Table:
    """What Newton's solver must hold of it: gains where the simulator integrates the drive.

    Another drive is in one of the files alone. Bodies without mass may be merged away.
    """
    collector = Table()
    for name in table.names("body"):
        weight = {q: v for q, v in table.of("body", name).items() if q in WEIGHT}
        if weight.get("mass"):
            collector.put("body", name, weight)
    for name in table.names("joint"):
        joint = table.of("joint", name)
        if joint.get("type") in ("rotary", "linear"):
            joint |= {end: _stated(joint.get(end)) for end in ("lower", "upper", "effort")}
            inside = joint.get("model") in ("pd", "velocity")
            collector.put("joint", name, {
                quantity: value
                for quantity, value in joint.items()
                if quantity in HELD_BY_NEWTON["joint"] and (inside or quantity not in OF_DRIVES)
            })  # fmt: skip
    for key, value in table.facts.items():
        if key.kind == "shape" and key.quantity in HELD_BY_NEWTON["shape"]:
            collector.facts[key] = value
    return collector


def _stated(limit: Value) -> Value:
    """None where it limits nothing."""
    unlimited = isinstance(limit, float) and abs(limit) >= UNLIMITED
    return None if unlimited else limit


# --- PhysX ---------------------------------------------------------------------------------------


def physx_expected(reference: Reference, *, drive_type: str, mimics: bool) -> Table:
    """Return what PhysX must hold of the robot in its initial pose.

    mimics: whether the USD couples them.
    """
    robot, tree, control = robot_table(reference), reference.tree, reference.control
    light = {body.name for body in tree.bodies if body.is_massless}
    # `usd.mass_missing` says what PhysX makes up where there is no mass.
    table = robot.only(
        lambda key: (
            key.kind != "joint"
            and key.quantity in HELD_BY_PHYSX.get(key.kind, ())
            and not (key.quantity in WEIGHT and key.name in light)
        )
    )
    table.put("robot", "", {"physx:dof": float(len(tree.moving_joints))})
    starts, springs = dict(start_of(tree, control).joints), free_springs(control)
    coupled = measurable(tree) if mimics else {}
    for joint in tree.moving_joints:
        row = control.by_joint.get(joint.name)
        target = starts[joint.name] if row and row.model == "pd" and row.kp else None
        if joint.name in springs:
            target = springs[joint.name][1]
        facts = _physx_joint(robot.of("joint", joint.name), drive_type)
        facts |= {"start": starts[joint.name], "drive target": target}
        if joint.name in coupled and joint.mimic is not None:
            facts |= mimic_facts(joint.mimic)
        table.put("joint", joint.name, facts)
    contacts = dict(control.contacts)
    rough: dict[str, list[float]] = {body.name: [] for body in tree.bodies}
    for shape in reference.shapes.of("collision"):
        friction = contacts.get(shape.name, control.contact).friction[0]
        rough[tree.placement(shape.link)[0]].append(friction)
    for name, values in rough.items():
        table.put("body", name, _surfaces(values, values, [0.0] * len(values)))
    return table


def _physx_joint(joint: Mapping[str, Value], drive_type: str) -> dict[str, Value]:
    model, spring = joint["model"], joint.get("stiffness") or 0.0
    driven = model != "passive"
    return {quantity: joint[quantity] for quantity in (*OF_JOINTS, "damping", "velocity")} | {
        "kp": joint["kp"] if model == "pd" else 0.0 if driven else spring,
        "kd": joint["kd"] if model in ("pd", "velocity") else 0.0,
        # Where there is no drive there is no effort to limit.
        "effort": joint["effort"] if driven else None,
        "physx:dynamic friction": joint["friction"],
        "physx:drive": drive_type if driven else "force" if spring else "none",
    }


def _surfaces(*columns: list[float]) -> dict[str, Value]:
    """columns: friction while at rest and while sliding, restitution; a number of each shape."""
    facts: dict[str, Value] = {"physx:shapes": float(len(columns[0]))}
    for word, values in zip(SURFACE, columns, strict=True) if columns[0] else ():
        facts[f"physx:{word}"] = tuple(sorted(values))
    return facts


def physx_table(held: Held, tree: Tree, couplings: Mapping[str, Mapping[str, Value]]) -> Table:
    """What PhysX holds. tree: says which body hangs on which, and which has no mass."""
    table = Table()
    table.put("robot", "", {
        "base": "fixed" if held["fixed_base"] else "floating",
        "physx:dof": float(held["dof"]),
    })  # fmt: skip
    if held["root"] is not None:
        table.put("robot", "", {"base pose": pose_value(_pose(held["root"]))})
    massless = {body.name for body in tree.bodies if body.is_massless}
    for name, link in held["bodies"].items():
        shapes = int(link["shapes"][0])  # the columns are padded
        table.put("body", name, _surfaces(*(link.get(w, [])[:shapes] for w in SURFACE)))
        if name not in massless:
            table.put("body", name, {
                "mass": link["mass"][0],
                "centre of mass": tuple(link["centre of mass"]),
                "inertia": tensor_of(np.reshape(link["inertia"], (3, 3))),
            })  # fmt: skip
    for joint in tree.joints:
        parent, child = (held["bodies"].get(name) for name in (joint.parent, joint.child))
        if parent is None or child is None or parent["zero"] is None:
            continue
        X_zero, X_turned = (
            _pose(parent[when]).inverse() @ _pose(child[when]) for when in ("zero", "turned")
        )
        table.put("body", joint.child, {"pose": pose_value(X_zero)})
        if joint.name in held["joints"]:
            table.put("joint", joint.name, _motion(X_zero.inverse() @ X_turned))
    for name, row in held["joints"].items():
        table.put("joint", name, _held_joint(row))
    for name, facts in couplings.items():
        table.put("joint", name, facts)
    return table


def _pose(row: Sequence[float]) -> Pose:
    """row: xyz, and a quaternion wxyz."""
    x, y, z, *quat = row
    return Pose((x, y, z), normalised_quat(tuple(quat)))  # type: ignore[arg-type] # four numbers


def _motion(X: Pose) -> dict[str, Value]:
    """Return type, axis and anchor of a joint from X, its body's motion from 0 to `TURN`."""
    w, *turn = X.quat if X.quat[0] >= 0.0 else (-v for v in X.quat)
    half, moved = float(np.linalg.norm(turn)), float(np.linalg.norm(X.xyz))
    if 2.0 * math.atan2(half, w) <= TURN / 2.0:
        axis = tuple(float(v) / moved for v in X.xyz) if moved else None
        return {"type": "linear" if moved else "fixed", "axis": axis}
    facts: dict[str, Value] = {"type": "rotary", "axis": tuple(v / half for v in turn)}
    if moved > STILL_M:
        anchor = np.linalg.pinv(np.eye(3) - X.rotation) @ np.asarray(X.xyz)
        facts["anchor"] = tuple(map(float, anchor))
    return facts


def _held_joint(row: Held) -> dict[str, Value]:
    drive = {0.0: "none", 1.0: "force", 2.0: "acceleration"}.get(row["physx:drive"], "unknown")
    return {
        **row,
        "lower": _stated(row["lower"]),
        "upper": _stated(row["upper"]),
        "effort": None if drive == "none" else row["effort"],
        "drive target": row["drive target"] if drive != "none" and row["kp"] else None,
        "physx:drive": drive,
    }


# --- Newton --------------------------------------------------------------------------------------


def newton_expected(reference: Reference, shapes: Shapes, *, coupled: bool, usd: bool) -> Table:
    """Return what Newton must hold of the robot.

    reference: needs no shapes, whose geometry is not read back.
    coupled: does the file say which joint mimics? usd: read from the USD, which alone says how soft
    limits are and which law an explicit drive has.
    """
    tree, soft = reference.tree, dict(reference.control.soft_limits)
    table = as_newton(robot_table(reference))
    table = table.only(lambda key: coupled or not key.quantity.startswith("mimic"))
    dof = float(len(tree.moving_joints) + (6 if tree.base == "floating" else 0))
    table.put("robot", "", {"newton:dof": dof})
    for joint in tree.moving_joints if usd else ():
        ends = table.of("joint", joint.name)
        limited = ends.get("lower") is not None or ends.get("upper") is not None
        softness = soft[joint.name].solref if joint.name in soft else SOLREF
        table.put("joint", joint.name, {"newton:solreflimit": softness if limited else None})
        if coupled and joint.mimic is not None:
            table.put("joint", joint.name, mimic_facts(leader_of(tree, joint.mimic)))
        row = reference.control.by_joint.get(joint.name)
        law = explicit_law(row) if row else {}
        table.put("joint", joint.name, {f"newton:actuator {name}": v for name, v in law.items()})
    contacts, common = dict(reference.control.contacts), reference.control.contact
    for shape in shapes.of("collision"):
        contact = contacts.get(shape.name, common)
        if contact.contype or contact.conaffinity:
            # A gap of 0 leaves Newton its own, which only finds contacts earlier.
            held = HELD_BY_NEWTON["shape"] - (set() if contact.gap else {"gap"})
            facts = surface_facts(contact)
            table.put("shape", shape.name, {word: facts[word] for word in sorted(held)})
    return table


def newton_table(held: Held) -> Table:
    """What Newton holds of a file: its solver's model, and the laws of drives outside of it."""
    model: Model = HeldModel(held)
    table = as_newton(read_model(model, meshes=NoMeshes(model))[0])
    table.put("robot", "", {"newton:dof": float(held["nv"])})
    for index, name in enumerate(held["names"]["joint"]):
        if table.of("joint", name):
            limited = bool(model.jnt_limited[index])
            softness = tuple(model.jnt_solref[index].tolist()) if limited else None
            table.put("joint", name, {"newton:solreflimit": softness})
    for name, law in held["laws"].items():
        table.put("joint", name, {f"newton:actuator {word}": v for word, v in law.items()})
    return table


class NoMeshes(Meshes):
    """Nothing in place of each mesh, which nobody compares."""

    def of(self, _: int) -> Surface:
        """A surface without triangles."""
        return Surface(0, 0.0, 0.0, (0.0,) * 3, (0.0,) * 6)


class HeldModel:
    """The compiled model that Newton's solver holds, to be read as `mujoco.MjModel`."""

    def __init__(self, held: Mapping[str, Any]) -> None:  # Any: JSON
        self.opt = SimpleNamespace(**_arrays(held["opt"]))
        for kind, names in held["names"].items():
            held = {**held, kind: partial(_named, names)}
        self.__dict__ |= _arrays(held)


def _arrays(values: Mapping[str, Any]) -> dict[str, Any]:  # Any: JSON; arrays and numbers
    return {k: np.array(v) if isinstance(v, list) else v for k, v in values.items() if k != "opt"}


def _named(names: Sequence[str], index: int) -> SimpleNamespace:
    return SimpleNamespace(name=names[index])
