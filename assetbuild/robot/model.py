"""The Robot: frozen, SI, radians, quaternions wxyz.

It is stored as separate artefacts, so that a new gain leaves geometry alone and vice versa:

- `Tree` (links.json before, tree.json after merging fixed joints): bodies, joints, frames;
- `Shapes` (shapes.json): visual and collision geometry, each in the frame of its *source* link,
  which `Tree.placement` maps to the body it was merged into;
- `Control` (control.json): actuators, keyframes, contact, excludes, simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from assetbuild.robot.actuator_table import Actuator as Actuator
from assetbuild.robot.actuator_table import ActuatorModel as ActuatorModel
from assetbuild.robot.actuator_table import General as General
from assetbuild.robot.contact import Contact as Contact
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3
from assetbuild.robot.sections import Simulation as Simulation
from assetbuild.robot.shapes import Placed, Shape

Base = Literal["floating", "fixed"]
JointKind = Literal["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "ball"]
MOVING: frozenset[str] = frozenset({"revolute", "continuous", "prismatic"})
"""Joint kinds with one coordinate, which the actuator table must cover."""


@dataclass(frozen=True)
class Inertial:
    """Mass properties of one body.

    com_m: centre of mass in the body frame.
    inertia_com_kg_m2: (xx, yy, zz, xy, xz, yz) about the centre of mass, in the axes of the body.
    """

    mass_kg: float
    com_m: Vec3
    inertia_com_kg_m2: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Body:
    """A rigid body: a link of the source, or several that fixed joints hold together."""

    name: str
    inertial: Inertial | None = None

    @property
    def is_massless(self) -> bool:
        """No mass is stated, or 0, which many write to quieten a parser or to hold a base.

        Whatever its tensor says: to PhysX a mass of 0 is none, and it makes one up.
        """
        return self.inertial is None or self.inertial.mass_kg == 0.0


@dataclass(frozen=True)
class Limits:
    """Limits of one joint; None = the source states none. rad, rad/s, N m or m, m/s, N."""

    lower: float | None = None
    upper: float | None = None
    effort: float | None = None
    velocity: float | None = None


URDF_UNLIMITED = 1e9
"""What a URDF states where nothing limits a joint: urdfdom wants a number, and 0 would hold it."""


@dataclass(frozen=True)
class Mimic:
    """q = offset + multiplier * q(joint)."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Joint:
    """A joint between two bodies.

    X_parent_joint: pose of the joint frame in the parent body; the child body's frame coincides
        with the joint frame at q = 0 (the URDF convention).
    axis: unit vector in the joint frame.
    damping: N m s/rad or N s/m; friction: N m or N; None = the source states none.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    X_parent_joint: Pose = IDENTITY
    axis: Vec3 = (1.0, 0.0, 0.0)
    limits: Limits = Limits()
    damping: float | None = None
    friction: float | None = None
    mimic: Mimic | None = None

    @property
    def bounds(self) -> tuple[float, float]:
        """(lower, upper), rad or m; infinite where nothing limits it."""
        if self.kind == "continuous":
            return -math.inf, math.inf
        lower, upper = self.limits.lower, self.limits.upper
        return (-math.inf if lower is None else lower), (math.inf if upper is None else upper)

    @property
    def range(self) -> tuple[float, float] | None:
        """(lower, upper), rad or m, where it has both."""
        return self.bounds if all(map(math.isfinite, self.bounds)) else None

    @property
    def shown_range(self) -> tuple[float, float]:
        """The range; where it states none that opens, half a turn or 1 m to both sides."""
        if self.range is not None and self.range[0] < self.range[1]:
            return self.range
        far = 1.0 if self.kind == "prismatic" else math.pi
        return -far, far

    @property
    def is_locked(self) -> bool:
        """Whether equal limits hold it, so that a drive could move nothing."""
        return self.limits.lower is not None and self.limits.lower == self.limits.upper

    @property
    def undriven(self) -> Actuator:
        """What the source says of it without a drive; a limit of 0 says nothing."""
        return Actuator(
            joint=self.name,
            model="passive",
            damping=self.damping or 0.0,
            friction=self.friction or 0.0,
            effort=self.limits.effort or None,
            velocity=self.limits.velocity or None,
        )


@dataclass(frozen=True)
class Frame:
    """A link that a fixed joint merged into `body`: it lives on as a site or an Xform."""

    name: str
    body: str
    X_body_frame: Pose


@dataclass(frozen=True)
class Tree:
    """Bodies and joints; bodies in depth-first order of the source, the root first.

    X_world_root: where a fixed root is held (an arm on a wall); the identity of a floating one,
    which its keyframes place.
    """

    name: str
    base: Base
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...] = ()
    X_world_root: Pose = IDENTITY

    @property
    def root(self) -> str:
        """Name of the root body."""
        return self.bodies[0].name

    def root_pose(self, keyframe: Keyframe | None) -> Pose:
        """X_world_root in a keyframe, which only a floating base obeys."""
        return (keyframe.base if keyframe else None) or self.X_world_root

    @cached_property
    def by_body(self) -> dict[str, Body]:
        """Bodies by name."""
        return {body.name: body for body in self.bodies}

    @cached_property
    def by_joint(self) -> dict[str, Joint]:
        """Joints by name."""
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def joint_above(self) -> dict[str, Joint]:
        """The joint that carries a body, by the body's name; the root has none."""
        return {joint.child: joint for joint in self.joints}

    @property
    def moving_joints(self) -> tuple[Joint, ...]:
        """Joints with one coordinate, in tree order."""
        return tuple(joint for joint in self.joints if joint.kind in MOVING)

    def with_inertials(self, inertials: Mapping[str, Inertial]) -> Tree:
        """The tree with other mass properties of some bodies, by name."""
        bodies = (replace(b, inertial=inertials.get(b.name, b.inertial)) for b in self.bodies)
        return replace(self, bodies=tuple(bodies))

    def placement(self, link: str) -> tuple[str, Pose]:
        """(body, X_body_link) of a link of the source; KeyError when there is none."""
        if link in self.by_body:
            return link, IDENTITY
        frame = self._by_frame[link]
        return frame.body, frame.X_body_frame

    def shape_placement(self, shape: Placed) -> tuple[str, Pose]:
        """(body, X_body_shape) of a shape, which hangs on a link of the source."""
        body, X_body_link = self.placement(shape.link)
        return body, X_body_link @ shape.X_link_shape

    @cached_property
    def _by_frame(self) -> dict[str, Frame]:
        return {frame.name: frame for frame in self.frames}


