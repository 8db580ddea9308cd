"""Sensors, cameras, poses and options of a compiled MuJoCo model, as facts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from assetbuild.facts.mjcf_fields import Bodies, numbers
from assetbuild.facts.mjcf_meshes import pose_of
from assetbuild.facts.table import Value, Writer
from assetbuild.simulators.mujoco import Model, name_of
from assetbuild.simulators.mujoco.drives import Drive

BALL = 1
JOINTS = {0: "floating", BALL: "ball", 2: "linear", 3: "rotary"}
OBJECTS = {
    "mjOBJ_XBODY": "frame", "mjOBJ_SITE": "frame", "mjOBJ_BODY": "body", "mjOBJ_GEOM": "shape",
    "mjOBJ_JOINT": "joint", "mjOBJ_ACTUATOR": "actuator", "mjOBJ_CAMERA": "camera",
    "mjOBJ_TENDON": "tendon",
}  # fmt: skip
"""MuJoCo's kind of object -> the vocabulary's; an XBODY is the frame of a body."""


def read_senses(bodies: Bodies, book: Writer) -> None:
    """Sensors and cameras."""
    import mujoco

    model = bodies.model
    for sensor in range(model.nsensor):
        kind = mujoco.mjtSensor(int(model.sensor_type[sensor])).name.removeprefix("mjSENS_").lower()
        book.put(
            "sensor",
            name_of(model, "sensor", sensor),
            {
                "type": kind.replace("actfrc", "actuatorfrc"),  # MJCF's word
                "object": _object(model, sensor, "obj"),
                "reference": _object(model, sensor, "ref"),
                "cutoff": float(model.sensor_cutoff[sensor]),
                "noise": float(model.sensor_noise[sensor]),
            },
        )
        if kind == "contact":
            asked = numbers(model.sensor_intprm[sensor])
            book.put("sensor", name_of(model, "sensor", sensor), {"mjcf:intprm": asked})
    for camera in range(model.ncam):
        body = int(model.cam_bodyid[camera])
        pose = bodies.placed(body) @ pose_of(model.cam_pos[camera], model.cam_quat[camera])
        mode = mujoco.mjtCamLight(int(model.cam_mode[camera])).name
        book.put(
            "camera",
            name_of(model, "camera", camera),
            {
                "body": bodies.name(body),
                "pose": (*pose.xyz, *pose.quat),
                "field of view": math.radians(float(model.cam_fovy[camera])),
                "resolution": numbers(model.cam_resolution[camera]),
                "tracking": mode.removeprefix("mjCAMLIGHT_").lower(),
            },
        )


def _object(model: Model, sensor: int, side: str) -> str:
    """What a sensor looks at ("obj"), or in whose frame ("ref")."""
    import mujoco

    kind = mujoco.mjtObj(int(getattr(model, f"sensor_{side}type")[sensor]))
    index = int(getattr(model, f"sensor_{side}id")[sensor])
    if index < 0 or kind.name not in OBJECTS:
        return ""
    name = str(mujoco.mj_id2name(model, int(kind), index) or index)
    return "world" if name == "world" else f"{OBJECTS[kind.name]} {name}"


def read_keyframe(
    model: Model, key: int, moving: list[int], drives: Iterable[Drive], book: Writer
) -> None:
    """A pose and its commands. moving: hinges and slides."""
    name, qpos, ctrl = name_of(model, "key", key), model.key_qpos[key], model.key_ctrl[key]
    if model.njnt and int(model.jnt_type[0]) == 0:
        pose = pose_of(qpos[:3], qpos[3:7])
        book.put("keyframe", name, {"base pose": (*pose.xyz, *pose.quat)})
    for joint in moving:
        value = float(qpos[int(model.jnt_qposadr[joint])])
        book.put("keyframe", f"{name}/{name_of(model, 'joint', joint)}", {"position": value})
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) == BALL:
            address = int(model.jnt_qposadr[joint])
            turn = pose_of((0.0, 0.0, 0.0), qpos[address : address + 4]).quat
            subject = f"{name}/{name_of(model, 'joint', joint)}"
            book.put("keyframe", subject, {"mjcf:orientation": turn})
    for drive in drives:
        subject = f"{name}/{drive.joint_name}"
        book.put("keyframe", subject, {"target": float(ctrl[drive.ctrl_index])})


def simulation_facts(option: Any) -> dict[str, Value]:  # Any: MuJoCo's MjOption
    """What a model steps with."""
    import mujoco

    integrator = mujoco.mjtIntegrator(int(option.integrator)).name.removeprefix("mjINT_")
    cone = mujoco.mjtCone(int(option.cone)).name.removeprefix("mjCONE_").lower()
    solver = mujoco.mjtSolver(int(option.solver)).name.removeprefix("mjSOL_")
    words = {"EULER": "Euler", "NEWTON": "Newton", "RK4": "RK4", "CG": "CG", "PGS": "PGS"}
    return {
        "timestep": float(option.timestep),
        "gravity": numbers(option.gravity),
        "integrator": words.get(integrator, integrator.lower()),
        "cone": cone,
        "solver": words.get(solver, solver),
        "iterations": float(option.iterations),
        "line search iterations": float(option.ls_iterations),
        "impratio": float(option.impratio),
    }
