"""Loops close, and drives feel what moves with them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tiny import COUPLER_M, CRANK_M, GROUND_M, ROCKER_M, four_bar

from assetbuild.robot.closure import (
    close,
    constraint_jacobian,
    coordinates,
    felt_inertia,
    gap,
    gaps,
    locked_joints,
)
from assetbuild.robot.dynamics import dynamics, motions
from assetbuild.robot.loops import LoopRow, resolve_loops
from assetbuild.robot.model import Body, Joint, Loop, LoopEnd
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.tree import forward_kinematics

FREE = ("coupler_joint", "rocker_joint")


def closed(crank: float) -> dict[str, float]:
    robot = four_bar()
    found = close(robot.tree, robot.control.loops, {"crank_joint": crank}, FREE)
    assert found.closed
    return dict(found.positions)


def weld(loop: Loop, q: dict[str, float]) -> Loop:
    """The same loop as a weld that is closed at `q`: the coupler's end is turned."""
    turn = quat_of_rpy(0.0, q["rocker_joint"] - q["crank_joint"] - q["coupler_joint"], 0.0)
    return replace(
        loop, kind="weld", a=replace(loop.a, X_body_end=Pose(loop.a.X_body_end.xyz, turn))
    )


@pytest.mark.parametrize("crank", [0.3, 1.0, -1.4, 2.5])
def test_the_rocker_stands_where_the_law_of_cosines_puts_it(crank: float):
    q = closed(crank)
    # About +y a positive angle turns x towards -z.
    pin = np.array([CRANK_M * math.cos(crank), -CRANK_M * math.sin(crank)])
    to_pin = pin - np.array([GROUND_M, 0.0])
    away = float(np.linalg.norm(to_pin))
    cosine = (ROCKER_M**2 + away**2 - COUPLER_M**2) / (2.0 * ROCKER_M * away)
    between = math.acos(cosine)
    toward = math.atan2(-to_pin[1], to_pin[0])
    both = [(toward + side * between - q["rocker_joint"]) % (2 * math.pi) for side in (-1, 1)]
    assert min(min(angle, 2 * math.pi - angle) for angle in both) < 1e-8


def test_a_loop_out_of_reach_is_not_closed_and_says_by_how_much():
    robot = four_bar()
    far = replace(robot.control.loops[0], b=LoopEnd("base", Pose((1.0, 0.0, 0.0))))
    found = close(robot.tree, (far,), {}, ("crank_joint", "coupler_joint"))
    assert not found.closed
    assert found.residual == pytest.approx(1.0 - CRANK_M - COUPLER_M, rel=1e-6)


@pytest.mark.parametrize("kind", ["connect", "weld"])
def test_the_jacobian_is_the_slope_of_the_gap(kind: str):
    robot, step = four_bar(), 1e-6
    q = closed(0.4)
    loop = replace(weld(robot.control.loops[0], q), kind=kind)
    assert gaps(robot.tree, (loop,), q)[loop.name] < 1e-8
    jacobian = constraint_jacobian((loop,), motions(robot.tree, q).bodies)
    for column, joint in enumerate(robot.tree.moving_joints):
        ends = [
            gap(loop, forward_kinematics(robot.tree, {**q, joint.name: q[joint.name] + side}))
            for side in (step, -step)
        ]
        np.testing.assert_allclose(jacobian[:, column], (ends[0] - ends[1]) / (2 * step), atol=1e-8)


def test_a_weld_of_coupler_and_rocker_locks_the_crank():
    robot, q = four_bar(), closed(0.4)
    pin = robot.control.loops[0]
    assert locked_joints(robot.tree, (weld(pin, q),), q, ("crank_joint",)) == ("crank_joint",)
    assert locked_joints(robot.tree, (pin,), q, ("crank_joint",)) == (), "at a point it may turn"


