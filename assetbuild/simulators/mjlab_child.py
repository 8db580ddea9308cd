"""A moment of mjlab: runs in mjlab's environment, where assetbuild is not installed.

It loads the bundle's module, lets the robots stand under zero actions and trains a few iterations.
Plain facts; the check judges them. mjlab's API as of 1.6.
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import Any

KEPT_EVENTS = ("reset_base", "reset_robot_joints", "base_com", "encoder_bias", "foot_friction")
"""Events of mjlab's velocity task that stay; a push could topple any robot and shows nothing."""


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """What mjlab does with the module."""
    import torch
    import warp

    warp.config.quiet = True
    sys.path.insert(0, job["modules"])
    robot = __import__(job["module"])
    gpu = torch.cuda.is_available()
    result: dict[str, Any] = {"gpu": gpu, "walks": hasattr(robot, "velocity_flat_cfg")}
    torch.manual_seed(0)
    env = environment(robot, job["envs_gpu"] if gpu else job["envs"], gpu)
    result |= matter(env, robot)
    result |= stand(env, job["stand_steps"])
    iterations = job["iterations_gpu"] if gpu else job["iterations"]
    return result | train(env, iterations, job["rollout"], gpu)


def environment(robot: Any, envs: int, gpu: bool) -> Any:
    """The robot's own velocity task without pushes, or a task of its joints alone."""
    from mjlab.envs import ManagerBasedRlEnv

    if hasattr(robot, "velocity_flat_cfg"):
        cfg = robot.velocity_flat_cfg(envs)
        events = set(robot.randomize_events()) if hasattr(robot, "randomize_events") else set()
        cfg.events = {k: v for k, v in cfg.events.items() if k in events or k in KEPT_EVENTS}
    else:
        cfg = joints_only(robot, envs)
    return ManagerBasedRlEnv(cfg=cfg, device="cuda:0" if gpu else "cpu")


def joints_only(robot: Any, envs: int) -> Any:
    """Hold the initial pose: for arms, hands and robots whose feet nobody named."""
    from mjlab.tasks.velocity.velocity_env_cfg import make_velocity_env_cfg

    cfg = make_velocity_env_cfg()
    cfg.scene.num_envs = envs
    cfg.scene.entities = {"robot": robot.robot_cfg()}
    cfg.scene.terrain.terrain_type = "plane"
    cfg.scene.terrain.terrain_generator = None
    cfg.scene.sensors = ()
    cfg.decimation = robot.DECIMATION
    cfg.sim.mujoco.timestep = robot.TIMESTEP
    cfg.sim.mujoco.gravity = robot.GRAVITY
    cfg.sim.njmax, cfg.sim.nconmax = 600, None
    cfg.viewer.body_name = robot.ROOT_BODY
    cfg.actions["joint_pos"].scale = robot.ACTION_SCALE
    cfg.commands, cfg.curriculum = {}, {}
    cfg.events = {"reset_robot_joints": cfg.events["reset_robot_joints"]}
    if hasattr(robot, "randomize_events"):
        cfg.events |= robot.randomize_events()
    cfg.terminations = {"time_out": cfg.terminations["time_out"]}
    cfg.rewards = {k: cfg.rewards[k] for k in ("dof_pos_limits", "action_rate_l2")}
    for group in cfg.observations.values():
        group.terms = {k: group.terms[k] for k in ("joint_pos", "joint_vel", "actions")}
    return cfg


def matter(env: Any, robot: Any) -> dict[str, Any]:
    """What the events made of mass and inertia, over all environments."""
    import torch

    if not hasattr(robot, "randomize_events"):
        return {}
    model = env.sim.model
    nominal = torch.tensor(env.sim.mj_model.body_mass, device=env.device)[1:]
    mass, moments = model.body_mass[:, 1:], model.body_inertia[:, 1:]
    massive = nominal > 0
    ratio = (mass / nominal)[:, massive]
    longest = moments.max(dim=-1).values
    broken = (2 * longest > moments.sum(dim=-1) * (1 + 1e-5)) | (mass <= 0)
    return {
        "mass_ratio": [float(ratio.min()), float(ratio.max())],
        "inconsistent": int(broken[:, massive].sum()),
        "drawn": int(broken[:, massive].numel()),
    }


def stand(env: Any, steps: int) -> dict[str, Any]:
    """Zero actions: is anything not finite, who falls, how high, how much effort?"""
    import torch

    env.reset()
    entity = env.scene["robot"]
    action = torch.zeros((env.num_envs, env.action_manager.total_action_dim), device=env.device)
    start = float(entity.data.root_link_pos_w[:, 2].mean())
    fell = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
    finite, most = True, 0.0
    heights = entity.data.root_link_pos_w[:, 2].clone()
    for _ in range(steps):
        seen, reward, ended, _, _ = env.step(action)
        fell |= ended.bool()
        heights = torch.where(fell, heights, entity.data.root_link_pos_w[:, 2])
        finite &= all(bool(torch.isfinite(v).all()) for v in (*seen.values(), reward))
        finite &= bool(torch.isfinite(entity.data.joint_pos).all())
        most = max(most, share_of_effort(entity))
    return {
        "finite": finite,
        "fell": int(fell.sum()),
        "envs": env.num_envs,
        "start_m": start,
        "height_m": float(heights.median()),
        "effort_share": most,
    }


def share_of_effort(entity: Any) -> float:
    """The largest force of a drive over its limit; drives without a limit count as 0."""
    force, shares = entity.data.actuator_force.abs(), [0.0]
    for drive in entity.actuators:
        limit = drive.cfg.effort_limit
        if limit:
            shares.append(float(force[:, drive.ctrl_ids].max()) / limit)
    return max(shares)


def train(env: Any, iterations: int, rollout: int, gpu: bool) -> dict[str, Any]:
    """PPO as mjlab sets it up for its own Go1: do the weights move and stay finite?"""
    import torch
    from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
    from mjlab.tasks.velocity.config.go1.rl_cfg import unitree_go1_ppo_runner_cfg

    rl = unitree_go1_ppo_runner_cfg()
    rl.logger, rl.num_steps_per_env = "tensorboard", 24 if gpu else rollout
    if not gpu:
        rl.algorithm.num_learning_epochs = 1
    wrapped = RslRlVecEnvWrapper(env, clip_actions=rl.clip_actions)
    runner = MjlabOnPolicyRunner(wrapped, asdict(rl), None, env.device)
    actor = runner.alg.actor if hasattr(runner.alg, "actor") else runner.alg.policy
    before = [p.detach().clone() for p in actor.parameters()]
    runner.learn(num_learning_iterations=iterations, init_at_random_ep_len=True)
    after = [p.detach() for p in actor.parameters()]
    moved = max(float((a - b).abs().max()) for a, b in zip(after, before, strict=True))
    return {
        "iterations": iterations,
        "weights_finite": all(bool(torch.isfinite(p).all()) for p in after),
        "weights_moved": moved,
    }
