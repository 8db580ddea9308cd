"""`<robot>_mjlab.py`: the text of the module that a task imports."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from pydantic import Field

from assetbuild.recipe_types import Model, Pattern, Positive
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.robot.ranges import Randomize, RandomJoint, first_match
from assetbuild.robot.sections import Action
from assetbuild.simulators.mujoco import body_names
from assetbuild.targets.mjlab.events import (
    DriveGroup,
    block,
    carries,
    events_text,
    exactly,
    imports,
    literal,
    replaced,
    terms,
)

Spread = tuple[Positive, Positive]


class FootScan(Model):
    """The rays that measure how high a foot is above the ground."""

    radius: Positive = Field(0.04, description="m; of the ring of rays around a foot's site")
    samples: int = Field(4, ge=1, description="rays on the ring")


class PoseReward(Model):
    """How far joints may leave the initial pose before the reward `pose` drops."""

    knees: Pattern = Field(
        "(?i).*(calf|knee).*", description="joints that swing most while walking"
    )
    standing: Spread = Field(
        (0.05, 0.1), description="rad; standard deviation of other joints and of knees at rest"
    )
    walking: Spread = Field((0.3, 0.6), description="rad; as above, at walking speed")
    running: Spread = Field((0.3, 0.6), description="rad; as above, at running speed")


class MjlabOptions(Model):
    """What only mjlab's configuration has; the task options are those of its velocity task."""

    soft_joint_pos_limit_factor: float = Field(
        0.9, gt=0.0, le=1.0, description="share of a joint's range beyond which rewards punish"
    )
    num_envs: int = Field(4096, ge=1, description="robots that the task simulates side by side")
    cone: Literal["elliptic", "pyramidal"] = Field("elliptic", description="friction cone")
    impratio: Positive = Field(
        10.0, description="impedance of friction relative to that of the normal force"
    )
    njmax: int | None = Field(
        300, ge=1, description="room for constraints of one robot; null = mjlab's choice"
    )
    nconmax: int | None = Field(
        None, ge=1, description="room for contacts of one robot; null = MuJoCo Warp's choice"
    )
    action: Action = Action()
    foot_scan: FootScan = FootScan()
    pose: PoseReward = PoseReward()


CLASSES: Mapping[str, str] = {
    "pd": "BuiltinPositionActuatorCfg",
    "ideal_pd": "IdealPdActuatorCfg",
    "dc_motor": "DcMotorActuatorCfg",
    "velocity": "BuiltinVelocityActuatorCfg",
    "motor": "BuiltinMotorActuatorCfg",
}
"""mjlab's actuator for a model of the table; it has none for the others."""
UNLIMITED = 1e9
"""N m or N: `BuiltinMotorActuatorCfg` needs a number where the table says `unlimited`."""


@dataclass(frozen=True)
class Foot:
    """A body that stands on the ground. site, geoms: names in the bare MJCF."""

    body: str
    site: str
    geoms: tuple[str, ...]


@dataclass(frozen=True)
class ModuleFacts:
    """What the module says. feet: in the order of the bodies in the MJCF; imu_site: a name there.

    mjlab takes sensors in the model's order and the rays of the feet in the module's.
    """

    robot: str
    tree: Tree
    control: Control
    rows: tuple[str, ...]
    feet: tuple[Foot, ...]
    imu_site: str
    options: MjlabOptions
    randomize: Randomize | None = None

    @property
    def walks(self) -> bool:
        """Whether there is enough for mjlab's velocity task."""
        return self.tree.base == "floating" and bool(self.feet) and bool(self.groups)

    @cached_property
    def groups(self) -> tuple[DriveGroup, ...]:
        """Drives with equal numbers and ranges, in the module's order."""
        table = self.randomize.joints if self.randomize else {}
        joints_by_drive: dict[tuple[Actuator, RandomJoint | None], list[str]] = {}
        for actuator in self.control.actuators:
            if actuator.model in CLASSES:
                numbers = replace(actuator, joint="", name="", source="")
                ranges = first_match(table, actuator.joint)
                joints_by_drive.setdefault((numbers, ranges), []).append(actuator.joint)
        return tuple(
            DriveGroup(self._patterns(joints), numbers, tuple(joints), ranges)
            for (numbers, ranges), joints in joints_by_drive.items()
        )

    def _patterns(self, joints: list[str]) -> tuple[str, ...]:
        """The pattern of the last row that matches just these, else one for each."""
        moving = [joint.name for joint in self.tree.moving_joints]
        for pattern in reversed(self.rows):
            if {name for name in moving if re.fullmatch(pattern, name)} == set(joints):
                return (pattern,)
        return tuple(map(re.escape, joints))

    @cached_property
    def events(self) -> str:
        """The recipe's `randomize` in mjlab's terms; "" without any."""
        return terms(self.randomize, self.tree, self.groups) if self.randomize else ""


