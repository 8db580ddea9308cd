"""What a recipe may say. Every key has its meaning and unit in its description.

Patterns are regular expressions that must match a whole name of the *source*, before merging.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, model_validator

from assetbuild.findings import Severity
from assetbuild.recipe.source import Source
from assetbuild.recipe_types import Model, Name, Pattern, Real
from assetbuild.robot.actuator_table import (
    ActuatorRow,  # the recipe is read from here
    Motor,
)
from assetbuild.robot.contact import Contacts, Exclude
from assetbuild.robot.identify import Identify
from assetbuild.robot.inertia import InertiaBounds
from assetbuild.robot.loops import LoopRow
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.sections import (
    About,
    At,
    Cameras,
    Feet,
    Imu,
    Keyframe,
    Mount,
    Region,
    Sensors,
    Simulation,
    ToleranceRegion,
)
from assetbuild.robot.softness import CouplingError, LimitError

Preset = Literal["locomotion", "manipulation"]


class CollisionRule(Model):
    """How the collision geometry of a link is made, and how well it must fit."""

    method: str = Field("auto", description="auto, keep, none or a plug-in of assetbuild.collision")
    from_: Literal["auto", "collision", "visual"] = Field(
        "auto", alias="from", description="the link's geometry to use; auto: collision, else visual"
    )
    preset: Preset | None = Field(
        None, description="tolerances of `auto` that are not stated; without it `collision.preset`"
    )


class ShapedRule(CollisionRule):
    """A rule whose method makes new shapes."""

    keep_open: tuple[Region, ...] = Field(
        (), max_length=64, description="places that no piece may enter: gaps, holes, handles"
    )
    regions: tuple[ToleranceRegion, ...] = Field(
        (), max_length=64, description="places with a tighter `max_outside`"
    )


Prefix = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}$")]


class Part(Model):
    """Another robot, mounted on this one by a fixed joint. All its names get a prefix."""

    recipe: str | None = Field(None, description="its recipe, relative to this one")
    source: Source | None = Field(
        None,
        description="the robot itself, instead of a `recipe`: the rows of this recipe that name "
        "its prefix speak of it",
    )
    variant: Name | None = Field(None, description="of that recipe")
    as_: Prefix = Field(alias="as", description="prefix of all its names, such as `arm_`")
    at: At = Field(description="where its root sits")
    mount: Mount | None = Field(None, description="the plate or bracket between the two")
    exclude: tuple[str, ...] = Field(
        (), description="links of the base robot that nothing of the part collides with"
    )
    home: dict[Pattern, Real] = Field(
        default_factory=dict,
        description="its joints, by their own names, in keyframe `home`; without it as its "
        "recipe's own `home`",
    )

    @model_validator(mode="after")
    def _one_origin(self) -> Part:
        if (self.recipe is None) == (self.source is None):
            raise ValueError("give exactly one of `recipe`, `source`")
        if self.source is not None and self.variant is not None:
            raise ValueError("`variant` is one of a `recipe`: a `source` has none")
        return self


def _no_repeats(values: tuple[str, ...]) -> tuple[str, ...]:
    twice = sorted({value for value in values if values.count(value) > 1})
    if twice:
        raise ValueError(f"named twice: {', '.join(twice)}")
    return values


Names = Annotated[tuple[str, ...], AfterValidator(_no_repeats)]


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
    default: CollisionRule = CollisionRule()
    links: dict[Pattern, CollisionRule] = Field(
        default_factory=dict, description="the first pattern that matches a link wins"
    )
    exclude: Exclude = Exclude()


class Validate(Model):
    """Which physical checks run, and their limits; each check adds the keys of its own."""

    linters: Names = Field(
        (), description="other people's linters of the MJCF; they need assetbuild[lint]"
    )
    inertia: InertiaBounds = InertiaBounds()
    simulators: tuple[Literal["mujoco", "physx"], ...] = Field(
        ("mujoco",),
        description="engines that run the physical checks; `physx` needs assetbuild[physx]",
    )
    smoke: Names = Field(
        (),
        description="trainers that try the bundle, each in an environment of its own, which "
        "`assetbuild smoke` makes",
    )


class Waiver(Model):
    """Another severity for a rule; it stays visible with its reason."""

    severity: Severity = Field(description="the severity to report instead")
    because: str = Field(min_length=3, description="the reason, shown beside the finding")


class OneEdit(Model):
    """One entry of `edits`; each edit adds a key of its name, whose value is the edit itself."""

    @property
    def name(self) -> str:
        """Which edit it is."""
        return next(iter(self.model_fields_set))

    @model_validator(mode="after")
    def _one_name(self) -> Self:
        if len(self.model_fields_set) != 1:
            raise ValueError("an edit is one name and its keys: `set_mass: {link: .., mass: ..}`")
        return self


class Recipe(Model):
    """`recipes/<robot>.yaml`."""

    foreign_checks: ClassVar[tuple[str, ...]] = ()
    foreign_readers: ClassVar[tuple[str, ...]] = ()
    """Plug-ins of other distributions that the recipe asks for, by name."""

    schema_: Literal["assetbuild/v1"] = Field(alias="schema", description="version of this format")
    robot: Name = Field(description="name of the robot and of its bundle")
    about: About = About()
    source: Source
    base: Literal["floating", "fixed"] = Field(
        "fixed",
        description="whether the root moves freely or is bolted to the world; without this key an "
        "MJCF says it",
    )
    fixed_joints: FixedJoints = FixedJoints()
    edits: tuple[OneEdit, ...] = Field(
        (),
        max_length=1000,
        description="named changes, in order, before merging: `- set_mass: {link: .., mass: ..}`",
    )
    compose: tuple[Part, ...] = Field(
        (), max_length=32, description="other robots that are mounted on this one"
    )
    loops: tuple[LoopRow, ...] = Field(
        (),
        max_length=256,
        description="closed kinematics: pairs of frames that stay together; the links and joints "
        "of the source stay a tree",
    )
    identify: tuple[Identify, ...] = Field(
        (), max_length=32, description="actuator numbers that are fitted to logs of the real robot"
    )
    visual: Visual = Visual()
    collision: Collision = Collision()
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
    contact: Contacts = Contacts()
    feet: Feet | None = Field(None, description="what the robot stands on")
    imu: Imu | None = Field(None, description="sensors `imu_ang_vel`, `imu_lin_acc`, ...")
    sensors: Sensors = Field(default_factory=dict, description="more sensors, by name")
    cameras: Cameras = Field(default_factory=dict, description="cameras by name")
    simulation: Simulation = Simulation()
    limits: LimitError = LimitError()
    couplings: CouplingError = CouplingError()
    randomize: Randomize | None = Field(
        None, description="ranges for `assetbuild sample`, dr.yaml and trainers"
    )
    targets: Names = Field(("urdf", "mjcf", "usd"), description="formats to write")
    validate_: Validate = Field(Validate(), alias="validate")
    rules: dict[str, Waiver] = Field(
        default_factory=dict, description="other severities for rules, by rule id"
    )
    variants: dict[Name, dict[str, Any]] = Field(  # Any: checked by patching, see loader.py
        default_factory=dict,
        max_length=64,
        description="named patches: maps are merged, all else is replaced",
    )

    def value(self, path: str) -> Any:  # Any: of the key's own type
        """The value at a path such as `validate.stand`; None below what is null. KeyError."""
        here: Any = self  # Any: as above
        for name in path.split("."):
            if here is None:
                return None
            here = getattr(here, _attribute(here, name))
        return here

    def stated(self, path: str) -> frozenset[str]:
        """The keys of a section that the recipe itself states; none of one that it lacks."""
        try:
            return frozenset(self.value(path).model_fields_set)
        except KeyError:
            return frozenset()

    def states(self, key: str) -> bool:
        """Whether the recipe itself states a key at its top."""
        return _attribute(self, key) in self.model_fields_set

    def agrees(self, key: str, value: object) -> bool:
        """Whether a key at the top has this value; one that the recipe lacks has its default."""
        try:
            return bool(self.value(key) == value)
        except KeyError:
            return bool(type(value)() == value)


def _attribute(model: BaseModel, key: str) -> str:
    """The attribute behind a key: `from_` behind `from`. KeyError."""
    for name, field in type(model).model_fields.items():
        if key == (field.alias or name):
            return name
    raise KeyError(key)
