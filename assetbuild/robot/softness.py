"""How stiff MuJoCo holds limits and couplings, from the error that full effort may cause.

MuJoCo states the softness of a constraint by a time constant t (s), a damping ratio and an
impedance d, and scales its force by the inertia I of the joint alone (`1 / dof_invweight0`). At
rest a force F moves a critically damped constraint by

    r = (1 - d) t^2 F / I

so that MuJoCo's defaults (t = 0.02 s, d = 0.95) let full effort push a light joint far past its
limit. Source: MuJoCo, Computation, "Solver parameters", with a constant impedance.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from pydantic import Field

from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.mimic import has_range, leading, without_mimics
from assetbuild.robot.model import Control, Joint, Softness, Tree
from assetbuild.robot.sides import Side, side_of

TIME_S, IMPEDANCE = 0.02, 0.95
"""MuJoCo's defaults: the time constant, and the impedance beyond a width of 1 mm or 1 mrad."""
USUAL = Softness((TIME_S, 1.0), (0.9, IMPEDANCE, 0.001, 0.5, 2.0))
"""MuJoCo's default softness of limits and couplings."""
STIFFEST = 0.9999
"""MuJoCo cuts an impedance beyond it without a word."""
SHORTEST_STEPS = 2.0
"""Timesteps; MuJoCo lengthens a shorter time constant (`refsafe`)."""
ALIKE = 1.5
"""Inertias of joints with one effort that differ by less share the softness of the lightest."""


class Allowed(Model):
    """An error at full effort, of turning and of sliding joints."""

    turn: Positive = Field(description="rad, of joints that turn")
    slide: Positive = Field(description="m, of joints that slide")

    def of(self, joint: Joint) -> float:
        """Return the error that is allowed for a joint, rad or m."""
        return self.slide if joint.kind == "prismatic" else self.turn


class LimitError(Allowed):
    """How far full effort may push a joint past its limits."""

    turn: Positive = Field(0.0087, description="rad past a limit of a joint that turns")
    slide: Positive = Field(0.0005, description="m past a limit of a joint that slides")


class CouplingError(Allowed):
    """How far full effort may part a joint from the one that it mimics, or a locked joint move."""

    turn: Positive = Field(0.0035, description="rad between a turning joint and its leader")
    slide: Positive = Field(0.0002, description="m between a sliding joint and its leader")


Soft = Iterator[tuple[str, Softness]]
"""(joint, what holds it), for joints that MuJoCo's default would not hold against full effort."""


def soft_limits(tree: Tree, control: Control, allowed: Allowed) -> Soft:
    """How to hold each joint with limits and an effort, in tree order."""
    inertia = bare_inertia(tree, control)
    joints = [joint for joint in tree.moving_joints if has_range(joint)]
    yield from _held(tree, control, joints, allowed, inertia)


def soft_couplings(tree: Tree, control: Control, allowed: Allowed) -> Soft:
    """How to hold each joint that mimics another or is locked, and whose effort is known.

    MuJoCo adds the inverse inertias of both joints of a coupling.
    """
    alone = bare_inertia(tree, control)
    inertia, coupled = dict(alone), []
    for joint in tree.moving_joints:
        if joint.mimic is not None and joint.name in alone and joint.mimic.joint in alone:
            both = 1.0 / alone[joint.name] + 1.0 / alone[joint.mimic.joint]
            inertia[joint.name] = 1.0 / both
        if joint.mimic is not None or (joint.is_locked and joint.kind != "continuous"):
            coupled.append(joint)
    yield from _held(tree, control, coupled, allowed, inertia)


def bare_inertia(tree: Tree, control: Control) -> dict[str, float]:
    """Return the inertia of each moving joint at q = 0 with all others free, kg m2 or kg.

    MuJoCo's `1 / dof_invweight0`: no coupling counts. Joints that move nothing are left out.
    """
    armature = {row.joint: row.armature for row in control.actuators}
    inertias = dynamics(without_mimics(tree), {}, armature).effective_inertia()
    return {name: value for name, value in inertias.items() if 0.0 < value < math.inf}


def limit_springs(tree: Tree, control: Control) -> dict[str, tuple[float, float]]:
    """Return the stiffness and damping of the limits of each moving joint at q = 0.

    For engines that ask for the numbers: k = I / ((1 - d) t^2), c = 2 I / ((1 - d) t); N m/rad and
    N m s/rad, or N/m and N s/m. Newton 1.8 inverts it with the same d. A joint that moves no mass
    has none; a follower moves what its leader does, geared.
    """
    armature = {row.joint: row.armature for row in control.actuators}
    inertia = dynamics(tree, {}, armature).effective_inertia()
    by_joint, springs = dict(control.soft_limits), {}
    for joint in tree.moving_joints:
        leader, gear, _ = leading(tree, joint)
        reflected = inertia[leader.name] / gear**2 if gear else math.inf
        if 0.0 < reflected < math.inf:
            soft = by_joint.get(joint.name, USUAL)
            time, inverse = soft.solref[0], reflected / (1.0 - soft.solimp[1])
            springs[joint.name] = (inverse / time**2, 2.0 * inverse / time)
    return springs


