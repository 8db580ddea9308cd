"""A quadruped's bundle and policies for it, as small as they can be."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import yaml
from onnx import TensorProto, helper, numpy_helper
from robot_files import check_inputs, run_step, write_robot_ports
from tiny import TinyRobot, tiny_quadruped

from assetbuild.facts.reference import Assets, Reference
from assetbuild.policy.robot import Bot, bot_of
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.policy import Policy as Contract
from assetbuild.targets.policy import PolicyOptions

BUS = tuple(
    f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")
)
"""Not the order of the robot, whose legs are FR, FL, RR, RL."""
TERMS = ("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "joint_vel_rel",
         "last_action")  # fmt: skip


def bundle_of(folder: Path, robot: TinyRobot | None = None, bus: tuple[str, ...] = BUS) -> Bot:
    """`report/robot.json`, `mjcf/` and `policy/`, as a build writes them."""
    robot = robot or tiny_quadruped()
    inputs = check_inputs(folder / "build", robot, Mjcf(robot="robot"), "mjcf")
    shutil.copytree(inputs / "mjcf", folder / "bundle/mjcf", symlinks=False)
    ports = write_robot_ports(folder / "ports", robot)
    contract = Contract(robot="robot", options=PolicyOptions(bus_order=bus or None))
    run_step(contract, ports, folder / "out")
    shutil.copytree(folder / "out/policy", folder / "bundle/policy")
    (folder / "bundle/report").mkdir()
    # Surfaces are not asked for: no policy looks at meshes.
    solid = [shape for shape in robot.shapes.shapes if shape.role == "collision"]
    shapes = type(robot.shapes)(tuple(solid), robot.shapes.materials)
    reference = Reference(robot.links, robot.tree, shapes, robot.control, Assets(), {})
    (folder / "bundle/report/robot.json").write_text(reference.to_json())
    (folder / "bundle/manifest.json").write_text(json.dumps({"robot": "robot"}))
    return bot_of(folder / "bundle")


def write_network(path: Path, inputs: int, outputs: int, gain: np.ndarray | None = None) -> Path:
    """action = gain @ observation; 0 without a gain."""
    weights = np.zeros((inputs, outputs)) if gain is None else gain
    node = helper.make_node("MatMul", ["obs", "W"], ["actions"])
    graph = helper.make_graph(
        [node],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, inputs])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, outputs])],
        [numpy_helper.from_array(weights.astype(np.float32), "W")],
    )
    save(path, graph)
    return path


def save(path: Path, graph: Any, metadata: Mapping[str, str] | None = None, **imports: Any) -> None:
    """A model of one graph, in a format that every onnxruntime knows."""
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], **imports)
    model.ir_version = 8
    if metadata:
        helper.set_model_props(model, dict(metadata))
    onnx.save(model, str(path))


def deployed(bot: Bot, order: str = "isaaclab") -> dict[str, Any]:
    """A `deploy.yaml` that says of the bundle what it is; to be spoiled."""
    joints = bot.orders[order]
    pose = [bot.position[name] for name in joints]
    count = len(joints)
    widths = dict.fromkeys(("joint_pos_rel", "joint_vel_rel", "last_action"), count)
    return {
        "joint_ids_map": [bot.orders["bus"].index(name) for name in joints],
        "step_dt": bot.step_s,
        "stiffness": [bot.kp[name] for name in bot.orders["bus"]],
        "damping": [bot.kd[name] for name in bot.orders["bus"]],
        "default_joint_pos": pose,
        "actions": {
            "JointPositionAction": {
                "clip": None, "joint_names": [".*"], "scale": [0.25] * count, "offset": list(pose),
                "joint_ids": None,
            }
        },
        "observations": {
            name: {
                "params": {}, "clip": None, "scale": [1.0] * widths.get(name, 3),
                "history_length": 1,
            }
            for name in TERMS
        },
    }  # fmt: skip


def write_policy(folder: Path, said: Mapping[str, Any], gain: np.ndarray | None = None) -> Path:
    """The folder with `deploy.yaml` and a network of the right size."""
    folder.mkdir(exist_ok=True)
    (folder / "deploy.yaml").write_text(yaml.safe_dump(dict(said), sort_keys=False))
    count = len(said["joint_ids_map"])
    write_network(folder / "policy.onnx", 9 + 3 * count, count, gain)
    return folder
