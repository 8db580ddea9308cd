"""Mass properties and joint-space dynamics agree with other formulas and other libraries."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_robots import examples, inertials, poses, robots
from robot_files import compiled
from tiny import TinyRobot, ball_inertial, box_inertial, pendulum, standing_height, tiny_quadruped

from assetbuild.robot.dynamics import dynamics, holding_torques
from assetbuild.robot.inertia import (
    about_point,
    combine,
    equivalent_radius,
    matrix_of,
    move_inertial,
    pseudo_inertia,
    tensor_of,
    triangle_violation,
)
from assetbuild.robot.model import Body, Inertial, Mimic
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.simulators.mujoco import mass_matrix


def armatures(robot: TinyRobot) -> dict[str, float]:
    return {a.joint: a.armature for a in robot.control.actuators}


@settings(max_examples=examples(40), deadline=None)
@given(robots())
def test_the_mass_matrix_of_any_tree_is_mujocos(robot: TinyRobot) -> None:
    with TemporaryDirectory() as folder:
        model = compiled(robot, Path(folder))
    data = mujoco.MjData(model)
    q = {j.name: 0.1 + 0.2 * i for i, j in enumerate(robot.tree.moving_joints)}
    for name, value in q.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    if robot.tree.base == "floating":
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
    mujoco.mj_forward(model, data)
    ours = dynamics(robot.tree, q, armatures(robot))
    columns = list(range(ours.free)) + [int(model.joint(n).dofadr[0]) for n in ours.joints]
    theirs = mass_matrix(model, data)[np.ix_(columns, columns)]
    assert np.allclose(ours.mass, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max(initial=1.0))
    bias = data.qfrc_bias[columns]
    assert np.allclose(ours.gravity, bias, rtol=0, atol=1e-10 * np.abs(bias).max(initial=1.0))


def test_a_pendulum_has_the_inertia_of_a_rod_about_its_end() -> None:
    found = dynamics(pendulum().tree, {"swing_joint": 0.5}, {"swing_joint": 0.25})
    rod = (0.02**2 + 0.5**2) / 12 + 0.25**2
    assert found.effective_inertia()["swing_joint"] == pytest.approx(rod + 0.25)
    torque, left = holding_torques(found, ())
    assert torque["swing_joint"] == pytest.approx(9.81 * 0.25 * math.sin(0.5))
    assert left == 0.0


def test_four_equal_legs_share_the_weight() -> None:
    robot = tiny_quadruped()
    q = dict(robot.control.keyframes[0].joints)
    base = Pose((0.0, 0.0, standing_height(0.8)))
    found = dynamics(robot.tree, q, armatures(robot), base=base)
    feet = []
    for leg in ("FR", "FL", "RR", "RL"):
        body, X_body_foot = robot.tree.placement(f"{leg}_foot")
        feet.append((body, found.bodies[body].pose.apply(X_body_foot.xyz)))
    torque, left = holding_torques(found, feet)
    assert left == pytest.approx(0.0, abs=1e-6)
    calves = [abs(torque[f"{leg}_calf_joint"]) for leg in ("FR", "FL", "RR", "RL")]
    # Left equals right but for the IMU of 10 g; a calf carries its share of the weight over the
    # lever, less what hangs below the knee.
    assert calves[0::2] == pytest.approx(calves[1::2], rel=0.03)
    total = sum(b.inertial.mass_kg for b in robot.tree.bodies if b.inertial)
    lever = 0.2 * math.sin(0.8)
    assert sum(calves) == pytest.approx((total - 4 * 0.15) * 9.81 * lever, rel=0.03)


@pytest.mark.parametrize("apart", [1e-9, 1e-12, 0.0])
def test_feet_that_stand_on_one_line_bear_no_more_than_the_weight(apart: float) -> None:
    """A singular pose: to balance the moment such feet would have to pull at the floor, hard."""
    robot = tiny_quadruped()
    found = dynamics(robot.tree, {}, armatures(robot), base=Pose((0.0, 0.0, standing_height(0.0))))
    weight = 9.81 * sum(b.inertial.mass_kg for b in robot.tree.bodies if b.inertial)
    feet = [
        (robot.tree.placement(f"{leg}_foot")[0],
         np.array([0.02 + apart * index, 0.0, 0.0]))
        for index, leg in enumerate(("FR", "FL", "RR", "RL"))
    ]  # fmt: skip
    torque, left = holding_torques(found, feet)
    assert max(map(abs, torque.values())) < 1.0 * weight
    assert left < 0.2


def test_a_mimic_joint_moves_with_its_leader() -> None:
    """A rotor that mimics with -9 adds 81 times its inertia."""
    arm = pendulum().tree
    hinge = arm.joints[0]
    rotor = replace(hinge, name="rotor", child="rotor", mimic=Mimic("swing_joint", -9.0))
    small = Body("rotor", ball_inertial(0.1, 0.01))
    both = replace(arm, bodies=(*arm.bodies, small), joints=(hinge, rotor))
    moment = 0.4 * 0.1 * 0.01**2
    alone, geared = dynamics(arm, {}, {}), dynamics(both, {}, {})
    assert geared.joints == ("swing_joint",)
    assert geared.mass[0, 0] - alone.mass[0, 0] == pytest.approx(81 * moment)


points = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
parts = st.lists(inertials(), min_size=1, max_size=5)


def cloud(inertial: Inertial) -> tuple[np.ndarray, np.ndarray]:
    """Six points (6, 3) and masses (6,) with the same mass, centre and inertia.

    Pairs at +-a along the principal axes of the second moments; solves m a^2 = s.
    """
    tensor = matrix_of(inertial.inertia_com_kg_m2)
    second = np.trace(tensor) / 2 * np.eye(3) - tensor
    values, axes = np.linalg.eigh(second)
    reach = np.sqrt(np.maximum(values, 0.0) * 3 / inertial.mass_kg)
    offsets = np.concatenate([axes.T * reach[:, None], -axes.T * reach[:, None]])
    return np.asarray(inertial.com_m) + offsets, np.full(6, inertial.mass_kg / 6)


def tensor_of_cloud(points: np.ndarray, masses: np.ndarray, about: np.ndarray) -> np.ndarray:
    d = points - about
    return sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, d, strict=True))


def near(a: np.ndarray, b: np.ndarray, scale: float) -> bool:
    return bool(np.abs(np.asarray(a) - np.asarray(b)).max() <= 1e-9 * max(scale, 1e-12))


@given(parts, points)
def test_combined_bodies_turn_like_the_points_they_are_made_of(bodies: list[Inertial], p: tuple):
    clouds = [cloud(body) for body in bodies]
    positions = np.concatenate([c[0] for c in clouds])
    masses = np.concatenate([c[1] for c in clouds])
    whole = combine(bodies)
    expected = tensor_of_cloud(positions, masses, np.asarray(p))
    assert whole.mass_kg == pytest.approx(masses.sum(), rel=1e-12)
    assert near(whole.com_m, masses @ positions / masses.sum(), 10.0)
    assert near(matrix_of(about_point(whole, p)), expected, np.abs(expected).max())


@given(inertials(), poses(), poses())
def test_moving_twice_is_moving_by_the_product(body: Inertial, A: Pose, B: Pose):
    one, two = move_inertial(body, A @ B), move_inertial(move_inertial(body, B), A)
    assert near(one.com_m, two.com_m, 1.0)
    assert near(one.inertia_com_kg_m2, two.inertia_com_kg_m2, max(map(abs, one.inertia_com_kg_m2)))


@given(inertials())
def test_the_identity_changes_no_bit(body: Inertial):
    assert move_inertial(body, IDENTITY) is body
    assert combine([body]) is body
    assert tensor_of(matrix_of(body.inertia_com_kg_m2)) == body.inertia_com_kg_m2


@given(inertials())
def test_the_pseudo_inertia_of_real_matter_is_positive_definite(body: Inertial):
    points, masses = cloud(body)
    homogeneous = np.c_[points, np.ones(len(points))]
    expected = (homogeneous * masses[:, None]).T @ homogeneous
    pseudo = pseudo_inertia(body)
    assert near(pseudo, expected, np.abs(expected).max())
    assert np.linalg.eigvalsh(pseudo).min() > 0.0
    assert triangle_violation(body.inertia_com_kg_m2) < 0.0


def test_a_tensor_no_matter_can_have():
    assert triangle_violation((1.0, 1.0, 3.0, 0.0, 0.0, 0.0)) == pytest.approx(1 / 3)
    bad = Inertial(1.0, (1.0, 2.0, 3.0), (1.0, 1.0, 3.0, 0.0, 0.0, 0.0))
    assert np.linalg.eigvalsh(pseudo_inertia(bad)).min() < 0.0


def test_parts_without_mass_add_nothing():
    brick = box_inertial(1.0, (1.0, 2.0, 3.0))
    nothing = Inertial(0.0, (5.0, 5.0, 5.0), (0.0,) * 6)
    assert combine([brick, nothing]) == brick
    assert combine([nothing, nothing]) == nothing
    with pytest.raises(ValueError, match="nothing to combine"):
        combine([])


def test_the_equivalent_radius_of_a_ball_is_its_radius():
    assert equivalent_radius(ball_inertial(3.0, 0.2)) == pytest.approx(0.2)
    assert equivalent_radius(Inertial(0.0, (0.0,) * 3, (1.0,) * 6)) == math.inf