@dataclass(frozen=True)
class Keyframe:
    """A pose of the whole robot. base: X_world_root of a floating base, None when fixed.

    joints: (name, value) of every moving joint in tree order, rad or m.
    turns: (name, R_parent_child) of ball joints that are turned.
    """

    name: str
    joints: tuple[tuple[str, float], ...]
    base: Pose | None = None
    turns: tuple[tuple[str, Quat], ...] = ()


@dataclass(frozen=True)
class Place:
    """Something with a name that a sensor looks at. kind "frame": a `Frame` or a body's frame."""

    kind: Literal["frame", "body", "joint", "actuator", "shape", "camera", "tendon", "world"]
    name: str = ""


@dataclass(frozen=True)
class Sensor:
    """kind: MJCF's word, such as gyro, accelerometer, velocimeter, framequat, touch, jointpos.

    at: what it measures; relative_to: in whose frame, None = the world's.
    cutoff, noise: in the sensor's own unit; 0 = none.
    """

    name: str
    kind: str
    at: Place
    relative_to: Place | None = None
    cutoff: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class Camera:
    """A camera on a link (None = in the world): looks along -z of its frame, +y is up.

    fovy: vertical field of view, rad; resolution: (width, height) in pixels.
    tracking: "fixed" to its link, or MuJoCo's trackcom (follows the robot's centre of mass).
    """

    name: str
    link: str | None
    X_link_camera: Pose
    fovy: float = 0.7853981633974483
    resolution: tuple[int, int] = (640, 480)
    tracking: str = "fixed"


@dataclass(frozen=True)
class MjcfOnly:
    """What only MJCF can say: kept as it was for the MJCF, reported for all other formats.

    place: the section it stands in (equality, tendon, actuator, sensor, asset, option, size), or
    "body", "joint", "shape", "frame", "camera" with the `owner`'s name in the Robot.
    element: with a section or a body, one XML element whose references are names in the Robot;
    with the others, an empty element whose attributes belong on the owner's element.
    owner: of an actuator, the joint whose drive it is in all other formats; "" where it is none.
    """

    place: str
    element: str
    owner: str = ""


