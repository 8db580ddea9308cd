"""What a recipe may say. Every key has its meaning and unit in its description.

Patterns are regular expressions that must match a whole name of the *source*, before merging.
"""

from __future__ import annotations

import math
import re
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from assetbuild.findings import Severity


def _pattern(text: str) -> str:
    if len(text) > 500:
        raise ValueError("a pattern may have at most 500 characters")
    try:
        re.compile(text)
    except (re.error, OverflowError, RecursionError) as error:
        raise ValueError(f"not a regular expression: {error}") from error
    return text


def _inside(text: str) -> str:
    """A path that cannot lead out of the source: relative, no `..`, slashes only."""
    path = PurePosixPath(text)
    if not text or path.is_absolute() or ".." in path.parts:
        raise ValueError("must be a relative path inside the source, without `..`")
    if "\\" in text or any(ord(c) < 32 for c in text) or re.match(r"[A-Za-z]:", text):
        raise ValueError("must be a plain path with `/` between folders")
    return path.as_posix()


def _no_repeats(values: tuple[str, ...]) -> tuple[str, ...]:
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise ValueError(f"named twice: {', '.join(twice)}")
    return values


def _two_names(pair: tuple[str, str]) -> tuple[str, str]:
    if pair[0] == pair[1]:
        raise ValueError("a pair needs two different links")
    return pair