def test_a_crank_at_its_dead_centre_is_not_locked():
    robot = four_bar()
    # Crank and coupler in one line: the rocker stands still for this moment.
    away = CRANK_M + COUPLER_M
    cosine = (away**2 + GROUND_M**2 - ROCKER_M**2) / (2.0 * away * GROUND_M)
    crank = math.acos(cosine)
    start = {"crank_joint": crank, "coupler_joint": 0.0, "rocker_joint": crank + 1.0}
    found = close(robot.tree, robot.control.loops, start, ("rocker_joint",))
    assert found.closed
    joints = ("crank_joint", "rocker_joint")
    assert locked_joints(robot.tree, robot.control.loops, found.positions, joints) == ()


@pytest.mark.parametrize(("tilt", "locked"), [(1e-4, ()), (0.1, ("crank_joint",))])
def test_axes_that_are_parallel_but_for_rounding_lock_no_crank(
    tilt: float, locked: tuple[str, ...]
):
    robot, q = four_bar(), closed(0.4)
    joints = [
        replace(j, axis=(tilt, 1.0, 0.0)) if "rocker" in j.name else j for j in robot.tree.joints
    ]
    tree = replace(robot.tree, joints=tuple(joints))
    assert locked_joints(tree, robot.control.loops, q, ("crank_joint",)) == locked
    inertia = felt_inertia(robot.control.loops, dynamics(tree, q, {}))
    assert math.isinf(inertia["crank_joint"]) == bool(locked)


@pytest.mark.parametrize(("kind", "ways"), [("connect", 2), ("hinge", 1)])
def test_a_hinge_holds_the_axis_too(kind: str, ways: int):
    """A coupler that twists about its own length may do so at a point, and not at a pin."""
    robot = four_bar()
    twist = Joint("twist", "continuous", "coupler", "tip", Pose((COUPLER_M, 0.0, 0.0)))
    bodies = (*robot.tree.bodies, Body("tip", robot.tree.by_body["coupler"].inertial))
    tree = replace(robot.tree, bodies=bodies, joints=(*robot.tree.joints, twist))
    row = {"name": "pin", "kind": kind, "a": {"link": "tip"}}
    row |= {"b": {"link": "rocker", "xyz": (ROCKER_M, 0.0, 0.0)}}
    row |= {"axis": (0.0, 2.0, 0.0)} if kind == "hinge" else {}
    loops = resolve_loops(tree, [LoopRow.model_validate(row)])
    start = {"crank_joint": 0.4, "coupler_joint": 0.0, "rocker_joint": 0.0, "twist": 0.3}
    found = close(tree, loops, start, (*FREE, "twist"))
    assert found.closed
    turned = abs(math.sin(found.positions["twist"]))
    assert turned < 1e-8 if kind == "hinge" else turned > 0.1
    motion = dynamics(tree, found.positions, {})
    assert len(coordinates(loops, motion, ("crank_joint",))) == ways


def test_a_hinge_without_an_axis_is_refused():
    row = {"name": "pin", "a": {"link": "coupler"}, "b": {"link": "rocker"}}
    with pytest.raises(ValueError, match="a hinge has an `axis`"):
        LoopRow.model_validate(row | {"kind": "hinge"})
    with pytest.raises(ValueError, match="no other kind has one"):
        LoopRow.model_validate(row | {"kind": "weld", "axis": (0.0, 1.0, 0.0)})


@pytest.mark.parametrize("angle", [0.3, 0.9])
def test_the_inertia_is_twice_the_kinetic_energy_at_one_radian_per_second(angle: float):
    step, bar = 1e-5, four_bar()
    before, after = closed(angle - step), closed(angle + step)
    robot = dynamics(bar.tree, closed(angle), {})
    speeds = np.zeros(len(robot.mass))
    for name in robot.joints:
        speeds[robot.column(name)] = (after[name] - before[name]) / (2.0 * step)
    felt = felt_inertia(bar.control.loops, robot)["crank_joint"]
    assert felt == pytest.approx(float(speeds @ robot.mass @ speeds), rel=1e-6)
