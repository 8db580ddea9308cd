"""Rows of joints with massless links between them, and bodies that MuJoCo lets pass."""

from __future__ import annotations

import re
import tempfile
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_robots import examples, robots
from robot_files import emit, run_step, write_robot_ports
from tiny import TinyRobot, ball_inertial, box_inertial, tiny_quadruped

from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.robot.chains import find_chains
from assetbuild.robot.contact_filter import ContactFilter, passing_pairs
from assetbuild.robot.model import (
    Actuator,
    Body,
    Control,
    Frame,
    Inertial,
    Joint,
    Limits,
    MjcfOnly,
    Tree,
)
from assetbuild.robot.pose import Pose, normalised_quat
from assetbuild.robot.shapes import Shape, Shapes, Sphere
from assetbuild.robot.tree import forward_kinematics, sample_positions
from assetbuild.simulators.mujoco import load
from assetbuild.simulators.mujoco.pairs import touching_geoms
from assetbuild.targets.mjcf import Mjcf

TURNED = normalised_quat((0.9, 0.1, -0.2, 0.3))
LIMITS = Limits(-1.2, 1.3, 10.0, 5.0)


def hip(kinds: tuple[str, ...] = ("revolute", "prismatic", "revolute")) -> TinyRobot:
    """A trunk, joints with massless links between them, a leg below, a foot on the leg."""
    names = ["trunk", *(f"between{i}" for i in range(1, len(kinds))), "leg"]
    axes = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.6, 0.8, 0.0))
    joints = [
        Joint(
            f"j{i}",
            kind,  # type: ignore[arg-type] # a literal
            names[i],
            names[i + 1],
            Pose((0.05 * i, 0.1, -0.02), TURNED if i != 1 else (1.0, 0.0, 0.0, 0.0)),
            axes[i % 3],
            LIMITS if kind != "planar" else Limits(),
        )
        for i, kind in enumerate(kinds)
    ]
    joints.append(
        Joint("ankle", "revolute", "leg", "foot", Pose((0.0, 0.0, -0.4)), axes[1], LIMITS)
    )
    leg = box_inertial(2.0, (0.05, 0.06, 0.4), (0.01, 0.0, -0.2))
    bodies = (
        Body("trunk", box_inertial(10.0, (0.3, 0.2, 0.1))),
        *(Body(name) for name in names[1:-1]),
        Body("leg", leg),
        Body("foot", ball_inertial(0.3, 0.04)),
    )
    tree = Tree("hip", "floating", bodies, tuple(joints))
    drives = tuple(Actuator(j.name, "pd", 20.0, 1.0, effort=10.0) for j in tree.moving_joints)
    return TinyRobot(tree, tree, Shapes(), Control(drives, excludes=(("between1", "trunk"),)))


def built(robot: TinyRobot, folder: Path) -> mujoco.MjModel:
    inputs = write_robot_ports(folder / "in", robot)
    found = run_step(Mjcf(robot="hip"), inputs, inputs)
    assert [f.rule for f in found if f.subject == "link leg"] == ["mjcf.chain"]
    return mujoco.MjModel.from_xml_path(str(inputs / "mjcf/hip.xml"))


def test_they_move_as_the_robot_does(tmp_path: Path):
    """MuJoCo's kinematics against the product of the tree's own transforms."""
    robot = hip()
    model = built(robot, tmp_path)
    data = mujoco.MjData(model)
    for positions in sample_positions(robot.tree, 20, seed=3):
        for name, value in positions.items():
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        expected = forward_kinematics(robot.tree, positions)
        for body in ("leg", "foot"):
            assert data.body(body).xpos == pytest.approx(np.array(expected[body].xyz), abs=1e-14)
            matrix = data.body(body).xmat.reshape(3, 3)
            assert matrix == pytest.approx(expected[body].rotation, abs=1e-14)