def _one_name(entry: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:  # Any: as OneEdit
    if len(entry) != 1:
        raise ValueError("an edit is one name and its keys: `set_mass: {link: .., mass: ..}`")
    return entry


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("must be finite")
    return value


Pattern = Annotated[str, AfterValidator(_pattern)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,63}$")]
Real = Annotated[float, AfterValidator(_finite)]
Positive = Annotated[float, Field(gt=0), AfterValidator(_finite)]
NonNegative = Annotated[float, Field(ge=0), AfterValidator(_finite)]
InsidePath = Annotated[str, AfterValidator(_inside)]
Names = Annotated[tuple[str, ...], AfterValidator(_no_repeats)]
OneEdit = Annotated[dict[str, dict[str, Any]], AfterValidator(_one_name)]  # Any: see plan/edits.py
LinkPair = Annotated[tuple[str, str], AfterValidator(_two_names)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


PYPI_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9][A-Za-z0-9.+!_-]*$"


class Model(BaseModel):
    """Base of all recipe models: frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Source(Model):
    """Where the robot comes from: one of path, url, git, pypi; one of urdf, xacro."""

    path: str | None = Field(
        None, description="a folder, or a zip or tar archive, relative to the recipe"
    )
    url: str | None = Field(
        None,
        description="http(s) address of a zip or tar archive",
        pattern=r"^https?://[^/@\s]+/\S*$",
    )
    sha256: Sha256 | None = Field(None, description="of the file at `url`, 64 hex digits")
    git: str | None = Field(
        None,
        description="a repository: https or ssh address, or a folder relative to the recipe",
        pattern=r"^[A-Za-z0-9./~_][^\s]*$",
    )
    rev: str | None = Field(
        None,
        description="branch, tag or commit of `git`; the lock pins the commit",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._/+-]*$",
    )
    pypi: str | None = Field(None, description="`name==version` of a wheel", pattern=PYPI_PATTERN)
    root: InsidePath = Field(
        ".", description="folder inside the source that all paths below start from"
    )
    urdf: InsidePath | None = Field(None, description="the URDF file")
    xacro: InsidePath | None = Field(None, description="the xacro file, instead of `urdf`")
    args: dict[str, str | bool | int | Real] = Field(
        default_factory=dict, description="arguments of the xacro file, by name"
    )
    packages: dict[str, InsidePath] = Field(
        default_factory=dict, description="package:// name -> folder; explicit, nothing is searched"
    )
    license: str | None = Field(None, description="SPDX identifier of the source's licence")

    @model_validator(mode="after")
    def _one_of_each(self) -> Source:
        if [self.path, self.url, self.git, self.pypi].count(None) != 3:
            raise ValueError("give exactly one of `path`, `url`, `git`, `pypi`")
        if (self.url is None) != (self.sha256 is None):
            raise ValueError("`url` and `sha256` go together")
        if (self.git is None) != (self.rev is None):
            raise ValueError("`git` and `rev` go together")
        if self.git is not None and "://" in self.git:
            scheme, _, rest = self.git.partition("://")
            if scheme not in ("http", "https", "ssh") or ":" in rest.partition("@")[0] * (
                "@" in rest
            ):
                raise ValueError("`git`: https or ssh, without a password; or a folder")
        if (self.urdf is None) == (self.xacro is None):
            raise ValueError("give exactly one of `urdf`, `xacro`: the description below `root`")
        if self.args and self.xacro is None:
            raise ValueError("`args` are for a `xacro` file")
        return self

    @property
    def moving(self) -> str | None:
        """What the lock must pin: a name that may stand for something else tomorrow."""
        return self.pypi or (f"{self.git} at {self.rev}" if self.git else None)

    @property
    def origin(self) -> str:
        """Where the files come from, as the recipe spells it."""
        return str(self.path or self.url or self.moving)

    @property
    def description(self) -> str:
        """Path of the robot's description below the root."""
        return str(self.urdf or self.xacro)


class FixedJoints(Model):
    """What happens to links that fixed joints hold together."""

    merge: bool = Field(True, description="merge them exactly; the frames survive")
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


class CollisionRule(Model):
    """How the collision geometry of a link is made."""

    method: str = Field("auto", description="auto, keep, none or a plug-in of assetbuild.collision")
    shape: Literal["box", "sphere", "capsule", "cylinder"] | None = Field(
        None, description="of `primitive`; without it the best fit of all"
    )
    from_: Literal["auto", "collision", "visual"] = Field(
        "auto", alias="from", description="the link's geometry to use; auto: collision, else visual"
    )
    max_hulls: int | None = Field(None, ge=1, le=1024, description="most pieces, where it applies")
    max_vertices: int | None = Field(None, ge=4, le=256, description="most vertices of a piece")
    threshold: Positive | None = Field(
        None, ge=0.01, le=1, description="of `coacd`, relative concavity 0.01..1"
    )


class Exclude(Model):
    """Pairs of bodies that never collide."""

    adjacent: bool = Field(True, description="bodies that a joint connects")
    pairs: tuple[LinkPair, ...] = Field((), description="pairs of source links")


class Collision(Model):
    """Collision geometry, by source link."""

    default: CollisionRule = Field(default_factory=lambda: CollisionRule.model_validate({}))
    links: dict[Pattern, CollisionRule] = Field(
        default_factory=dict, description="the first pattern that matches a link wins"
    )
    exclude: Exclude = Field(default_factory=lambda: Exclude.model_validate({}))


class Motor(Model):
    """A motor with its gear, reusable by several rows of the actuator table."""

    rotor_inertia: NonNegative | None = Field(None, description="kg m2, before the gear")
    gear: Positive = Field(1.0, description="reduction; armature = rotor_inertia * gear^2")
    effort: Positive | None = Field(None, description="N m or N, after the gear")
    velocity: Positive | None = Field(None, description="rad/s or m/s, after the gear")
    friction: NonNegative | None = Field(None, description="dry friction, N m or N")
    source: str = Field("", description="where the numbers come from")


class ActuatorRow(Model):
    """One row of the actuator table; every moving joint matches exactly one."""

    joints: Pattern = Field(description="matches whole joint names")
    model: Literal["pd", "ideal_pd", "dc_motor", "velocity", "motor", "passive"] = Field(
        "pd", description="pd is implicit: the simulator integrates the gains"
    )
    motor: str | None = Field(None, description="name in `motors`")
    kp: NonNegative | None = Field(None, description="N m/rad or N/m")
    kd: NonNegative | None = Field(None, description="of the drive, N m s/rad or N s/m")
    damping: NonNegative | None = Field(
        None, description="passive, of the joint; without it the source's own"
    )
    friction: NonNegative | None = Field(
        None, description="dry; without it the motor's, else the source's own"
    )
    armature: NonNegative | None = Field(None, description="kg m2; without it the motor's")
    effort: Positive | None = Field(None, description="without it the motor's, else the source's")
    velocity: Positive | None = Field(None, description="without it the motor's, else the source's")


class Keyframe(Model):
    """A named pose."""

    base: Literal["on_ground"] | tuple[Real, Real, Real] = Field(
        "on_ground", description="on_ground: lowest collision point at z = 0; or x, y, z in metres"
    )
    joints: dict[Pattern, Real] = Field(
        default_factory=dict, description="rad or m; joints that no pattern matches are 0"
    )


class Contact(Model):
    """The surface of all collision geometry."""

    friction: tuple[NonNegative, NonNegative, NonNegative] = Field(
        (1.0, 0.005, 0.0001), description="sliding, torsional (m), rolling (m)"
    )
    condim: Literal[1, 3, 4, 6] = Field(
        3, description="1: no friction, 3: sliding, 4: also torsional, 6: also rolling"
    )


class Simulation(Model):
    """What the generated files and checks step with."""

    timestep: Positive = Field(0.005, description="s")
    decimation: int = Field(4, ge=1, le=10_000, description="simulation steps per control step")
    gravity: tuple[Real, Real, Real] = Field((0.0, 0.0, -9.81), description="m/s2, world frame")


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError("the first number must not exceed the second")
    return pair


FactorRange = Annotated[tuple[Positive, Positive], AfterValidator(_rising)]
Range = Annotated[tuple[NonNegative, NonNegative], AfterValidator(_rising)]
StepRange = Annotated[
    tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]], AfterValidator(_rising)
]


