"""Meshes, pictures, sensors, cameras, poses and options of a compiled MuJoCo model, as facts."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from assetbuild.facts.mjcf_fields import Bodies, numbers, plain
from assetbuild.facts.surface import Surface, measure
from assetbuild.facts.table import Table, Value
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.simulators.mujoco import Model, floats, mj, name_of
from assetbuild.simulators.mujoco.drives import Drive


class Meshes:
    """The meshes of a model in their own frames.

    by_area: see `measure`; float32 may take a triangle its area.
    """

    def __init__(self, model: Model, *, by_area: bool = False) -> None:
        self._model, self._by_area = model, by_area
        self._surfaces: dict[int, Surface] = {}
        self._digests: dict[int, str] = {}

    def of(self, mesh: int) -> Surface:
        """Corners of all triangles, with texture coordinates where it has them."""
        if mesh not in self._surfaces:
            self._surfaces[mesh] = self._measured(mesh)
        return self._surfaces[mesh]

    def pixels(self, texture: int) -> str:
        """Digest of size and RGBA pixels."""
        if texture not in self._digests:
            self._digests[texture] = self._digest(texture)
        return self._digests[texture]

    def _measured(self, mesh: int) -> Surface:
        model = self._model
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = slice(first, first + count)
        vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) :]
        uv, start = None, int(model.mesh_texcoordadr[mesh])
        if start >= 0:
            uv = model.mesh_texcoord[start:][model.mesh_facetexcoord[faces]]
            uv = np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1)  # MuJoCo counts v downwards
        corners = np.asarray(vertices, dtype=np.float64)[model.mesh_face[faces]]
        # The build drops triangles that use one vertex twice: they have no area.
        a, b, c = model.mesh_face[faces].T
        whole = (a != b) & (b != c) & (c != a)
        uv = None if uv is None else uv[whole]
        return measure(corners[whole], uv, by_area=self._by_area)

    def _digest(self, texture: int) -> str:
        model = self._model
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        data = np.asarray(model.tex_data[start : start + height * width * channels])
        picture = data.reshape(height, width, channels).astype(np.uint8)
        if channels == 3:
            opaque = np.full((height, width, 1), 255, dtype=np.uint8)
            picture = np.concatenate([picture, opaque], axis=2)
        held = hashlib.sha256(repr((width, height)).encode() + picture.tobytes())
        return held.hexdigest()[:16]


def pose_of(xyz: object, quat: object) -> Pose:
    """Return the pose that MuJoCo's arrays hold."""
    w, x, y, z = (float(v) for v in np.asarray(quat, dtype=np.float64))
    return Pose(vec3(np.asarray(xyz, dtype=np.float64)), normalised_quat((w, x, y, z)))


BALL = 1
JOINTS = {0: "floating", BALL: "ball", 2: "linear", 3: "rotary"}
OBJECTS = {
    "mjOBJ_XBODY": "frame", "mjOBJ_SITE": "frame", "mjOBJ_BODY": "body", "mjOBJ_GEOM": "shape",
    "mjOBJ_JOINT": "joint", "mjOBJ_ACTUATOR": "actuator", "mjOBJ_CAMERA": "camera",
    "mjOBJ_TENDON": "tendon",
}  # fmt: skip
"""MuJoCo's kind of object -> the vocabulary's; an XBODY is the frame of a body."""


def read_senses(bodies: Bodies, table: Table) -> None:
    """Sensors and cameras."""
    model = bodies.model
    for sensor in range(model.nsensor):
        kind = mj.mjtSensor(int(model.sensor_type[sensor])).name.removeprefix("mjSENS_").lower()
        facts: dict[str, Value] = {
            "type": kind.replace("actfrc", "actuatorfrc"),  # MJCF's word
            "object": _object(model, sensor, "obj"),
            "reference": _object(model, sensor, "ref"),
            "cutoff": float(model.sensor_cutoff[sensor]),
            "noise": float(model.sensor_noise[sensor]),
        }
        if kind == "contact":
            facts["mjcf:intprm"] = numbers(model.sensor_intprm[sensor])
        table.put("sensor", name_of(model, "sensor", sensor), facts)
    for camera in range(model.ncam):
        body = int(model.cam_bodyid[camera])
        pose = bodies.placed(body) @ pose_of(model.cam_pos[camera], model.cam_quat[camera])
        mode = mj.mjtCamLight(int(model.cam_mode[camera])).name
        facts = {
            "body": bodies.name(body),
            "pose": (*pose.xyz, *pose.quat),
            "field of view": math.radians(float(model.cam_fovy[camera])),
            "resolution": numbers(model.cam_resolution[camera]),
            "tracking": mode.removeprefix("mjCAMLIGHT_").lower(),
        }
        table.put("camera", name_of(model, "camera", camera), facts)


def _object(model: Model, sensor: int, side: str) -> str:
    """What a sensor looks at ("obj"), or in whose frame ("ref")."""
    kind = mj.mjtObj(int(getattr(model, f"sensor_{side}type")[sensor]))
    index = int(getattr(model, f"sensor_{side}id")[sensor])
    if index < 0 or kind.name not in OBJECTS:
        return ""
    name = str(mj.mj_id2name(model, int(kind), index) or index)
    return "world" if name == "world" else f"{OBJECTS[kind.name]} {name}"


def read_keyframe(
    model: Model, key: int, moving: list[int], drives: Iterable[Drive], facts: Table
) -> None:
    """A pose and its commands. moving: hinges, slides and balls."""
    name, qpos, ctrl = name_of(model, "key", key), model.key_qpos[key], model.key_ctrl[key]
    if floats(model):
        pose = pose_of(qpos[:3], qpos[3:7])
        facts.put("keyframe", name, {"base pose": (*pose.xyz, *pose.quat)})
    for joint in moving:
        at, subject = int(model.jnt_qposadr[joint]), f"{name}/{name_of(model, 'joint', joint)}"
        if int(model.jnt_type[joint]) == BALL:
            turn = pose_of((0.0, 0.0, 0.0), qpos[at : at + 4]).quat
            facts.put("keyframe", subject, {"mjcf:orientation": turn})
        else:
            facts.put("keyframe", subject, {"position": float(qpos[at])})
    for drive in drives:
        subject = f"{name}/{drive.joint_name}"
        facts.put("keyframe", subject, {"target": float(ctrl[drive.ctrl_index])})


NUMBERS = ("timestep", "gravity", "iterations", "impratio", "tolerance")
"""Quantities of a simulation that MuJoCo calls the same."""
SPELLED = {"EULER": "Euler", "NEWTON": "Newton", "RK4": "RK4", "CG": "CG", "PGS": "PGS"}


def simulation_facts(option: Any) -> dict[str, Value]:  # Any: MuJoCo's MjOption
    """What a model steps with."""
    integrator = mj.mjtIntegrator(int(option.integrator)).name.removeprefix("mjINT_")
    solver = mj.mjtSolver(int(option.solver)).name.removeprefix("mjSOL_")
    return {word: plain(getattr(option, word)) for word in NUMBERS} | {
        "integrator": SPELLED.get(integrator, integrator.lower()),
        "cone": mj.mjtCone(int(option.cone)).name.removeprefix("mjCONE_").lower(),
        "solver": SPELLED.get(solver, solver),
        "line search iterations": float(option.ls_iterations),
    }