@dataclass(frozen=True)
class LoopEnd:
    """The frame by which a loop holds a body; in a `SourceControl`, a link."""

    body: str
    X_body_end: Pose = IDENTITY


@dataclass(frozen=True)
class Loop:
    """A closed kinematic loop: a constraint between two bodies of the tree.

    kind: `connect` keeps the origins of both frames together, `weld` the whole frames.
    solref, solimp: MuJoCo's softness of the constraint. torque_scale: MuJoCo's weight of a weld's
    rotation against its translation, m. urdf: whether a URDF, which has no loops, leaves it open or
    approximates it, see `LoopMimic`.
    """

    name: str
    kind: Literal["connect", "weld"]
    a: LoopEnd
    b: LoopEnd
    solref: tuple[float, ...] = (0.005, 1.0)
    solimp: tuple[float, ...] = (0.999, 0.9999, 0.001, 0.5, 2.0)
    torque_scale: float = 1.0
    urdf: Literal["open", "mimic"] = "open"

    @property
    def ends(self) -> tuple[LoopEnd, LoopEnd]:
        """Both ends."""
        return self.a, self.b


@dataclass(frozen=True)
class LoopMimic:
    """A straight line through the positions that a loop gives a joint, for formats without loops.

    mimic: rad or m; off: its largest error, rad or m, over this range of the leader.
    """

    loop: str
    joint: str
    mimic: Mimic
    off: float
    range: tuple[float, float]


@dataclass(frozen=True)
class Softness:
    """How MuJoCo holds a limit or a coupling. solref: time constant in s, damping ratio."""

    solref: tuple[float, float]
    solimp: tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Control:
    """Everything a recipe adds to the geometry. excludes: pairs of body names, each sorted.

    contact: of all collision shapes; contacts: of those that differ, by the shape's name.
    loop_mimics: for the URDF alone, where the recipe asks for them.
    reach_m: how far below z = 0 the moving shapes of a fixed robot reach in the initial pose.
    soft_limits, soft_couplings: by joint, where MuJoCo's default would not hold full effort.
    """

    actuators: tuple[Actuator, ...] = ()
    keyframes: tuple[Keyframe, ...] = ()
    excludes: tuple[tuple[str, str], ...] = ()
    contact: Contact = field(default_factory=Contact)
    simulation: Simulation = field(default_factory=Simulation)
    contacts: tuple[tuple[str, Contact], ...] = ()
    sensors: tuple[Sensor, ...] = ()
    cameras: tuple[Camera, ...] = ()
    mjcf_only: tuple[MjcfOnly, ...] = ()
    loops: tuple[Loop, ...] = ()
    loop_mimics: tuple[LoopMimic, ...] = ()
    reach_m: float = 0.0
    soft_limits: tuple[tuple[str, Softness], ...] = ()
    soft_couplings: tuple[tuple[str, Softness], ...] = ()

    @cached_property
    def by_joint(self) -> dict[str, Actuator]:
        """Actuators by the name of their joint."""
        return {actuator.joint: actuator for actuator in self.actuators}

    def drive_of(self, joint: Joint) -> Actuator:
        """The row of a moving joint; without one, what the source says of it."""
        return self.by_joint.get(joint.name) or joint.undriven

    @cached_property
    def _by_shape(self) -> dict[str, Contact]:
        return dict(self.contacts)

    def surface_of(self, shape: Shape) -> Contact:
        """The surface of a collision shape."""
        return self._by_shape.get(shape.name, self.contact)

    @property
    def in_mjcf(self) -> Control:
        """The control without the drives that the MJCF states in its own words, see `mjcf_only`."""
        over = {i.owner for i in self.mjcf_only if i.place == "actuator" and i.owner}
        rows = tuple(row.undriven if row.joint in over else row for row in self.actuators)
        return replace(self, actuators=rows) if over else self

    @property
    def initial_keyframe(self) -> Keyframe | None:
        """The keyframe `home`, else the first; None without any, see `robot.initial`."""
        first = self.keyframes[0] if self.keyframes else None
        return next((key for key in self.keyframes if key.name == "home"), first)