def module_text(facts: ModuleFacts) -> str:
    """Python, four spaces; the same bytes for the same facts."""
    parts = [_head(facts), _facts(facts), _robot(facts)]
    if facts.events:
        parts.append(events_text(facts.events))
    if facts.walks:
        parts += [_velocity(facts), _pose(facts)]
    return "\n\n\n".join(part.strip("\n") for part in parts) + "\n"


def _head(facts: ModuleFacts) -> str:
    lines = ["from mjlab.entity import EntityArticulationInfoCfg, EntityCfg"]
    if facts.groups:
        classes = sorted({CLASSES[group.actuator.model] for group in facts.groups})
        lines.append(f"from mjlab.actuator import {', '.join(classes)}")
    if facts.walks:
        lines += [
            "from mjlab.envs import ManagerBasedRlEnvCfg",
            "from mjlab.sensor import ContactMatch, ContactSensorCfg, ObjRef, RingPatternCfg",
            "from mjlab.tasks.velocity.velocity_env_cfg import make_velocity_env_cfg",
        ]
    if facts.events:
        lines += imports(facts.events)
    torch = ["import torch"] if carries(facts.events) else []
    return f'''"""{facts.robot} for mjlab 1.6.

Generated by assetbuild: change the recipe, not this file.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
''' + "\n".join([*torch, *sorted(lines)])


def _facts(facts: ModuleFacts) -> str:
    scale = {
        name: _scale(facts, group)
        for group in facts.groups
        for name in group.names
        if group.actuator.kp and group.actuator.effort
    }
    simulation, action = facts.control.simulation, facts.options.action
    some, written = action.effort_share, body_names(facts.tree)
    share = "A quarter" if some == 0.25 else f"A share of {some!r}"
    least = min(action.min_rad, action.rad)
    return f'''
XML = Path(__file__).parent.parent / "mjcf" / "{facts.robot}_bare.xml"
ROOT_BODY = {literal(written[facts.tree.root])}
IMU_SITE = {literal(written.get(facts.imu_site, facts.imu_site))}
FOOT_SITES = {block("", (literal(foot.site) for foot in facts.feet))}
FOOT_GEOMS = {block("", (literal(geom) for foot in facts.feet for geom in foot.geoms))}
ACTION_SCALE = {block("", (f"{literal(name)}: {each!r}" for name, each in scale.items()), 0, "{}")}
"""{share} of the error that asks for the whole effort, {least!r} to {action.rad!r} rad
or at most {action.m!r} m, by joint; rad or m per unit of action."""
TIMESTEP, DECIMATION = {simulation.timestep!r}, {simulation.decimation}
GRAVITY = {simulation.gravity!r}'''


def _scale(facts: ModuleFacts, group: DriveGroup) -> float:
    slides = all(facts.tree.by_joint[joint].kind == "prismatic" for joint in group.joints)
    return facts.options.action.scale(group.actuator.effort, group.actuator.kp, slides=slides)


def _robot(facts: ModuleFacts) -> str:
    actuators = block("", map(_actuator, facts.groups), 12)
    start = initial_pose(facts.tree, facts.control)
    base = facts.tree.root_pose(start)  # of a fixed root too: mjlab puts it here
    joints = dict(start.joints)
    # A regex of mjlab may not match nothing, so a robot without joints has no map of them.
    positions = '{".*": 0.0}'
    if joints:
        items = (f"{exactly(name)}: {value!r}" for name, value in joints.items())
        positions = block("", items, 12, "{}")
    return f'''
def spec() -> mujoco.MjSpec:
    """The bare model; mjlab adds drives, options and the initial state."""
    return mujoco.MjSpec.from_file(str(XML))


def robot_cfg() -> EntityCfg:
    """A fresh configuration each time: mjlab changes what it is given."""
    return EntityCfg(
        spec_fn=spec,
        init_state=EntityCfg.InitialStateCfg(
            pos={base.xyz!r},
            rot={base.quat!r},
            joint_pos={positions},
            joint_vel={{".*": 0.0}},
        ),
        articulation=EntityArticulationInfoCfg(
            actuators={actuators},
            soft_joint_pos_limit_factor={facts.options.soft_joint_pos_limit_factor!r},
        ),
    )'''


