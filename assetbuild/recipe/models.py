"""What a recipe may say. Every key has its meaning and unit in its description.

Patterns are regular expressions that must match a whole name of the *source*, before merging.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from assetbuild.findings import Severity
from assetbuild.quantities import Model as Model
from assetbuild.quantities import Name as Name
from assetbuild.quantities import NonNegative as NonNegative
from assetbuild.quantities import Pattern as Pattern
from assetbuild.quantities import Positive as Positive
from assetbuild.quantities import Real as Real
from assetbuild.recipe.collision import CollisionRule, Preset
from assetbuild.recipe.compose import Part
from assetbuild.recipe.isaaclab import IsaacLab
from assetbuild.recipe.mjcf import Mjcf, Mjx
from assetbuild.recipe.source import PYPI_PATTERN as PYPI_PATTERN
from assetbuild.recipe.source import Sha256 as Sha256
from assetbuild.recipe.source import Source as Source
from assetbuild.recipe.trials import (
    Alignment,
    DriveBounds,
    InertiaBounds,
    Mirror,
    SmokeBounds,
    TotalMass,
    Trials,
)
from assetbuild.recipe.usd import Usd
from assetbuild.robot.actuator_table import (
    ActuatorRow as ActuatorRow,  # the recipe is read from here
)
from assetbuild.robot.actuator_table import Motor as Motor
from assetbuild.robot.contact import Contacts as Contacts
from assetbuild.robot.contact import Exclude as Exclude
from assetbuild.robot.poses import Keyframe as Keyframe
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.sensing import Cameras, Feet, Imu, Sensors
from assetbuild.robot.simulation import Simulation as Simulation


def _no_repeats(values: tuple[str, ...]) -> tuple[str, ...]:
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise ValueError(f"named twice: {', '.join(twice)}")
    return values


def _one_name(entry: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:  # Any: as OneEdit
    if len(entry) != 1:
        raise ValueError("an edit is one name and its keys: `set_mass: {link: .., mass: ..}`")
    return entry


Names = Annotated[tuple[str, ...], AfterValidator(_no_repeats)]
OneEdit = Annotated[dict[str, dict[str, Any]], AfterValidator(_one_name)]  # Any: see plan/edits.py


class FixedJoints(Model):
    """What happens to links that fixed joints hold together."""

    merge: bool = Field(
        True,
        description="merge them exactly; the frames survive. Without this key the bodies of an "
        "MJCF stay as they are",
    )
    keep_bodies: tuple[Pattern, ...] = Field(
        (), description="links that stay bodies of their own, for contact sensors"
    )


class Visual(Model):
    """Meshes for the eye."""

    max_faces: int | None = Field(
        None,
        ge=100,
        le=10_000_000,
        description="goal per mesh; stops earlier, with a finding, to keep the shape",
    )


class Collision(Model):
    """Collision geometry, by source link."""

    preset: Preset = Field(
        "locomotion", description="tolerances of `auto`: coarse and fast, or close to the mesh"
    )
    default: CollisionRule = Field(default_factory=lambda: CollisionRule.model_validate({}))
    links: dict[Pattern, CollisionRule] = Field(
        default_factory=dict, description="the first pattern that matches a link wins"
    )
    exclude: Exclude = Field(default_factory=lambda: Exclude.model_validate({}))


class FreeFall(Model):
    """Dropped without contact and drives."""

    seconds: Positive = Field(0.4, description="s")
    tolerance: Positive = Field(
        0.003, description="relative, against the integrator's formula, warning"
    )
    broken: Positive = Field(0.05, description="the same, error")


class Stand(Model):
    """Held by its drives on a floor."""

    keyframe: str = Field("home", description="the pose to hold")
    seconds: Positive = Field(2.0, description="s")
    max_sag: Positive = Field(0.03, description="m of base height, warning")
    max_tilt: Positive = Field(0.1, description="rad of the base, warning")
    max_drift: Positive = Field(0.02, description="m sideways, warning")
    sole: Positive = Field(
        0.001,
        description="m between a sole and the floor at the start, and of two shapes inside each "
        "other, warning; a gap ten times as large is an error",
    )
    fall: Positive = Field(
        0.5, description="share of the base's height lost, or rad of tilt, that is a fall, error"
    )
    saturated: Positive = Field(
        0.98, description="share of an effort limit that standing may need, warning"
    )
    feet: Pattern | None = Field(
        None, description="source links that may touch the floor; without it `feet.links`"
    )


class Sine(Model):
    """Every joint follows a sine, base held, in MuJoCo and in PhysX."""

    frequency: Positive = Field(1.0, description="Hz")
    seconds: Positive = Field(3.0, description="s; the first third is left out")
    tolerance: Positive = Field(
        0.01, description="of the swing, RMS between the engines without friction, warning"
    )
    tolerance_as_is: Positive = Field(
        0.05, description="the same with contacts, friction and limits, warning"
    )
    broken: Positive = Field(0.2, description="of the swing, either way, error")


class Validate(Model):
    """Which physical checks run, and their limits."""

    free_fall: FreeFall | None = Field(
        default_factory=lambda: FreeFall.model_validate({}), description="null = do not run it"
    )
    stand: Stand | None = Field(None, description="stand still under the drives; {} = defaults")
    sine: Sine | None = Field(
        default_factory=lambda: Sine.model_validate({}),
        description="part of the comparison of two simulators; null = do not run it",
    )
    linters: tuple[Literal["mjcf_doctor", "simcheck"], ...] = Field(
        (), description="other people's linters of the MJCF; they need assetbuild[lint]"
    )
    trials: Trials | None = Field(
        default_factory=lambda: Trials.model_validate({}),
        description="small experiments in MuJoCo: drives, energy, timestep, self-collision, "
        "balance, settling; null = do not run them",
    )
    inertia: InertiaBounds = Field(default_factory=lambda: InertiaBounds.model_validate({}))
    gains: DriveBounds = Field(default_factory=lambda: DriveBounds.model_validate({}))
    mass: TotalMass = Field(default_factory=lambda: TotalMass.model_validate({}))
    mirror: Mirror | None = Field(
        default_factory=lambda: Mirror.model_validate({}),
        description="left against right; null for a robot that is no mirror image of itself",
    )
    max_shift: Positive = Field(
        0.015, description="m: collision geometry beside the visual geometry of its body, warning"
    )
    max_shift_share: Positive = Field(
        0.08, description="the same as a share of the body's size; the larger of the two counts"
    )
    equality: Positive = Field(
        1e-9,
        le=1e-6,
        description="relative: any number of the MJCF, read back, against the robot's, error",
    )
    simulators: tuple[Literal["mujoco", "physx"], ...] = Field(
        ("mujoco",),
        description="engines that run the physical checks; `physx` needs assetbuild[physx]",
    )
    alignment: Alignment = Field(default_factory=lambda: Alignment.model_validate({}))
    smoke: tuple[Literal["mjlab", "newton", "isaaclab"], ...] = Field(
        (),
        description="trainers that try the bundle, each in an environment of its own, which "
        "`assetbuild smoke` makes",
    )
    smoke_bounds: SmokeBounds = Field(default_factory=lambda: SmokeBounds.model_validate({}))


class Waiver(Model):
    """Another severity for a rule; it stays visible with its reason."""

    severity: Severity = Field(description="the severity to report instead")
    because: str = Field(min_length=3, description="the reason, shown beside the finding")


class Recipe(Model):
    """`recipes/<robot>.yaml`."""

    schema_: Literal["assetbuild/v1"] = Field(alias="schema", description="version of this format")
    robot: Name = Field(description="name of the robot and of its bundle")
    source: Source
    base: Literal["floating", "fixed"] = Field(
        "fixed",
        description="whether the root moves freely or is bolted to the world; without this key an "
        "MJCF says it",
    )
    fixed_joints: FixedJoints = Field(default_factory=lambda: FixedJoints.model_validate({}))
    edits: tuple[OneEdit, ...] = Field(
        (),
        max_length=1000,
        description="named changes, in order, before merging: `- set_mass: {link: .., mass: ..}`",
    )
    compose: tuple[Part, ...] = Field(
        (), max_length=32, description="other robots that are mounted on this one"
    )
    visual: Visual = Field(default_factory=lambda: Visual.model_validate({}))
    collision: Collision = Field(default_factory=lambda: Collision.model_validate({}))
    motor_file: str | None = Field(
        None, description="a YAML file of motors, relative to the recipe; `motors` come on top"
    )
    motors: dict[str, Motor] = Field(
        default_factory=dict, description="motors by name, for the actuator table"
    )
    actuators: tuple[ActuatorRow, ...] = Field(
        (), description="the actuator table: every moving joint matches exactly one row"
    )
    keyframes: dict[Name, Keyframe] = Field(
        default_factory=dict, description="poses by name; the first is the robot's initial state"
    )
    contact: Contacts = Field(default_factory=lambda: Contacts.model_validate({}))
    feet: Feet | None = Field(None, description="what the robot stands on")
    imu: Imu | None = Field(None, description="sensors `imu_ang_vel`, `imu_lin_acc`, ...")
    sensors: Sensors = Field(default_factory=dict, description="more sensors, by name")
    cameras: Cameras = Field(default_factory=dict, description="cameras by name")
    mjcf: Mjcf = Field(
        default_factory=lambda: Mjcf.model_validate({}), description="solver options of the MJCF"
    )
    mjx: Mjx = Field(
        default_factory=lambda: Mjx.model_validate({}), description="of the target `mjx`"
    )
    simulation: Simulation = Field(default_factory=lambda: Simulation.model_validate({}))
    usd: Usd = Field(default_factory=lambda: Usd.model_validate({}))
    isaaclab: IsaacLab = Field(default_factory=lambda: IsaacLab.model_validate({}))
    randomize: Randomize | None = Field(
        None, description="ranges for `assetbuild sample`, dr.yaml and trainers"
    )
    targets: Names = Field(("urdf", "mjcf", "usd"), description="formats to write")
    validate_: Validate = Field(
        default_factory=lambda: Validate.model_validate({}), alias="validate"
    )
    rules: dict[str, Waiver] = Field(
        default_factory=dict, description="other severities for rules, by rule id"
    )
    variants: dict[Name, dict[str, Any]] = Field(  # Any: checked by patching, see variants.py
        default_factory=dict,
        max_length=64,
        description="named patches: maps are merged, all else is replaced",
    )
