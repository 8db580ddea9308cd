"""What the module for mjlab must say besides numbers: statement by statement, and why.

Names are mjlab 1.6's; see docs/how-to/mjlab.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from assetbuild.facts.table import Writer

FORM = "mjlab"
MODELS = {
    "BuiltinPositionActuatorCfg": "pd",
    "IdealPdActuatorCfg": "ideal_pd",
    "DcMotorActuatorCfg": "dc_motor",
    "BuiltinVelocityActuatorCfg": "velocity",
    "BuiltinMotorActuatorCfg": "motor",
}
"""mjlab's actuators -> models of the table."""
READ = (
    "XML", "ROOT_BODY", "IMU_SITE", "FOOT_SITES", "FOOT_GEOMS", "ACTION_SCALE",
    "TIMESTEP, DECIMATION", "GRAVITY", "robot_cfg", "randomize_events", "JOINTS", "KNEES",
    "POSE_SPREAD",
)  # fmt: skip
"""Parts whose values are facts; their order and signatures are words like all others."""
TASK: Mapping[str, Any] = {  # Any: JSON
    "soft_joint_pos_limit_factor": 0.9,
    "num_envs": 4096,
    "cone": "elliptic",
    "impratio": 10.0,
    "njmax": 300,
    "nconmax": None,
    "action": {"effort_share": 0.25, "rad": 0.5, "m": 0.05},
    "foot_scan": {"radius": 0.04, "samples": 4},
    "pose": {
        "knees": "(?i).*(calf|knee).*",
        "standing": (0.05, 0.1),
        "walking": (0.3, 0.6),
        "running": (0.3, 0.6),
    },
}
"""What mjlab's own robots take, where the recipe's `mjlab` says nothing else.

action: share of the error in position that asks for the whole effort, and the most of it, rad or m.
pose: rad of other joints and of knees that cost nothing.
"""

IMPORTS = """
from __future__ import annotations
from pathlib import Path
import mujoco
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
"""
WALKING_IMPORTS = """
from mjlab.envs import ManagerBasedRlEnvCfg
from mjlab.sensor import ContactMatch, ContactSensorCfg, ObjRef, RingPatternCfg
from mjlab.tasks.velocity.velocity_env_cfg import make_velocity_env_cfg
"""
EVENT_IMPORTS = """
from mjlab.managers.scene_entity_config import SceneEntityCfg
from mjlab.managers.event_manager import EventTermCfg
"""
CARRY_IMPORTS = """
import torch
from mjlab.managers.event_manager import RecomputeLevel, requires_model_fields
from mjlab.utils.lab_api.math import matrix_from_quat, quat_from_matrix
"""

ROBOT = """
XML = 0
ROOT_BODY = 0
IMU_SITE = 0
FOOT_SITES = 0
FOOT_GEOMS = 0
ACTION_SCALE = 0
TIMESTEP, DECIMATION = 0, 0
GRAVITY = 0

def spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(XML))

def robot_cfg() -> EntityCfg:
    return 0
"""
"""A 0 stands for what is compared as facts."""

CARRY = """
@requires_model_fields(
    "body_mass", "body_ipos", "body_inertia", "body_iquat", recompute=RecomputeLevel.set_const
)
def carry_payload(env, env_ids, mass_range, box, asset_cfg) -> None:
    model = env.sim.model
    worlds = torch.arange(env.num_envs) if env_ids is None else env_ids.cpu().long()
    (body,) = env.scene[asset_cfg.name].indexing.body_ids[asset_cfg.body_ids].tolist()
    fields = (model.body_mass, model.body_ipos, model.body_inertia, model.body_iquat)
    at = (worlds.to(env.device), body)
    mass, com, moments, quat = (field[at].double().cpu() for field in fields)
    axes = matrix_from_quat(quat)
    second = torch.diag_embed(moments.sum(-1, keepdim=True) / 2 - moments)
    matter = torch.zeros(len(worlds), 4, 4, dtype=torch.double)
    matter[:, :3, :3] = axes @ second @ axes.mT + mass[:, None, None] * _outer(com)
    matter[:, :3, 3] = matter[:, 3, :3] = mass[:, None] * com
    matter[:, 3, 3] = mass
    low, high = mass_range
    drawn = low + (high - low) * torch.rand(len(worlds), dtype=torch.double)
    matter += drawn[:, None, None] * torch.tensor(box, dtype=torch.double)
    mass = matter[:, 3, 3]
    com = matter[:, :3, 3] / mass[:, None]
    spread, axes = torch.linalg.eigh(matter[:, :3, :3] - mass[:, None, None] * _outer(com))
    axes[torch.linalg.det(axes) < 0, :, 2] *= -1.0
    values = (mass, com, spread.sum(-1, keepdim=True) - spread, quat_from_matrix(axes))
    for field, value in zip(fields, values, strict=True):
        field[at] = value.to(env.device, torch.float)

def _outer(vector):
    return vector[:, :, None] * vector[:, None, :]
"""
"""Pseudo-inertias add: the body's J and the box's times its mass; back by the axes of inertia,
turned into a right-handed system."""
EVENTS = """
def randomize_events() -> dict[str, EventTermCfg]:
    return 0
"""

