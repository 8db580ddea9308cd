"""Poses compose, trees move, and merging fixed joints loses nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from random_robots import poses, robots, unit_vectors
from tiny import TinyRobot, box_inertial, tiny_quadruped

from assetbuild.robot.inertia import about_point, combine, matrix_of, move_inertial
from assetbuild.robot.model import Body, Inertial, Joint, Limits, Tree
from assetbuild.robot.pose import (
    IDENTITY,
    Pose,
    Vec3,
    normalised_quat,
    quat_between,
    quat_multiply,
    quat_of_rpy,
    rotation_of,
    rpy_of,
)
from assetbuild.robot.tree import (
    Merged,
    depth_first,
    forward_kinematics,
    joint_motion,
    merge_fixed_joints,
    sample_positions,
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


@given(angles, angles, angles)
def test_rpy_means_fixed_axes_x_then_y_then_z(roll: float, pitch: float, yaw: float):
    expected = axis_rotation("z", yaw) @ axis_rotation("y", pitch) @ axis_rotation("x", roll)
    assert np.abs(rotation_of(quat_of_rpy(roll, pitch, yaw)) - expected).max() < 1e-12


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
@example((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
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


BRICK = box_inertial(2.0, (0.1, 0.2, 0.3))
ASKEW = Pose((0.1, -0.2, 0.3), quat_of_rpy(0.4, -0.5, 0.6))
TURNED = Pose(ASKEW.xyz, quat_of_rpy(0.0, 0.0, 3.1416))


def source(robot: TinyRobot) -> Tree:
    """A random tree as a reader would give it: no frames yet."""
    return replace(robot.tree, frames=())


def chain(*joints: tuple[str, Pose], base: str = "floating", root: Inertial | None = BRICK) -> Tree:
    """b0 - b1 - ... ; `joints` are (kind, X_parent_joint)."""
    bodies = [Body("b0", root)] + [Body(f"b{i + 1}", BRICK) for i in range(len(joints))]
    made = [
        Joint(f"j{i}", kind, f"b{i}", f"b{i + 1}", X)  # type: ignore[arg-type] # a literal in each test
        for i, (kind, X) in enumerate(joints)
    ]
    return Tree("chain", base, tuple(bodies), tuple(made))  # type: ignore[arg-type] # as above


def whole(tree: Tree, positions: dict[str, float], X_start: Pose = IDENTITY) -> Inertial:
    """All mass of the robot in the frame of its source root."""
    poses = forward_kinematics(tree, positions)
    return combine(
        [move_inertial(b.inertial, X_start @ poses[b.name]) for b in tree.bodies if b.inertial]
    )


@given(robots(), st.data())
def test_merging_keeps_mass_centre_and_inertia_in_every_pose(robot: TinyRobot, data: st.DataObject):
    before = source(robot)
    kept = data.draw(st.sets(st.sampled_from([b.name for b in before.bodies])))
    after, _ = merge_fixed_joints(before, True, kept)
    X_root_start = after.placement(before.root)[1].inverse()
    for positions in sample_positions(before, 2, seed=3):
        a, b = whole(before, positions), whole(after, positions, X_root_start)
        scale = np.abs(about_point(a, (0.0, 0.0, 0.0))).max()
        assert a.mass_kg == pytest.approx(b.mass_kg, rel=1e-12)
        assert np.allclose(a.com_m, b.com_m, atol=1e-9)
        for point in ((0.0, 0.0, 0.0), (1.0, -2.0, 0.5)):
            ours, theirs = (matrix_of(about_point(x, point)) for x in (a, b))
            assert np.abs(ours - theirs).max() <= 1e-9 * max(scale, a.mass_kg)


@given(robots(), st.data())
def test_merging_moves_no_link(robot: TinyRobot, data: st.DataObject):
    before = source(robot)
    kept = data.draw(st.sets(st.sampled_from([b.name for b in before.bodies])))
    after, _ = merge_fixed_joints(before, True, kept)
    X_start = after.placement(before.root)[1].inverse()
    for positions in sample_positions(before, 2, seed=3):
        links, bodies = forward_kinematics(before, positions), forward_kinematics(after, positions)
        for name, X_root_link in links.items():
            body, X_body_link = after.placement(name)
            found = X_start @ bodies[body] @ X_body_link
            assert np.abs(found.matrix() - X_root_link.matrix()).max() < 1e-12


@given(robots())
def test_merging_twice_or_in_two_groups_is_merging_once(robot: TinyRobot):
    before = source(robot)
    once, _ = merge_fixed_joints(before, True, ())
    half, _ = merge_fixed_joints(before, True, {before.bodies[-1].name})
    again, _ = merge_fixed_joints(replace(half, frames=()), True, ())
    assert [b.name for b in again.bodies] == [b.name for b in once.bodies]
    assert merge_fixed_joints(replace(once, frames=()), True, ())[0] == replace(once, frames=())
    for a, b in zip(again.bodies, once.bodies, strict=True):
        assert a.inertial is not None and b.inertial is not None
        scale = max(map(abs, b.inertial.inertia_com_kg_m2)) + b.inertial.mass_kg
        difference = np.subtract(a.inertial.inertia_com_kg_m2, b.inertial.inertia_com_kg_m2)
        assert np.abs(difference).max() <= 1e-10 * scale
        assert np.allclose(a.inertial.com_m, b.inertial.com_m, atol=1e-12)


def test_the_quadruped_merges_into_the_bodies_that_were_worked_out_by_hand():
    robot = tiny_quadruped()
    merged, facts = merge_fixed_joints(_reordered(robot.links), True, ())
    assert {b.name for b in merged.bodies} == {b.name for b in robot.tree.bodies}
    for body in merged.bodies:
        expected = robot.tree.by_body[body.name].inertial
        assert body.inertial is not None and expected is not None
        assert body.inertial.mass_kg == pytest.approx(expected.mass_kg, rel=1e-15)
        if body.name != "trunk":  # its imu is turned; the worked example leaves axes parallel
            close = pytest.approx(expected.inertia_com_kg_m2, abs=1e-15)
            assert body.inertial.inertia_com_kg_m2 == close
    assert {f.name: f.X_body_frame for f in merged.frames} == {
        f.name: f.X_body_frame for f in robot.tree.frames
    }
    assert Merged("FR_calf", ("FR_foot",)) in facts


def _reordered(tree: Tree) -> Tree:
    links, joints = depth_first(tree.root, tree.joints)
    return replace(tree, bodies=tuple(tree.by_body[n] for n in links), joints=joints)


def test_a_kept_link_stays_on_its_fixed_joint_and_takes_what_hangs_below():
    tree = chain(("fixed", ASKEW), ("fixed", ASKEW), ("fixed", ASKEW))
    merged, _ = merge_fixed_joints(tree, True, {"b2"})
    assert [b.name for b in merged.bodies] == ["b0", "b2"]
    assert merged.joints == (replace(tree.joints[1], parent="b0", X_parent_joint=ASKEW @ ASKEW),)
    assert merged.placement("b3") == ("b2", ASKEW)


@pytest.mark.parametrize("root", [None, Inertial(1e-6, (0.0,) * 3, (1e-6,) * 6)])
def test_a_placeholder_root_gives_name_and_frame_to_the_heaviest_link(root: Inertial | None):
    tree = chain(("fixed", TURNED), ("continuous", ASKEW), root=root)
    merged, facts = merge_fixed_joints(tree, True, ())
    assert merged.root == "b1"
    assert facts == (Merged("b1", ("b0",), placeholder="b0"),)
    assert merged.joints[0] == tree.joints[1], "what hung on the heavy link keeps every bit"
    there_and_back = merged.placement("b0")[1] @ TURNED
    assert np.abs(there_and_back.matrix() - np.eye(4)).max() < 1e-15


def test_a_heavy_root_or_a_placeholder_on_a_moving_joint_keeps_its_name():
    assert merge_fixed_joints(chain(("fixed", ASKEW)), True, ())[0].root == "b0"
    assert merge_fixed_joints(chain(("revolute", ASKEW), root=None), True, ())[0].root == "b0"


def test_a_fixed_base_stays_where_the_source_mounts_it():
    level = chain(("fixed", IDENTITY), base="fixed", root=None)
    askew = chain(("fixed", ASKEW), base="fixed", root=None)
    assert merge_fixed_joints(level, True, ())[0].root == "b1"
    assert merge_fixed_joints(askew, True, ())[0].root == "b0"


@pytest.mark.parametrize("rpy", [(np.pi / 2, np.pi / 2, 0.0), (np.pi, 0.0, 0.0), (0.0, 0.1, 0.0)])
def test_a_floating_base_stays_upright_as_its_placeholder_says(rpy: Vec3):
    """CAD frames have other axes; a `base_footprint` says which way is up."""
    on_its_side = chain(("fixed", Pose((0.0, 0.0, 0.2), quat_of_rpy(*rpy))), root=None)
    assert merge_fixed_joints(on_its_side, True, ())[0].root == "b0"


def test_joints_turn_and_slide_about_their_axis():
    hinge = Joint("h", "revolute", "a", "b", axis=(0.0, 0.0, 1.0))
    slide = Joint("s", "prismatic", "a", "b", axis=(0.0, 1.0, 0.0))
    assert joint_motion(hinge, np.pi / 2).apply((1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert joint_motion(slide, 0.3).xyz == (0.0, 0.3, 0.0)
    assert joint_motion(hinge, 0.0) is IDENTITY
    with pytest.raises(ValueError, match="planar"):
        joint_motion(replace(hinge, kind="planar"), 1.0)


def test_a_range_that_stands_for_none_is_not_sampled_to_its_ends():
    tree = chain(("revolute", IDENTITY), ("revolute", IDENTITY))
    ranges = Limits(-1e6, 1e6), Limits(5e3, 6e3)
    joints = (replace(j, limits=r) for j, r in zip(tree.joints, ranges, strict=True))
    samples = sample_positions(replace(tree, joints=tuple(joints)), 20, seed=5)
    assert all(abs(s["j0"]) <= 100.0 and 5e3 <= s["j1"] <= 6e3 for s in samples)