def softness(force: float, inertia: float, allowed: float, timestep: float) -> Softness:
    """Return what holds a force to an error, MuJoCo's default where that is enough.

    force: N m or N; inertia: kg m2 or kg; allowed: rad or m; timestep: s. The time constant is
    shortened first, down to two steps; then the impedance rises, as far as MuJoCo takes it.
    """
    shortest = SHORTEST_STEPS * timestep
    if error_at_rest(USUAL, force, inertia, timestep) <= allowed:
        return USUAL
    wanted = math.sqrt(allowed * inertia / ((1.0 - IMPEDANCE) * force))
    time = max(shortest, math.floor(1000.0 * min(wanted, TIME_S)) / 1000.0)
    room = 1.0 - allowed * inertia / (force * time**2)
    impedance = min(max(math.ceil(room * 1e5) / 1e5, IMPEDANCE), STIFFEST)
    return Softness((time, 1.0), (impedance, impedance, *USUAL.solimp[2:]))


def error_at_rest(soft: Softness, force: float, inertia: float, timestep: float) -> float:
    """Return how far a force moves what is held, rad or m; the arguments are in N m or N, kg m2
    or kg, and s."""
    time = max(soft.solref[0], SHORTEST_STEPS * timestep)
    return (1.0 - soft.solimp[1]) * time**2 * force / inertia


def effort_at(tree: Tree, control: Control, joint: Joint) -> float:
    """The largest effort of a joint, of a follower what its leader brings there; 0: unknown."""
    leader, gear, _ = leading(tree, joint)
    row = control.by_joint.get(leader.name)
    effort = (row.effort if row is not None else None) or leader.limits.effort or 0.0
    return effort / abs(gear) if gear else 0.0


def _held(
    tree: Tree,
    control: Control,
    joints: Iterable[Joint],
    allowed: Allowed,
    inertia: Mapping[str, float],
) -> Soft:
    """What holds each joint; joints of equal effort and similar inertia share one softness.

    Left and right legs then share a class, though their tensors differ in the last digits.
    """
    known = [j for j in joints if j.name in inertia and effort_at(tree, control, j) > 0.0]
    lightest = dict[str, float]()
    efforts = {joint.name: (effort_at(tree, control, joint), joint.kind) for joint in known}
    first = ""
    for joint in sorted(known, key=lambda j: (*efforts[j.name], inertia[j.name])):
        like = first and efforts[first] == efforts[joint.name]
        if not like or inertia[joint.name] > ALIKE * inertia[first]:
            first = joint.name
        lightest[joint.name] = inertia[first]
    timestep = control.simulation.timestep
    for joint in known:
        force = efforts[joint.name][0]
        soft = softness(force, lightest[joint.name], allowed.of(joint), timestep)
        if soft != USUAL:
            yield joint.name, soft


PLACES = {"limits": "joint", "couplings": "mimic"}
"""Section of the recipe -> the place of MJCF's own words about the same."""


def softened(
    tree: Tree,
    control: Control,
    sides: Sequence[Side],
    limits: LimitError,
    couplings: CouplingError,
) -> Control:
    """The control with what MuJoCo's default would not hold; the check `full_effort` measures it.

    What an MJCF source says of its constraints stays, unless the recipe states a wish.
    """
    at_limits = _ours(soft_limits(tree, control, limits), control, sides, "limits")
    coupled = _ours(soft_couplings(tree, control, couplings), control, sides, "couplings")
    return replace(control, soft_limits=tuple(at_limits), soft_couplings=tuple(coupled))


def _ours(
    held: Iterable[tuple[str, Softness]], control: Control, sides: Sequence[Side], section: str
) -> Iterator[tuple[str, Softness]]:
    """Leave out joints whose softness an MJCF source decides."""
    words = [item for item in control.mjcf_only if item.place == PLACES[section]]
    stated = {i.owner for i in words if "solref" in i.element or "solimp" in i.element}
    for joint, soft in held:
        side = side_of(sides, joint)
        ours = not side.from_mjcf or section in side.stated
        if ours and joint not in stated:
            yield joint, soft
