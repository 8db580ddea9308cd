"""A policy's robot in MuJoCo: the scene of the bundle, driven with the policy's own gains."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from assetbuild.errors import UsageError
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy
from assetbuild.policy.terms import Seen
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import mj
from assetbuild.simulators.mujoco.drives import drive_as, read_drives

AT_LIMIT = 0.99
REACH_M = 10.0
"""So far the floor may lie below a sole at the start."""


class InMujoco:
    """`mjcf/scene.xml` or `scene_mjx.xml`: a `replay.World`. UsageError where it is missing."""

    def __init__(self, bot: Bot, policy: Policy, scene: str = "scene.xml") -> None:
        path = bot.bundle / "mjcf" / scene
        if not path.is_file():
            raise UsageError(f"no `{path}`", hint="build the target `mjcf`")
        self.model = mujoco.load(path, visuals=False).model
        drive_as(self.model, bot.servos(policy))
        self.model.actuator_ctrllimited[:] = 0  # trainers do not clip what a policy asks for
        self.joints = mujoco.joints(self.model)
        self.drives = [d for d in read_drives(self.model) if d.holds_position]
        self.data = mujoco.at_key(self.model)
        self._stand(policy.position)

    def _stand(self, position: Mapping[str, float]) -> None:
        """The policy's pose, its soles on the floor."""
        model, data = self.model, self.data
        for name, value in position.items():
            if name in self.joints:
                data.qpos[model.jnt_qposadr[self.joints[name]]] = value
        mj.mj_forward(model, data)
        floors = mujoco.floors(model)
        if mujoco.floats(model) and floors:
            gaps = [
                mj.mj_geomDistance(model, data, geom, floors[0], REACH_M, None)
                for geom in mujoco.collision_geoms(model)
            ]
            data.qpos[2] -= min(gaps, default=0.0)
        data.qvel[:] = 0.0
        self.drive(position, 0.0)
        mj.mj_forward(model, data)

    def seen(self) -> Seen:
        """The state, with velocities in the base as `Seen` has them."""
        model, data = self.model, self.data
        floats = mujoco.floats(model)
        linear = data.xmat[1].reshape(3, 3).T @ data.qvel[:3] if floats else np.zeros(3)
        return Seen(
            time=float(data.time),
            place=np.array(data.xpos[1]),
            quat=np.array(data.xquat[1]),
            linear=np.asarray(linear),
            angular=np.array(data.qvel[3:6]) if floats else np.zeros(3),
            q={n: float(data.qpos[model.jnt_qposadr[j]]) for n, j in self.joints.items()},
            v={n: float(data.qvel[model.jnt_dofadr[j]]) for n, j in self.joints.items()},
        )

    def drive(self, targets: Mapping[str, float], seconds: float) -> None:
        """Hold targets, rad or m by joint, for a while, in whole steps of the model."""
        model, data = self.model, self.data
        for drive in self.drives:
            if drive.joint_name in targets:
                data.ctrl[drive.ctrl_index] = drive.command(targets[drive.joint_name])
        with mujoco.caught_warnings():
            for _ in range(round(seconds / model.opt.timestep)):
                mj.mj_step(model, data)
        mj.mj_kinematics(model, data)

    def strain(self) -> tuple[float, float]:
        """(share of the drives at their limit, mean speed of the feet on the floor in m/s)."""
        model, data = self.model, self.data
        most = np.abs(model.actuator_forcerange).max(axis=1)
        limited = (model.actuator_forcelimited != 0) & (most > 0.0)
        share = np.abs(data.actuator_force[limited]) >= AT_LIMIT * most[limited]
        speeds = []
        for contact, geom in mujoco.floor_contacts(model, data):
            motion, body = np.zeros(6), int(model.geom_bodyid[geom])
            mj.mj_objectVelocity(model, data, mj.mjtObj.mjOBJ_XBODY, body, motion, 0)
            (x, y, z), (wx, wy, wz) = data.contact.pos[contact] - data.xpos[body], motion[:3]
            speeds.append(math.hypot(motion[3] + wy * z - wz * y, motion[4] + wz * x - wx * z))
        return float(share.mean()) if limited.any() else 0.0, float(np.mean(speeds or [0.0]))
