"""The lines that load a bundle, to copy: MuJoCo, mjlab, Isaac Lab, ROS."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator


def loading_lines(robot: str, targets: Collection[str]) -> Iterator[tuple[str, str]]:
    """(consumer, lines) for what the bundle holds; paths as seen from where the build ran."""
    bundle = f"build/{robot}"
    module = re.sub(r"\W", "_", robot)
    module = f"_{module}" if module[:1].isdigit() else module
    if "mjcf" in targets:
        yield (
            "MuJoCo",
            f'import mujoco\n\nmodel = mujoco.MjModel.from_xml_path("{bundle}/mjcf/scene.xml")',
        )
    path = f'import sys\n\nsys.path.insert(0, "{bundle}/python")\n'
    if "mjlab" in targets:
        yield "mjlab", f"{path}from {module}_mjlab import robot_cfg"
    if "isaaclab" in targets:
        upper = module.upper()
        yield (
            "Isaac Lab",
            f"{path}from {module}_isaaclab_2 import {upper}_CFG  # Isaac Lab 3: _isaaclab_3\n\n"
            f'robot = {upper}_CFG.replace(prim_path="{{ENV_REGEX_NS}}/Robot")',
        )
    elif "usd" in targets:
        yield (
            "Isaac Lab",
            "import isaaclab.sim as sim_utils\n\n"
            f'spawn = sim_utils.UsdFileCfg(usd_path="{bundle}/usd/{robot}.usda")',
        )
    if "urdf" in targets:
        yield (
            "ROS 2",
            f"ros2 run robot_state_publisher robot_state_publisher {bundle}/urdf/{robot}.urdf",
        )
