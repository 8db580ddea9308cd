"""A moment of Isaac Lab: runs in an installation of the user's, where assetbuild is not installed.

`python _isaaclab_child.py job.json`: spawns the module's articulation, holds its initial pose and
writes what became of it. Written from Isaac Lab's documentation for 2.3 and 3.0; the authors of
assetbuild have no machine that runs it.
"""

from __future__ import annotations

import json
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any


def main(path: Path) -> None:
    """Run the job; an exception is the answer of a robot that Isaac Lab does not take."""
    job = json.loads(path.read_text(encoding="utf-8"))
    from isaaclab.app import AppLauncher

    app = AppLauncher(headless=True).app
    generation = 3 if find_spec("isaaclab_physx") else 2  # versions of 2.x count from 0.4
    sys.path.insert(0, job["modules"])
    module = __import__(f"{job['stem']}_{generation}")
    answer = held(module, job["steps"]) | {"generation": generation}
    path.with_name("answer.json").write_text(json.dumps(answer), encoding="utf-8")
    app.close()


def held(module: Any, steps: int) -> dict[str, Any]:
    """The robot on a floor under the targets of its initial pose."""
    import isaaclab.sim as sim_utils
    import torch
    from isaaclab.assets import Articulation

    simulation = sim_utils.SimulationContext(module.SIMULATION_CFG)
    floor = sim_utils.GroundPlaneCfg()
    floor.func("/World/floor", floor)
    (name,) = (name for name in vars(module) if name.endswith("_CFG") and name != "SIMULATION_CFG")
    robot = Articulation(getattr(module, name).replace(prim_path="/World/robot"))
    simulation.reset()
    start = float(as_torch(robot.data.default_root_state)[0, 2])
    target = as_torch(robot.data.default_joint_pos).clone()
    for _ in range(steps):
        robot.set_joint_position_target(target)
        robot.write_data_to_sim()
        simulation.step()
        robot.update(module.DT)
    position, joints = as_torch(robot.data.root_pos_w), as_torch(robot.data.joint_pos)
    finite = bool(torch.isfinite(position).all() and torch.isfinite(joints).all())
    return {
        "finite": finite,
        "start_m": start,
        "height_m": float(position[0, 2]) if finite else 0.0,
        "joints": list(robot.joint_names),
    }


def as_torch(value: Any) -> Any:
    """3.0 wraps its arrays; 2.3 has tensors."""
    return getattr(value, "torch", value)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