VELOCITY = """
def velocity_flat_cfg(num_envs: int = {num_envs}) -> ManagerBasedRlEnvCfg:
    cfg = make_velocity_env_cfg()
    cfg.scene.num_envs = num_envs
    cfg.scene.entities = {{"robot": robot_cfg()}}
    cfg.scene.terrain.terrain_type = "plane"
    cfg.scene.terrain.terrain_generator = None
    cfg.decimation = DECIMATION
    cfg.sim.mujoco.timestep = TIMESTEP
    cfg.sim.mujoco.gravity = GRAVITY
    cfg.sim.mujoco.cone = {cone!r}
    cfg.sim.mujoco.impratio = {impratio!r}
    cfg.sim.njmax = {njmax!r}
    cfg.sim.nconmax = {nconmax!r}
    cfg.viewer.body_name = ROOT_BODY
    cfg.actions["joint_pos"].scale = ACTION_SCALE
    kept = [sensor for sensor in cfg.scene.sensors if sensor.name != "terrain_scan"]
    for sensor in kept:
        if sensor.name == "foot_height_scan":
            sensor.frame = tuple(ObjRef(type="site", name=s, entity="robot") for s in FOOT_SITES)
            sensor.pattern = RingPatternCfg.single_ring(radius={radius!r}, num_samples={samples!r})
    feet = ContactSensorCfg(
        name="feet_ground_contact",
        primary=ContactMatch({soles}, entity="robot"),
        secondary=ContactMatch(mode="body", pattern="terrain"),
        fields=("found", "force"),
        reduce="netforce",
        num_slots=1,
        track_air_time=True,
    )
    cfg.scene.sensors = (*kept, feet)
    for group in ("actor", "critic"):
        del cfg.observations[group].terms["height_scan"]
    cfg.events["foot_friction"].params["asset_cfg"].geom_names = FOOT_GEOMS
    cfg.events["base_com"].params["asset_cfg"].body_names = (ROOT_BODY,)
{events}
    for name in ("upright", "body_ang_vel"):
        cfg.rewards[name].params["asset_cfg"].body_names = (ROOT_BODY,)
    for name in ("foot_clearance", "foot_slip"):
        cfg.rewards[name].params["asset_cfg"].site_names = FOOT_SITES
    cfg.rewards["pose"].params["asset_cfg"].joint_names = JOINTS
    for name, (others, knees) in POSE_SPREAD.items():
        cfg.rewards["pose"].params[name] = {{
            joint: knees if joint in KNEES else others for joint in JOINTS
        }}
    cfg.terminations.pop("out_of_terrain_bounds", None)
    cfg.curriculum.pop("terrain_levels", None)
    return cfg

JOINTS = 0
KNEES = 0
POSE_SPREAD = 0
"""
"""Each line fills a place that mjlab's velocity task leaves for a robot, or takes out what only a
rough terrain has."""

TASK_FACTS = {"cfg.sim.mujoco.cone": "cone", "cfg.sim.mujoco.impratio": "impratio"}
"""Options that the velocity task sets -> facts of the simulation."""


def with_task_facts(book: Writer) -> Writer:
    """Statements that set an option of the solver are facts of the vocabulary, and no words."""
    for key, value in list(book.facts.items()):
        option = TASK_FACTS.get(key.name.rpartition(": ")[2])
        if key.kind == "code" and option and key.quantity == f"{FORM}:statement":
            del book.facts[key]
            fact = value.strip("'") if isinstance(value, str) else value
            book.put("simulation", "", {option: fact})
    return book