class RandomMatter(Model):
    """How the matter of a body may differ from the description; draws are uniform."""

    density: FactorRange = Field((0.8, 1.2), description="factor of the mass, shape unchanged")
    com: NonNegative | tuple[NonNegative, NonNegative, NonNegative] = Field(
        0.01, description="largest shift of the matter, m; one number, or one per body axis"
    )
    stretch: Annotated[float, Field(ge=0, le=1)] = Field(
        0.0, description="largest |ln| of the factor by which it is stretched along each axis"
    )
    shear: Annotated[float, Field(ge=0, le=1)] = Field(0.0, description="largest shear, 1")
    source: str = Field("", description="where the range comes from: CAD, datasheet, measured")


class RandomPayload(Model):
    """A homogeneous box that may be mounted."""

    link: str = Field(description="source link that carries it")
    mass: Range = Field(description="least and most, kg")
    size: tuple[Positive, Positive, Positive] = Field(description="edges of the box, m")
    at: tuple[Real, Real, Real] = Field((0.0, 0.0, 0.0), description="its centre on the link, m")
    source: str = Field("", description="where the range comes from")


class RandomJoint(Model):
    """How a joint and its drive may differ; factors of the actuator table's numbers."""

    kp: FactorRange = Field((1.0, 1.0), description="factor")
    kd: FactorRange = Field((1.0, 1.0), description="factor")
    damping: FactorRange = Field((1.0, 1.0), description="factor")
    friction: FactorRange = Field((1.0, 1.0), description="factor, dry friction of the joint")
    armature: FactorRange = Field((1.0, 1.0), description="factor")
    effort: FactorRange = Field((1.0, 1.0), description="factor of the effort limit")
    delay: StepRange = Field((0, 0), description="of the command, simulation steps; for trainers")
    encoder_bias: NonNegative = Field(0.0, description="largest, rad or m; for trainers")
    source: str = Field("", description="where the ranges come from")


class Randomize(Model):
    """What a trainer may vary, so that every variant is a robot that could exist."""

    seed: int = Field(0, ge=0, le=2**63 - 1, description="the same seed draws the same robots")
    links: dict[Pattern, RandomMatter] = Field(
        default_factory=dict, description="bodies by the name of their link; first match wins"
    )
    payloads: tuple[RandomPayload, ...] = Field((), max_length=100, description="boxes to carry")
    joints: dict[Pattern, RandomJoint] = Field(
        default_factory=dict, description="moving joints; the first pattern that matches wins"
    )
    friction: Range | None = Field(
        None, description="sliding friction of all collision geometry, least and most"
    )
    friction_source: str = Field("", description="where that range comes from")


class FreeFall(Model):
    """Dropped without contact and drives."""

    seconds: Positive = Field(0.4, description="s")
    tolerance: Positive = Field(0.003, description="relative, against the integrator's formula")


class Stand(Model):
    """Held by its drives on a floor."""

    keyframe: str = Field("home", description="the pose to hold")
    seconds: Positive = Field(2.0, description="s")
    max_sag: Positive = Field(0.03, description="m of base height, warning")
    max_tilt: Positive = Field(0.1, description="rad of the base, warning")
    max_drift: Positive = Field(0.02, description="m sideways, warning")
    feet: Pattern | None = Field(None, description="source links that may touch the floor")


class Validate(Model):
    """Which physical checks run, and their limits."""

    free_fall: FreeFall | None = Field(
        default_factory=lambda: FreeFall.model_validate({}), description="null = do not run it"
    )
    stand: Stand | None = Field(None, description="stand still under the drives; {} = defaults")
    simulators: tuple[Literal["mujoco", "physx"], ...] = Field(
        ("mujoco",), description="engines that run the physical checks"
    )


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
        "fixed", description="whether the root moves freely or is bolted to the world"
    )
    fixed_joints: FixedJoints = Field(default_factory=lambda: FixedJoints.model_validate({}))
    edits: tuple[OneEdit, ...] = Field(
        (),
        max_length=1000,
        description="named changes, in order, before merging: `- set_mass: {link: .., mass: ..}`",
    )
    visual: Visual = Field(default_factory=lambda: Visual.model_validate({}))
    collision: Collision = Field(default_factory=lambda: Collision.model_validate({}))
    motors: dict[str, Motor] = Field(
        default_factory=dict, description="motors by name, for the actuator table"
    )
    actuators: tuple[ActuatorRow, ...] = Field(
        (), description="the actuator table: every moving joint matches exactly one row"
    )
    keyframes: dict[Name, Keyframe] = Field(
        default_factory=dict, description="poses by name; the first is the robot's initial state"
    )
    contact: Contact = Field(default_factory=lambda: Contact.model_validate({}))
    simulation: Simulation = Field(default_factory=lambda: Simulation.model_validate({}))
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