def _actuator(group: DriveGroup) -> str:
    a = group.actuator
    fields: dict[str, object] = {}
    match a.model:
        case "pd" | "ideal_pd" | "dc_motor":
            fields |= {"stiffness": a.kp, "damping": a.kd}
        case "velocity":
            fields |= {"damping": a.kd}
    if a.effort is not None or a.model == "motor":
        fields["effort_limit"] = UNLIMITED if a.effort is None else a.effort
    if a.model == "dc_motor":
        fields |= {"saturation_effort": a.saturation, "velocity_limit": a.velocity}
    fields |= {"armature": a.armature, "frictionloss": a.friction, "viscous_damping": a.damping}
    if group.ranges is not None and group.ranges.delay != (0, 0):
        fields |= dict(zip(("delay_min_lag", "delay_max_lag"), group.ranges.delay, strict=True))
    names = block("target_names_expr=", map(literal, group.names), 20)
    keywords = (f"{name}={value!r}" for name, value in fields.items())
    return block(CLASSES[a.model], (names, *keywords), 16)


def _velocity(facts: ModuleFacts) -> str:
    gone = replaced(facts.randomize, facts.tree) if facts.randomize else ()
    randomized = "".join(f'\n    cfg.events.pop("{name}", None)' for name in gone)
    if facts.events:
        randomized += "\n    cfg.events |= randomize_events()"
    options, scan = facts.options, facts.options.foot_scan
    ring = f"single_ring(radius={scan.radius!r}, num_samples={scan.samples})"
    return f'''
def velocity_flat_cfg(num_envs: int = {options.num_envs}) -> ManagerBasedRlEnvCfg:
    """mjlab's velocity task on a plane, with this robot and the recipe's simulation."""
    cfg = make_velocity_env_cfg()
    cfg.scene.num_envs = num_envs
    cfg.scene.entities = {{"robot": robot_cfg()}}
    cfg.scene.terrain.terrain_type = "plane"
    cfg.scene.terrain.terrain_generator = None
    cfg.decimation = DECIMATION
    cfg.sim.mujoco.timestep = TIMESTEP
    cfg.sim.mujoco.gravity = GRAVITY
    cfg.sim.mujoco.cone = "{options.cone}"
    cfg.sim.mujoco.impratio = {_short(options.impratio)}
    cfg.sim.njmax = {options.njmax!r}
    cfg.sim.nconmax = {options.nconmax!r}
    cfg.viewer.body_name = ROOT_BODY
    cfg.actions["joint_pos"].scale = ACTION_SCALE

    kept = [sensor for sensor in cfg.scene.sensors if sensor.name != "terrain_scan"]
    for sensor in kept:
        if sensor.name == "foot_height_scan":
            sensor.frame = tuple(ObjRef(type="site", name=s, entity="robot") for s in FOOT_SITES)
            sensor.pattern = RingPatternCfg.{ring}
    feet = ContactSensorCfg(
        name="feet_ground_contact",
        primary=ContactMatch({_soles(facts)}, entity="robot"),
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
    cfg.events["base_com"].params["asset_cfg"].body_names = (ROOT_BODY,){randomized}
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
    return cfg'''


def _pose(facts: ModuleFacts) -> str:
    """How far each joint may swing while the robot walks."""
    joints = tuple(joint for group in facts.groups for joint in group.joints)
    reward = facts.options.pose
    knees = tuple(joint for joint in joints if re.fullmatch(reward.knees, joint))
    return f'''
JOINTS = {block("", map(literal, joints))}
KNEES = {block("", map(literal, knees))}
POSE_SPREAD = {{
    "std_standing": {reward.standing!r},
    "std_walking": {reward.walking!r},
    "std_running": {reward.running!r},
}}
"""rad from the initial pose that cost nothing much, of other joints and of knees."""'''


def _short(value: float) -> str:
    """A whole number without a point."""
    return str(int(value)) if value.is_integer() else repr(value)


def _soles(facts: ModuleFacts) -> str:
    """One entry for each foot, as mjlab's rewards count: a foot of several geoms is its body.

    Where that foot was merged into a shank, what the shank touches counts too.
    """
    if all(len(foot.geoms) == 1 for foot in facts.feet):
        return 'mode="geom", pattern=FOOT_GEOMS'
    listed = ", ".join(literal(foot.body) for foot in facts.feet)
    return f'mode="body", pattern=({listed},)'
