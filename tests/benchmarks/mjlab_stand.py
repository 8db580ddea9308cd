"""Built robots in mjlab itself: 8 environments stand 50 steps of zero action.

    PYTHON tests/benchmarks/mjlab_stand.py BUNDLE [ENVIRONMENTS [STEPS]]

PYTHON: of an environment with mjlab 1.6; nothing of assetbuild is imported. What a user writes is
the import of the generated module and `ManagerBasedRlEnv`: the rest is what the module exports.
Prints the root's height after the first step and at the end, what moved between, and who fell.
"""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path


def main(bundle: str, environments: str = "8", steps: str = "50") -> None:
    """Runs on the processor."""
    os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")
    (module,) = Path(bundle).resolve().glob("python/*_mjlab.py")
    sys.path.insert(0, str(module.parent))
    robot = importlib.import_module(module.stem)

    import torch
    from mjlab.envs import ManagerBasedRlEnv

    env = ManagerBasedRlEnv(cfg=robot.velocity_flat_cfg(int(environments)), device="cpu")
    env.reset()
    action = torch.zeros(int(environments), env.action_manager.total_action_dim)
    data, fell = env.scene["robot"].data, torch.zeros(int(environments), dtype=torch.bool)
    heights = []
    for _ in range(int(steps)):
        _, reward, terminated, _, _ = env.step(action)
        fell |= terminated
        heights.append(data.root_link_pos_w[:, 2].clone())
    end = heights[-1]
    home = float(data.default_root_state[0, 2])
    finite = bool(torch.isfinite(reward).all() and torch.isfinite(end).all())
    print(  # its answer
        f"{module.stem}: home {home:.3f} m, first step {heights[0].mean():.3f} m, "
        f"end {end.mean():.3f} m (min {end.min():.3f}, max {end.max():.3f}), "
        f"fell {int(fell.sum())} of {environments}, finite {finite}"
    )
    joints = (data.joint_pos - data.default_joint_pos).abs().max()
    print(f"largest joint error {float(joints):.3f} rad")


if __name__ == "__main__":
    main(*sys.argv[1:])
