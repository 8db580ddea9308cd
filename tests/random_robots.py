"""Random robots as Hypothesis strategies: trees with frames, drives and a keyframe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from tiny import TinyRobot

from assetbuild.robot.model import (
    Actuator,
    ActuatorModel,
    Base,
    Body,
    Control,
    Frame,
    Inertial,
    Joint,
    JointKind,
    Keyframe,
    Limits,
    Tree,
)
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, normalised_quat, rotation_of, vec3
from assetbuild.robot.shapes import Shapes

SAME_FRAME = 1e-5
"""MuJoCo's compiler takes frames less than 1e-6 apart for one: smaller numbers are drawn as 0."""
_unit = st.floats(-1.0, 1.0, allow_nan=False).map(lambda v: v if abs(v) > SAME_FRAME else 0.0)


def examples(most: int) -> int:
    """Random examples of a dear test: half of `most` with `-m slow`, a quarter without."""
    return most * settings().max_examples // 100


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    """Anywhere within a metre, any orientation."""
    quat = draw(
        st.tuples(_unit, _unit, _unit, _unit).filter(lambda q: sum(v * v for v in q) > 1e-3)
    )
    return Pose(vec3(draw(st.tuples(_unit, _unit, _unit))), normalised_quat(quat))


@st.composite
def unit_vectors(draw: st.DrawFn) -> Vec3:
    """Directions; the axes come up often."""
    plain = st.sampled_from([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
    if draw(st.booleans()):
        return draw(plain)
    v = np.array(
        draw(st.tuples(_unit, _unit, _unit).filter(lambda v: sum(c * c for c in v) > 1e-3))
    )
    return vec3(v / np.linalg.norm(v))


@st.composite
def inertials(draw: st.DrawFn) -> Inertial:
    """A real mass distribution: second moments s >= 0 along turned axes, so I = tr(S) 1 - S."""
    mass = 10.0 ** draw(st.floats(-3.0, 2.0))
    second = [10.0 ** draw(st.floats(-5.0, -1.0)) for _ in range(3)]
    turn = rotation_of(draw(poses()).quat) if draw(st.booleans()) else np.eye(3)
    spread = turn @ np.diag(second) @ turn.T * mass
    moments = np.trace(spread) * np.eye(3) - (spread + spread.T) / 2
    xx, yy, zz, xy, xz, yz = (
        float(moments[i, j]) + 0.0 for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    )
    return Inertial(mass, vec3(draw(st.tuples(_unit, _unit, _unit))), (xx, yy, zz, xy, xz, yz))


@st.composite
def robots(draw: st.DrawFn, max_bodies: int = 6) -> TinyRobot:
    """Random trees in depth-first order, fixed or floating, with frames, drives and a keyframe."""
    count = draw(st.integers(2, max_bodies))
    parents = [-1] + [draw(st.integers(0, i - 1)) for i in range(1, count)]
    order = _depth_first(parents)
    bodies = tuple(Body(f"body{i}", draw(inertials())) for i in order)
    joints = tuple(draw(_joints(f"body{parents[i]}", f"body{i}")) for i in order[1:])
    frames = tuple(
        Frame(f"frame{i}", f"body{draw(st.integers(0, count - 1))}", draw(poses()))
        for i in range(draw(st.integers(0, 2)))
    )
    bases: tuple[Base, ...] = ("floating", "fixed")
    base = draw(st.sampled_from(bases))
    place = draw(poses()) if base == "fixed" and draw(st.booleans()) else IDENTITY
    tree = Tree("random", base, bodies, joints, frames, place)
    moving = tree.moving_joints
    key = Keyframe(
        "home",
        tuple((joint.name, draw(_unit)) for joint in moving),
        draw(poses()) if base == "floating" else None,
    )
    control = Control(tuple(draw(_drives(joint)) for joint in moving), (key,))
    return TinyRobot(tree, tree, Shapes(), control)


@st.composite
def _joints(draw: st.DrawFn, parent: str, child: str) -> Joint:
    kinds: tuple[JointKind, ...] = ("revolute", "continuous", "prismatic", "fixed")
    kind = draw(st.sampled_from(kinds))
    lower, width = draw(st.floats(-3.0, 3.0)), draw(st.floats(0.01, 3.0))
    limits = Limits(lower, lower + width, 20.0, 5.0)
    if kind in ("continuous", "fixed"):
        limits = Limits(effort=20.0) if kind == "continuous" else Limits()
    axis = draw(unit_vectors())
    return Joint(f"{child}_joint", kind, parent, child, draw(poses()), axis, limits)


@st.composite
def _drives(draw: st.DrawFn, joint: Joint) -> Actuator:
    size = st.floats(0.001, 500.0)
    models: tuple[ActuatorModel, ...] = ("pd", "ideal_pd", "motor", "velocity", "passive")
    model = draw(st.sampled_from(models))
    drive = Actuator(
        joint.name,
        model,
        damping=draw(size),
        friction=draw(st.sampled_from((0.0, 0.2))),
        armature=draw(st.sampled_from((0.0, 0.01, 0.123456789))),
    )
    if model == "passive":
        return drive
    effort = draw(st.one_of(st.none(), size))
    return replace(drive, kp=draw(size), kd=draw(size), effort=effort, velocity=draw(size))


def _depth_first(parents: list[int]) -> list[int]:
    order: list[int] = []
    waiting = [0]
    while waiting:
        here = waiting.pop()
        order.append(here)
        waiting += [i for i in reversed(range(len(parents))) if parents[i] == here]
    return order
