"""One Go1 in mjlab's flat velocity task: what PPO earns in each iteration.

    PYTHON tests/benchmarks/mjlab_train.py WHO ENVIRONMENTS ITERATIONS SEED ANSWER.json [THREADS]

PYTHON: of an environment with mjlab 1.6; nothing of assetbuild is imported. WHO: a bundle with a
module for mjlab, or `mjlab` for mjlab's own Go1. Runs on a GPU if torch sees one; else MuJoCo
itself steps the robots, in THREADS (see `mjlab_native`). `mjlab_curves` starts it and draws what it
wrote.
"""

from __future__ import annotations

import importlib
import json
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mjlab_native

ROLLOUT = 24
"""Steps of an iteration, as mjlab trains its own Go1."""


def main(
    who: str, environments: str, iterations: str, seed: str, answer: str, threads: str = "1"
) -> None:
    """Writes per iteration the mean reward of a second and the share of robots that fell."""
    import torch
    from mjlab.envs import ManagerBasedRlEnv
    from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
    from mjlab.tasks.velocity.config.go1.rl_cfg import unitree_go1_ppo_runner_cfg

    cfg = task(who, int(environments))
    cfg.seed = int(seed)
    torch.manual_seed(int(seed))
    device = "cuda:0" if torch.cuda.is_available() else "cpu"
    if device == "cpu":
        torch.set_num_threads(int(threads))
        mjlab_native.install(int(threads))
    rl = unitree_go1_ppo_runner_cfg()
    rl.logger, rl.num_steps_per_env, rl.seed = "tensorboard", ROLLOUT, int(seed)
    env = Earned(ManagerBasedRlEnv(cfg=cfg, device=device))
    wrapped = RslRlVecEnvWrapper(env.env, clip_actions=rl.clip_actions)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as logs:
        runner = MjlabOnPolicyRunner(wrapped, asdict(rl), logs, device)
        runner.learn(num_learning_iterations=int(iterations), init_at_random_ep_len=True)
    Path(answer).write_text(
        json.dumps(
            {
                "device": device,
                "seconds": time.monotonic() - began,
                "reward": env.by_iteration(env.rewards),
                "fell": env.by_iteration(env.falls),
            }
        ),
        encoding="utf-8",
    )


def task(who: str, environments: int) -> Any:
    """The flat velocity task: mjlab's own of its Go1, or the bundle's."""
    if who == "mjlab":
        from mjlab.tasks.velocity.config.go1.env_cfgs import unitree_go1_flat_env_cfg

        cfg = unitree_go1_flat_env_cfg()
        cfg.scene.num_envs = environments
        return cfg
    (module,) = Path(who).resolve().glob("python/*_mjlab.py")
    sys.path.insert(0, str(module.parent))
    return importlib.import_module(module.stem).velocity_flat_cfg(environments)


class Earned:
    """Listens to an environment's steps: reward of a second, share that fell."""

    def __init__(self, env: Any) -> None:
        self.env, self.rewards, self.falls = env, [], []
        self._step = env.step
        env.step = self.step

    def step(self, action: Any) -> Any:
        """The environment's own answer."""
        answer = self._step(action)
        self.rewards.append(float(answer[1].mean()) / self.env.step_dt)
        self.falls.append(float(answer[2].float().mean()))
        return answer

    @staticmethod
    def by_iteration(values: list[float]) -> list[float]:
        """Means of `ROLLOUT` steps each."""
        starts = range(0, len(values) - ROLLOUT + 1, ROLLOUT)
        return [sum(values[i : i + ROLLOUT]) / ROLLOUT for i in starts]


if __name__ == "__main__":
    main(*sys.argv[1:])
