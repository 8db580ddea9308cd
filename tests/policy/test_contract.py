"""The policy's contract: orders as engines count, numbers as the robot has them."""

from __future__ import annotations

import shutil
from pathlib import Path

import networkx as nx
import pytest
import yaml
from hypothesis import given, settings
from policies import BUS, bundle_of
from random_robots import examples, robots
from robot_files import check_inputs, models, run_step, write_robot_ports
from tiny import TinyRobot, tiny_quadruped

from assetbuild.checks._mujoco import PolicyOrders
from assetbuild.errors import StepError
from assetbuild.robot.orders import breadth_first, depth_first
from assetbuild.simulators.usd_names import usd_identifier
from assetbuild.targets.policy import Policy, PolicyOptions

PARTS = ("hip", "thigh", "calf")
ISAAC = [f"{leg}_{part}_joint" for part in PARTS for leg in ("FL", "FR", "RL", "RR")]
"""PhysX counts in this order, although the tree has FR before FL."""


@given(robots(max_bodies=8))
@settings(max_examples=examples(60), deadline=None)
def test_orders_are_those_of_another_library(robot: TinyRobot):
    graph = nx.DiGraph()
    graph.add_node(robot.tree.root)
    names = {}
    for joint in sorted(robot.tree.joints, key=lambda joint: usd_identifier(joint.name)):
        graph.add_edge(joint.parent, joint.child)
        names[joint.child] = joint.name
    moving = {joint.name for joint in robot.tree.moving_joints}
    for walk, order in ((nx.bfs_edges, breadth_first), (nx.dfs_edges, depth_first)):
        edges = [names[child] for _, child in walk(graph, robot.tree.root)]
        assert list(order(robot.tree)) == [name for name in edges if name in moving]


def test_ten_lines_of_numpy_load_it(tmp_path: Path):
    bot = bundle_of(tmp_path)
    said = yaml.safe_load((bot.bundle / "policy/robot_contract.yaml").read_text())
    assert said["orders"]["bus"] == list(BUS) and said["orders"]["isaaclab"] == ISAAC
    row = said["joints"].index("RR_calf_joint")
    assert said["default_position"][row] == pytest.approx(bot.position["RR_calf_joint"])
    assert said["kp"][row] == bot.kp["RR_calf_joint"]
    assert (said["lower"][row], said["upper"][row]) == (-2.8, -0.9)
    assert said["timestep"] * said["decimation"] == pytest.approx(bot.step_s)


def test_a_bus_that_lists_what_is_no_joint_is_refused(tmp_path: Path):
    ports = write_robot_ports(tmp_path / "in", tiny_quadruped())
    for bus, message in (
        (("FL_hip_joit",), "no moving joint `FL_hip_joit`"),
        (("FL_hip_joint",) * 2, "names `FL_hip_joint` twice"),
    ):
        step = Policy(robot="robot", options=PolicyOptions(bus_order=bus))
        with pytest.raises(StepError, match=message):
            run_step(step, ports, tmp_path / "out")
    found = run_step(Policy(robot="robot"), ports, tmp_path / "out")
    assert [finding.rule for finding in found] == ["policy.bus_order"], "it has none"


def test_the_check_asks_mujoco(tmp_path: Path):
    robot = tiny_quadruped()
    inputs = check_inputs(tmp_path, robot, Policy(robot="robot"), "policy")
    shutil.copytree(models(tmp_path / "models", robot) / "mjcf", inputs / "mjcf")
    check = PolicyOrders(robot="robot")
    assert run_step(check, inputs, tmp_path / "first") == []
    path = inputs / "policy/robot_contract.yaml"
    said = yaml.safe_load(path.read_text())
    order = said["orders"]["mujoco"]
    order[0], order[3] = order[3], order[0]
    path.unlink()
    path.write_text(yaml.safe_dump(said, sort_keys=False))
    found = run_step(check, inputs, tmp_path / "second")
    assert [f.rule for f in found] == ["policy.engine_order"]
    assert "`FR_hip_joint` at place 0" in found[0].message