@pytest.mark.parametrize("kinds", [("planar", "revolute"), ("continuous",) * 5, ("revolute",) * 6])
def test_the_check_agrees(kinds: tuple[str, ...], tmp_path: Path):
    robot = hip(kinds)
    built(robot, tmp_path)
    assert run_step(MjcfFacts(robot="hip"), tmp_path / "in", tmp_path / "out") == []


def test_the_check_sees_a_joint_in_the_wrong_place(tmp_path: Path):
    built(hip(), tmp_path)
    path = tmp_path / "in/mjcf/hip.xml"
    moved = re.sub(r'(name="j0"[^>]* pos=")[^"]*', r"\g<1>1 2 3", path.read_text())
    path.write_text(moved)
    found = run_step(MjcfFacts(robot="hip"), tmp_path / "in", tmp_path / "out")
    assert "equal.mjcf.anchor" in {f.rule for f in found}


def chains_of(tree: Tree, shown: tuple[str, ...] = ()) -> list[tuple[str, tuple[str, ...]]]:
    return [(chain.body, chain.between) for chain in find_chains(tree, shown)]


def test_only_massless_links_that_carry_nothing_are_between():
    tree = hip().tree
    assert chains_of(tree) == [("leg", ("between1", "between2"))]
    assert chains_of(tree, shown=("between2",)) == []
    heavy = replace(tree, bodies=(*tree.bodies[:1], Body("between1", ball_inertial(0.1, 0.1)),
                                  *tree.bodies[2:]))  # fmt: skip
    assert chains_of(heavy) == [("leg", ("between2",))]
    framed = replace(tree, frames=(Frame("imu", "between1", Pose()),))
    assert chains_of(framed) == [("leg", ("between2",))]
    zeros = Body("between1", Inertial(0.0, (0.0, 0.0, 0.0), (0.0,) * 6))
    stated = replace(tree, bodies=(tree.bodies[0], zeros, *tree.bodies[2:]))
    assert chains_of(stated) == chains_of(tree)


def test_more_than_six_degrees_of_freedom_stay_as_they_are():
    assert chains_of(hip(("revolute",) * 7).tree) == []
    assert chains_of(hip(("planar", "planar", "revolute")).tree) == []


def test_what_is_shown_is_not_lost(tmp_path: Path):
    """A massless link with a shape stays a body, which MuJoCo then refuses: loud, not lost."""
    robot = hip()
    ball = Shape("ball", "between1", "visual", Sphere(0.01))
    with pytest.raises(ValueError, match="mass and inertia of moving bodies"):
        built(replace(robot, shapes=Shapes((ball,))), tmp_path)


def passes_in_mujoco(robot: TinyRobot, folder: Path) -> set[tuple[str, str]]:
    """Pairs of bodies (sorted names) that touch nowhere by MuJoCo's rule or by an exclude."""
    emit(Mjcf(robot="r"), robot, folder)
    model = load(folder / "out/mjcf/r.xml").model
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
@given(robots(max_bodies=8), st.sampled_from(["", "enable", "disable"]))
def test_random_robots_touch_themselves_as_in_mujoco(robot: TinyRobot, filters: str) -> None:
    robot = with_balls(robot)
    if filters:
        flag = MjcfOnly("option", f'<option><flag filterparent="{filters}"/></option>')
        robot = replace(robot, control=replace(robot.control, mjcf_only=(flag,)))
    with tempfile.TemporaryDirectory() as folder:
        expected = passes_in_mujoco(robot, Path(folder))
    assert set(passing_pairs(robot.tree, robot.shapes, robot.control)) == expected


@pytest.mark.parametrize(("base", "passes"), [("floating", True), ("fixed", False)])
def test_a_hip_touches_a_trunk_that_is_bolted_to_the_world(base: str, passes: bool) -> None:
    robot = tiny_quadruped()
    tree = replace(robot.tree, base=base)
    assert ContactFilter.of(tree, robot.shapes, robot.control).passes("FL_hip", "trunk") is passes
