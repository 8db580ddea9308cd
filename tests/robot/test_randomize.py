"""Random mass properties: always those of some matter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny import box_inertial

from assetbuild.robot.inertia import pseudo_inertia
from assetbuild.robot.randomize import deform, draw, homogeneous_box, inconsistent
from assetbuild.robot.ranges import RandomMatter

BOX = (0.4, 0.2, 0.1)


def matter(density=(1.0, 1.0), com=0.0, stretch=0.0, shear=0.0):
    return RandomMatter(density=density, com=com, stretch=stretch, shear=shear)


def box(mass=6.0, size=BOX, at=(0.1, 0.0, -0.02)):
    return box_inertial(mass, size, at)


def test_a_denser_body_scales_mass_and_inertia_alike():
    drawn = draw(box(), matter(density=(0.8, 1.2)), 50, 1, "trunk")
    factor = drawn[:, 0] / box().mass_kg
    assert factor.min() < 0.85 and factor.max() > 1.15
    wanted = np.outer(factor, box().inertia_com_kg_m2)
    assert np.allclose(drawn[:, 4:], wanted, rtol=1e-12, atol=1e-15)
    assert np.allclose(drawn[:, 1:4], box().com_m, atol=1e-15)


def test_a_stretched_box_is_the_longer_box():
    unit = np.zeros((1, 10))
    unit[0, 4] = 1.0
    changed = deform(box(), matter(stretch=np.log(1.5)), unit)[0]
    longer = box(size=(0.6, 0.2, 0.1))
    assert np.allclose(changed, pseudo_inertia(longer), rtol=1e-12)


def test_a_shift_moves_the_centre_and_keeps_the_inertia_about_it():
    unit = np.zeros((1, 10))
    unit[0, 1:4] = (1.0, -1.0, 0.5)
    changed = deform(box(), matter(com=(0.01, 0.02, 0.03)), unit)[0]
    moved = box(at=(0.11, -0.02, -0.005))
    assert np.allclose(changed, pseudo_inertia(moved), rtol=1e-12, atol=1e-15)


@given(
    seed=st.integers(0, 2**32),
    stretch=st.floats(0, 0.5),
    shear=st.floats(0, 0.5),
    thin=st.floats(1e-4, 0.1),
)
def test_no_draw_breaks_the_triangle_inequality(seed, stretch, shear, thin):
    """Even for a plate, whose moments lie on the edge of what matter can have."""
    plate = box(size=(0.3, 0.3, thin))
    ranges = matter((0.5, 2.0), (0.05, 0.05, 0.05), stretch, shear)
    assert not inconsistent(draw(plate, ranges, 20, seed, "plate")).any()


def test_independent_noise_on_the_moments_is_found_inconsistent():
    """The known-bad way: +-20 % on each principal moment of a thin plate."""
    plate = box(size=(0.3, 0.3, 0.01), at=(0, 0, 0))
    noise = np.random.default_rng(0).uniform(0.8, 1.2, (1000, 3))
    rows = np.zeros((1000, 10))
    rows[:, 0] = plate.mass_kg
    rows[:, 4:7] = np.array(plate.inertia_com_kg_m2[:3]) * noise
    broken = [max(r) > sum(r) - max(r) for r in rows[:, 4:7]]
    assert inconsistent(rows).tolist() == broken
    assert sum(broken) > 100


def test_draws_do_not_depend_on_how_many_there_are():
    ranges = matter((0.8, 1.2), (0.05, 0.05, 0.05), 0.3, 0.2)
    few = draw(box(), ranges, 5, 3, "trunk")
    many = draw(box(), ranges, 200, 3, "trunk")
    assert np.array_equal(few, many[:5])
    other = draw(box(), ranges, 5, 3, "arm")
    assert not np.array_equal(few, other)


def test_a_payload_is_the_box_that_it_is():
    load = homogeneous_box(3.0, BOX, (0.0, 0.0, 0.1))
    same = box(3.0, at=(0.0, 0.0, 0.1))
    assert (load.mass_kg, load.com_m) == (same.mass_kg, same.com_m)
    assert load.inertia_com_kg_m2 == pytest.approx(same.inertia_com_kg_m2)
