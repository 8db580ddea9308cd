"""Which bodies pass through each other is what MuJoCo does with the robot's own MJCF."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny import TinyRobot, examples, kept_feet, robots, run_step, tiny_quadruped, write_robot_ports

from assetbuild.robot.contact_filter import ContactFilter, passing_pairs
from assetbuild.robot.model import MjcfOnly
from assetbuild.robot.shapes import Shape, Sphere
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.pairs import touching_geoms
from assetbuild.targets.mjcf import Mjcf


def passes_in_mujoco(robot: TinyRobot, folder: Path) -> set[tuple[str, str]]:
    """Pairs of bodies (sorted names) that touch nowhere by MuJoCo's rule or by an exclude."""
    run_step(Mjcf(robot="r"), write_robot_ports(folder / "in", robot), folder / "out")
    model = mujoco.load(folder / "out/mjcf/r.xml").model
    bodies = {body.name: int(model.body(body.name).id) for body in robot.tree.bodies}
    names = {index: name for name, index in bodies.items()}
    touching = {
        frozenset(names[int(model.geom_bodyid[geom])] for geom in pair)
        for pair in touching_geoms(model)
    }
    return {pair for pair in combinations(sorted(bodies), 2) if frozenset(pair) not in touching}


def with_balls(robot: TinyRobot) -> TinyRobot:
    """A ball on every body."""
    balls = tuple(
        Shape(f"{body.name}_ball", body.name, "collision", Sphere(0.1))
        for body in robot.tree.bodies
    )
    shapes = replace(robot.shapes, shapes=balls)
    return replace(robot, shapes=shapes, control=replace(robot.control, excludes=()))


@settings(max_examples=examples(60), deadline=None)
@given(robots(max_bodies=8), st.booleans())
def test_random_robots_touch_themselves_as_in_mujoco(robot: TinyRobot, filters: bool) -> None:
    robot = with_balls(robot)
    if not filters:
        flag = MjcfOnly("option", '<option><flag filterparent="disable"/></option>')
        robot = replace(robot, control=replace(robot.control, mjcf_only=(flag,)))
    with tempfile.TemporaryDirectory() as folder:
        expected = passes_in_mujoco(robot, Path(folder))
    assert set(passing_pairs(robot.tree, robot.shapes, robot.control)) == expected


def test_a_foot_welded_to_the_shin_passes_through_the_thigh() -> None:
    robot = kept_feet()
    rule = ContactFilter.of(robot.tree, robot.shapes, robot.control)
    assert rule.passes("FL_foot", "FL_calf")
    assert rule.passes("FL_foot", "FL_thigh")
    assert not rule.passes("FL_foot", "FL_hip")
    assert not rule.passes("FL_foot", "FR_foot")


@pytest.mark.parametrize(("base", "passes"), [("floating", True), ("fixed", False)])
def test_a_hip_touches_a_trunk_that_is_bolted_to_the_world(base: str, passes: bool) -> None:
    robot = tiny_quadruped()
    tree = replace(robot.tree, base=base)
    assert ContactFilter.of(tree, robot.shapes, robot.control).passes("FL_hip", "trunk") is passes
