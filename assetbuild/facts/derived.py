"""What follows from the robot, derived without the code by which the writers derive it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, TypeVar
from xml.etree import ElementTree

from assetbuild.facts.table import Value
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.model import Actuator, Control, Keyframe, Mimic, Tree

SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's own softness, of contacts, limits and couplings that state none."""
EXPLICIT = frozenset({"ideal_pd", "dc_motor", "motor"})
"""Models of the actuator table whose law acts outside of the solver, in a prim of its own."""
Row = TypeVar("Row")


def start_of(tree: Tree, control: Control) -> Keyframe:
    """`home`, else the first keyframe, else every joint as near to 0 as its limits allow.

    A joint that mimics another follows it.
    """
    if control.initial_keyframe is not None:
        return control.initial_keyframe
    ends = {joint.name: joint.bounds for joint in tree.moving_joints}
    near = {name: min(max(0.0, lower), upper) for name, (lower, upper) in ends.items()}
    for joint in tree.moving_joints:
        if joint.mimic is not None:
            lead = leader_of(tree, joint.mimic)
            near[joint.name] = lead.offset + lead.multiplier * near[lead.joint]
    return Keyframe("", tuple(near.items()))


def leader_of(tree: Tree, mimic: Mimic) -> Mimic:
    """The same motion as of the joint at the head of a chain of joints that mimic one another."""
    multiplier, offset, joint = mimic.multiplier, mimic.offset, tree.by_joint[mimic.joint]
    while (above := joint.mimic) is not None:
        multiplier, offset = multiplier * above.multiplier, offset + multiplier * above.offset
        joint = tree.by_joint[above.joint]
    return Mimic(joint.name, multiplier, offset)


def springs_of(control: Control) -> dict[str, tuple[float, float]]:
    """(N m/rad or N/m, where it rests in rad or m) of each linear spring, by joint."""
    springs = {}
    for item in control.mjcf_only:
        if item.place == "joint":
            element = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
            numbers = [float(word) for word in element.get("stiffness", "").split()]
            if any(numbers) and not any(numbers[1:]):
                springs[item.owner] = numbers[0], float(element.get("springref", "0"))
    return springs


def free_springs(control: Control) -> dict[str, tuple[float, float]]:
    """The linear springs of undriven joints: an engine without springs holds these by a drive."""
    driven = {row.joint for row in control.actuators if row.model != "passive"}
    return {name: spring for name, spring in springs_of(control).items() if name not in driven}


def weightless(control: Control) -> set[str]:
    """Bodies that gravity does not pull, unless a drive makes up for it (`actuatorgravcomp`)."""
    if any('actuatorgravcomp="true"' in i.element for i in control.mjcf_only if i.place == "joint"):
        return set()
    whole = re.compile(r'<body\b[^>]*\bgravcomp="1(\.0*)?"')
    items = (i for i in control.mjcf_only if i.place == "body" and whole.match(i.element))
    return {item.owner for item in items}


def limit_springs(tree: Tree, control: Control) -> dict[str, tuple[float, float]]:
    """(stiffness, damping) of the limits of each joint that moves a mass, N m/rad or N/m.

    A constraint of time constant t and impedance d on an inertia I pulls with I / ((1 - d) t²) and
    brakes with 2 I / ((1 - d) t). Source: MuJoCo, Computation, "Solver parameters".
    """
    armature = {row.joint: row.armature for row in control.actuators}
    inertia, springs = dynamics(tree, {}, armature).effective_inertia(), {}
    soft = dict(control.soft_limits)
    for joint in tree.moving_joints:
        lead = leader_of(tree, joint.mimic) if joint.mimic else Mimic(joint.name, 1.0, 0.0)
        moved = inertia[lead.joint] / lead.multiplier**2 if lead.multiplier else math.inf
        if 0.0 < moved < math.inf:
            time = soft[joint.name].solref[0] if joint.name in soft else SOLREF[0]
            impedance = soft[joint.name].solimp[1] if joint.name in soft else SOLIMP[1]
            rigid = moved / (1.0 - impedance)
            springs[joint.name] = rigid / time**2, 2.0 * rigid / time
    return springs


def explicit_law(row: Actuator) -> dict[str, Value]:
    """Gains and limits of a drive that acts outside of the solver; nothing of any other."""
    if row.model not in EXPLICIT:
        return {}
    gains: dict[str, Value] = {"kp": row.kp, "kd": row.kd}
    if row.model != "dc_motor":
        return gains | {"maxEffort": row.effort}
    stall = row.effort if row.stall is None else row.stall
    curve = {"saturationEffort": stall, "velocityLimit": row.velocity}
    return gains | {"maxMotorEffort": row.effort} | curve


def first_match(table: Mapping[str, Row], name: str) -> Row | None:
    """What the first pattern says that matches a whole name."""
    return next((row for pattern, row in table.items() if re.fullmatch(pattern, name)), None)


def per_axis(value: Any) -> tuple[float, ...]:  # Any: JSON, a number or three
    """A number for each axis."""
    return tuple(value) if isinstance(value, list | tuple) else (value,) * 3
