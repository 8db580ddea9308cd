"""Which mass properties a body's shapes and its mirror twin contradict, and which they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tiny import box_inertial

from assetbuild.mesh.hulls import extent_of
from assetbuild.mesh.primitives import tessellate
from assetbuild.robot.contradictions import REACH, Extent, beyond_reach, contradictions, twins_apart
from assetbuild.robot.model import Base, Body, Inertial, Joint, Tree
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.robot.shapes import Box

SIZE: Vec3 = (0.1, 0.06, 0.08)
R2 = 0.05**2 + 0.03**2 + 0.04**2
"""m², from the middle of the box to a corner: no kilogram in it has more than R2 kg m2."""


def extent(size: Vec3 = SIZE) -> Extent:
    return extent_of([tessellate(Box(size)).vertices])


def weighing(times: float, mass: float = 2.0) -> Inertial:
    """A tensor of so many times m r²."""
    moment = times * mass * R2
    return Inertial(mass, (0.0, 0.0, 0.0), (moment, moment, moment, 0.0, 0.0, 0.0))


def arm(inertial: Inertial, base: Base = "fixed", second: str = "0 1 0") -> Tree:
    """A base, a link on a vertical hinge, and one on a second axis."""
    axis = np.fromstring(second, sep=" ")
    joints = (
        Joint("j0", "revolute", "base", "first", axis=(0.0, 0.0, 1.0)),
        Joint("j1", "revolute", "first", "second", axis=(axis[0], axis[1], axis[2])),
    )
    bodies = (Body("base", inertial), Body("first", inertial), Body("second", inertial))
    return Tree("arm", base, bodies, joints)


EXTENTS = {name: extent() for name in ("base", "first", "second")}


@pytest.mark.parametrize(("times", "wrong"), [(0.3, False), (1.0, False), (2.9, False), (3.1, True),
                                              (200.0, True)])  # fmt: skip
def test_no_mass_has_three_times_the_inertia_of_its_farthest_point(times: float, wrong: bool):
    found = beyond_reach(arm(weighing(times), "floating"), EXTENTS)
    assert found == (dict.fromkeys(EXTENTS, pytest.approx(times)) if wrong else {})
    told = contradictions(arm(weighing(times), "floating"), EXTENTS)
    assert [(f.rule, f.unready) for f in told] == [("inertia.reach", True)] * len(found)


def test_axes_that_no_motion_shows_do_not_count():
    """The first link of a fixed arm turns about one axis: identification leaves the others open."""
    free = replace(weighing(0.3), inertia_com_kg_m2=(1.0, 1.0, 0.001, 0.0, 0.0, 0.0))
    assert set(beyond_reach(arm(free), EXTENTS)) == {"second"}
    assert beyond_reach(arm(free, second="0 0 1"), EXTENTS) == {}  # all axes are parallel
    about_z = replace(free, inertia_com_kg_m2=(0.001, 0.001, 1.0, 0.0, 0.0, 0.0))
    assert set(beyond_reach(arm(about_z), EXTENTS)) == {"first", "second"}


def test_a_frame_that_weighs_nothing_is_no_fault():
    """MJCFs give 1e-8 kg and 1e-8 kg m2 to a tool; what the arm turns does not feel it."""
    tool = Body("tool", weighing(100.0, mass=1e-8))
    joint = Joint("j2", "revolute", "second", "tool", Pose((0.0, 0.0, 0.1)), (0.0, 0.0, 1.0))
    carried = Joint("j3", "revolute", "tool", "load", Pose((0.0, 0.0, 0.1)), (1.0, 0.0, 0.0))
    tree = arm(weighing(0.3))
    extents = {**EXTENTS, "tool": extent()}
    alone = replace(tree, bodies=(*tree.bodies, tool), joints=(*tree.joints, joint))
    assert set(beyond_reach(alone, extents)) == {"tool"}, "all that its joint turns"
    load = Body("load", weighing(0.3))
    bodies, joints = (*alone.bodies, load), (*alone.joints, carried)
    assert beyond_reach(replace(alone, bodies=bodies, joints=joints), extents) == {}


def test_a_marker_too_small_for_the_mass_is_no_measure_of_it():
    """2 kg in 1 mm³ would be 2e9 kg/m³."""
    tiny = dict.fromkeys(EXTENTS, extent((0.001, 0.001, 0.001)))
    assert beyond_reach(arm(weighing(1.0), "floating"), tiny) == {}


# --- twins --------------------------------------------------------------------------------------

GOOD = box_inertial(0.6, SIZE)


def pair(right: Inertial, names: tuple[str, str] = ("left_hip", "right_hip"),
         place: Vec3 = (0.2, -0.1, 0.0)) -> Tree:  # fmt: skip
    """Two hips at mirrored places."""
    left_name, right_name = names
    bodies = (Body("base", GOOD), Body(left_name, GOOD), Body(right_name, right))
    joints = (
        Joint("a", "revolute", "base", left_name, X_parent_joint=Pose((0.2, 0.1, 0.0))),
        Joint("b", "revolute", "base", right_name, X_parent_joint=Pose(place)),
    )
    return Tree("pair", "floating", bodies, joints)


def times(factor: float, axis: int = 2) -> Inertial:
    tensor = list(GOOD.inertia_com_kg_m2)
    tensor[axis] *= factor
    a, b, c, d, e, f = tensor
    return replace(GOOD, inertia_com_kg_m2=(a, b, c, d, e, f))


NAMES = [("left_hip", "right_hip"), ("FL_hip", "FR_hip")]


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("factor", [200.0, 0.05, 4.0])
def test_one_of_two_twins_is_wrong(names: tuple[str, str], factor: float):
    shapes = dict.fromkeys(("base", *names), extent())
    (apart,) = twins_apart(pair(times(factor), names), shapes)
    assert (apart.data["other"], apart.data["sure"]) == (names[0], True)
    found = [f for f in contradictions(pair(times(factor), names), shapes) if f.rule != REACH.id]
    assert [(f.rule, f.subject) for f in found] == [("inertia.twin", f"link {names[1]}")]
    assert found[0].unready


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("factor", [1.0, 2.5, 0.5])
def test_twins_are_never_quite_alike(names: tuple[str, str], factor: float):
    assert not list(twins_apart(pair(times(factor), names), dict.fromkeys(names, extent())))


@pytest.mark.parametrize("other", [(0.1, 0.06, 0.16), (0.2, 0.12, 0.16)])
def test_another_shape_may_weigh_otherwise(other: Vec3):
    shapes = {"left_hip": extent(), "right_hip": extent(other)}
    assert not list(twins_apart(pair(times(0.05)), shapes))


def test_another_place_is_no_twin():
    shapes = dict.fromkeys(("left_hip", "right_hip"), extent())
    assert not list(twins_apart(pair(times(0.05), place=(0.1, -0.1, 0.0)), shapes))
