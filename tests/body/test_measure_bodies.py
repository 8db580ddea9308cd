"""Numbers of the bodies that a report shows, derived another way."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tiny import ball_inertial, box_inertial

from assetbuild.body.measure_bodies import center_of_mass, ellipsoid, principal
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Body, Joint, Keyframe, Tree
from assetbuild.robot.pose import Pose, rotation_of


def test_the_centre_of_mass_is_the_mean_weighed_by_mass():
    """1 kg at the origin; 3 kg 0.1 m above a joint at x = 1, which a quarter turn lays along x."""
    low, high = ball_inertial(1.0, 0.1), ball_inertial(3.0, 0.1, (0.0, 0.0, 0.1))
    joint = Joint("j", "revolute", "a", "b", Pose((1.0, 0.0, 0.0)), (0.0, 1.0, 0.0))
    tree = Tree("t", "fixed", (Body("a", low), Body("b", high)), (joint,))
    turned = Keyframe("home", (("j", math.pi / 2),), Pose((0.0, 0.0, 2.0)))
    assert center_of_mass(tree, turned) == pytest.approx((0.825, 0.0, 2.0))
    assert total_mass(tree) == pytest.approx(4.0)


def test_principal_axes_turn_the_moments_back_into_the_tensor():
    inertial = replace(box_inertial(2.0, (0.1, 0.2, 0.3)), inertia_com_kg_m2=(
        3.0, 2.0, 4.0, 0.3, -0.2, 0.1))  # fmt: skip
    moments, axes = principal(inertial)
    R = rotation_of(axes)
    full = R @ np.diag(moments) @ R.T
    assert [full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]] == (
        pytest.approx(inertial.inertia_com_kg_m2)
    )


def test_the_ellipsoid_of_a_ball_is_the_ball():
    assert ellipsoid(ball_inertial(3.0, 0.25)) == pytest.approx((0.25, 0.25, 0.25))
