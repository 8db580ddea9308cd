"""Rigid transforms obey the axioms of their group, and read angles as URDF does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny import poses, unit_vectors

from assetbuild.robot.pose import (
    IDENTITY,
    Pose,
    Vec3,
    normalised_quat,
    quat_between,
    quat_multiply,
    quat_of,
    quat_of_rpy,
    rotation_of,
    rpy_of,
    vec3,
)

angles = st.floats(-math.pi, math.pi)


def close(a: Pose, b: Pose, tolerance: float = 1e-12) -> bool:
    return bool(np.abs(a.matrix() - b.matrix()).max() <= tolerance)


def axis_rotation(axis: str, angle: float) -> np.ndarray:
    """Textbook rotation about one coordinate axis."""
    c, s = math.cos(angle), math.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@given(poses())
def test_a_pose_and_its_inverse_cancel(X: Pose):
    assert close(X @ X.inverse(), IDENTITY)
    assert close(X.inverse() @ X, IDENTITY)


@given(poses(), poses(), poses())
def test_composition_is_associative(A: Pose, B: Pose, C: Pose):
    assert close((A @ B) @ C, A @ (B @ C))


@given(poses(), poses())
def test_composition_is_the_product_of_matrices(A: Pose, B: Pose):
    assert np.allclose((A @ B).matrix(), A.matrix() @ B.matrix(), atol=1e-12)


@given(poses(), st.tuples(*[st.floats(-10, 10)] * 3))
def test_applying_is_multiplying(X: Pose, p: Vec3):
    assert np.allclose(X.apply(p), (X.matrix() @ [*p, 1.0])[:3], atol=1e-12)


@given(poses())
def test_the_identity_changes_no_bit(X: Pose):
    assert IDENTITY @ X == X
    assert X @ IDENTITY == X
    assert IDENTITY.inverse() == IDENTITY
    assert "-0.0" not in repr(IDENTITY.inverse())


@given(poses())
def test_rotations_are_proper(X: Pose):
    assert np.allclose(X.rotation @ X.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(X.rotation) == pytest.approx(1.0)


@given(poses())
def test_matrix_and_quaternion_round_trip(X: Pose):
    assert np.abs(rotation_of(quat_of(X.rotation)) - X.rotation).max() < 1e-12


@given(angles, angles, angles)
def test_rpy_means_fixed_axes_x_then_y_then_z(roll: float, pitch: float, yaw: float):
    expected = axis_rotation("z", yaw) @ axis_rotation("y", pitch) @ axis_rotation("x", roll)
    assert np.abs(rotation_of(quat_of_rpy(roll, pitch, yaw)) - expected).max() < 1e-12


@given(poses())
def test_quaternion_and_rpy_round_trip(X: Pose):
    assert np.abs(rotation_of(quat_of_rpy(*rpy_of(X.quat))) - X.rotation).max() < 1e-12


@given(
    angles,
    angles,
    st.sampled_from([0.0, 1e-15, 1e-13, 1e-12, 1e-10, 1e-9, 1e-8, 1e-6, 1e-4]),
    st.sampled_from([1.0, -1.0]),
)
def test_rpy_round_trips_at_and_near_gimbal_lock(roll: float, yaw: float, off: float, sign: float):
    quat = quat_of_rpy(roll, sign * (math.pi / 2 - off), yaw)
    assert np.abs(rotation_of(quat_of_rpy(*rpy_of(quat))) - rotation_of(quat)).max() < 3e-12


def test_no_rotation_has_no_angles():
    assert rpy_of((1.0, 0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert quat_of_rpy(0.0, -0.0, 0.0) == (1.0, 0.0, 0.0, 0.0)


@given(unit_vectors(), unit_vectors())
def test_quat_between_takes_one_direction_to_the_other(a: Vec3, b: Vec3):
    assert np.allclose(rotation_of(quat_between(a, b)) @ a, b, atol=1e-6)


@given(poses(), poses())
def test_products_of_unit_quaternions_are_unit_with_w_not_negative(A: Pose, B: Pose):
    product = quat_multiply(A.quat, B.quat)
    assert math.hypot(*product) == pytest.approx(1.0, abs=1e-15)
    assert product[0] >= 0.0


def test_a_zero_quaternion_is_refused():
    with pytest.raises(ValueError, match="not zero"):
        normalised_quat((0.0, 0.0, 0.0, 0.0))


def test_negative_zero_becomes_zero():
    assert repr(vec3((-0.0, 0.0, -0.0))) == "(0.0, 0.0, 0.0)"
