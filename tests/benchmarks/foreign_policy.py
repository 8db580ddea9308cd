"""A policy that others trained on PhysX, on a built G1 in MuJoCo: how far does it walk in 10 s?

python -m tests.benchmarks.foreign_policy FOLDER BUNDLE     (needs onnxruntime)

FOLDER holds `policy.onnx` and `deploy.yaml` of unitree_rl_lab, whose gains, order, pose and scales
are taken.
"""

from __future__ import annotations

import re
import sys
from collections import deque
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

SECONDS, FALLEN_M = 10.0, 0.4
COMMANDS = ((0.5, 0, 0), (1, 0, 0), (0, 0.3, 0), (0, 0, 0))


def deployed(folder: Path) -> dict[str, Any]:
    """`deploy.yaml` without its tags of Python objects."""
    text = (folder / "deploy.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(re.sub(r"!!python/\S+ \[.*?\]", "null", text))


def walked(scene: Path, folder: Path, command: tuple[float, float, float]) -> tuple[float, ...]:
    """(x, y) m from the start, height of the base, seconds until it fell or the end."""
    import onnxruntime

    said, model = deployed(folder), mujoco.MjModel.from_xml_path(str(scene))
    session = onnxruntime.InferenceSession(str(folder / "policy.onnx"))
    driven = [model.joint(model.actuator_trnid[i, 0]).name for i in range(model.nu)]
    motors = [j for j in (model.joint(i).name for i in range(model.njnt)) if j in driven]
    joints = [model.joint(motors[i]) for i in said["joint_ids_map"]]
    actuators = [driven.index(joint.name) for joint in joints]
    for i, motor in enumerate(motors):
        at = driven.index(motor)
        model.actuator_gainprm[at, 0] = said["stiffness"][i]
        model.actuator_biasprm[at, 1:3] = -said["stiffness"][i], -said["damping"][i]
    model.actuator_ctrllimited[:] = 0
    q, v = ([getattr(joint, a)[0] for joint in joints] for a in ("qposadr", "dofadr"))
    pose = np.array(said["default_joint_pos"])
    scale = np.array(said["actions"]["JointPositionAction"]["scale"])
    data, action, seen = mujoco.MjData(model), np.zeros(len(joints)), {}
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[q] = pose
    start = data.qpos[:2].copy()
    while data.time < SECONDS and data.qpos[2] > FALLEN_M:
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, data.qpos[3:7])
        terms = (
            0.2 * data.qvel[3:6], rotation.reshape(3, 3).T @ (0, 0, -1), np.array(command),
            data.qpos[q] - pose, 0.05 * data.qvel[v], action,
        )  # fmt: skip
        for i, term in enumerate(terms):
            seen.setdefault(i, deque([term] * 5, 5)).append(np.array(term))
        words = np.concatenate([np.concatenate(seen[i]) for i in range(len(terms))])
        inputs = {session.get_inputs()[0].name: words.astype(np.float32)[None]}
        action = session.run(None, inputs)[0][0].astype(float)
        data.ctrl[actuators] = pose + scale * action
        for _ in range(round(said["step_dt"] / model.opt.timestep)):
            mujoco.mj_step(model, data)
    return (*(data.qpos[:2] - start), data.qpos[2], data.time)


def main() -> None:
    """One line for each command and scene."""
    folder, bundle = map(Path, sys.argv[1:])
    for name in ("scene.xml", "scene_mjx.xml"):
        for command in COMMANDS if (bundle / "mjcf" / name).is_file() else ():
            x, y, height, seconds = walked(bundle / "mjcf" / name, folder, command)
            print(f"{name} {command}: {x:.2f} m, {y:.2f} m; {height:.2f} m high at {seconds:.2f} s")


if __name__ == "__main__":
    main()
