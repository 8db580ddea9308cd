"""The Robot: frozen, SI, radians, quaternions wxyz.

It is stored as separate artefacts, so that a new gain leaves geometry alone and a new mesh
leaves gains alone:

- `Tree` (links.json before, tree.json after merging fixed joints): bodies, joints, frames;
- `Shapes` (shapes.json): visual and collision geometry, each in the frame of its *source* link,
  which `Tree.placement` maps to the body it was merged into;
- `Control` (control.json): actuators, keyframes, contact, excludes, simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from assetbuild.robot.pose import IDENTITY, Pose, Vec3

Base = Literal["floating", "fixed"]
JointKind = Literal["revolute", "continuous", "prismatic", "fixed", "floating", "planar"]
ActuatorModel = Literal["pd", "ideal_pd", "dc_motor", "velocity", "motor", "general", "passive"]
Role = Literal["visual", "collision"]

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


@dataclass(frozen=True)
class Limits:
    """Limits of one joint; None = the source states none. rad, rad/s, N m or m, m/s, N."""

    lower: float | None = None
    upper: float | None = None
    effort: float | None = None
    velocity: float | None = None


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


@dataclass(frozen=True)
class Frame:
    """A link that a fixed joint merged into `body`: it lives on as a site or an Xform."""

    name: str
    body: str
    X_body_frame: Pose


@dataclass(frozen=True)
class Tree:
    """Bodies and joints; bodies in depth-first order of the source, the root first."""

    name: str
    base: Base
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...] = ()

    @property
    def root(self) -> str:
        """Name of the root body."""
        return self.bodies[0].name

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

    def placement(self, link: str) -> tuple[str, Pose]:
        """(body, X_body_link) of a link of the source; KeyError when there is none."""
        if link in self.by_body:
            return link, IDENTITY
        frame = self._by_frame[link]
        return frame.body, frame.X_body_frame

    @cached_property
    def _by_frame(self) -> dict[str, Frame]:
        return {frame.name: frame for frame in self.frames}


@dataclass(frozen=True)
class Box:
    """size: full edge lengths, m."""

    size: Vec3


@dataclass(frozen=True)
class Sphere:
    """radius: m."""

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """Axis z, centred; length: full, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """Axis z, centred; length: of the cylinder between the two half spheres, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Mesh:
    """mesh: before `assemble` the path of a source file, afterwards the name of a `MeshAsset`.

    scale: per axis; it is baked into the asset by the conversion, so it is 1 afterwards.
    """

    mesh: str
    scale: Vec3 = (1.0, 1.0, 1.0)


Geometry = Box | Sphere | Cylinder | Capsule | Mesh


@dataclass(frozen=True)
class Material:
    """rgba in 0..1; texture: file name of a PNG in the mesh folder, or None."""

    name: str
    rgba: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 1.0)
    texture: str | None = None


@dataclass(frozen=True)
class Shape:
    """One piece of geometry.

    name: unique among the shapes of the robot.
    link: the source link that carries it (see `Tree.placement`).
    material: name of one of `Shapes.materials`; None = the format's default. Collision has none.
    """

    name: str
    link: str
    role: Role
    geometry: Geometry
    X_link_shape: Pose = IDENTITY
    material: str | None = None


@dataclass(frozen=True)
class MeshAsset:
    """A mesh file of the bundle: `<name>.obj`, metres, triangles.

    name: `<stem>-<8 of the digest>`. convex: the file is a convex hull (collision pieces are).
    """

    name: str
    file: str
    vertices: int
    faces: int
    convex: bool = False


@dataclass(frozen=True)
class Shapes:
    """All geometry of the robot."""

    shapes: tuple[Shape, ...] = ()
    materials: tuple[Material, ...] = ()
    meshes: tuple[MeshAsset, ...] = ()

    def of(self, role: Role) -> tuple[Shape, ...]:
        """The shapes of one role, in order."""
        return tuple(shape for shape in self.shapes if shape.role == role)


@dataclass(frozen=True)
class Actuator:
    """What drives, brakes and limits one moving joint. Each moving joint has exactly one.

    kp: N m/rad (N/m); kd: of the drive, N m s/rad; damping: passive, of the joint; they add up.
    effort: N m or N; velocity: rad/s or m/s; armature: reflected rotor inertia, kg m2 or kg;
    friction: dry, N m or N. None = unlimited.
    motor: name in the recipe's motor table; source: where its numbers come from.
    """

    joint: str
    model: ActuatorModel
    kp: float = 0.0
    kd: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0
    effort: float | None = None
    velocity: float | None = None
    motor: str = ""
    source: str = ""


@dataclass(frozen=True)
class Keyframe:
    """A pose of the whole robot. base: X_world_root of a floating base, None when fixed.

    joints: (name, value) of every moving joint in tree order, rad or m.
    """

    name: str
    joints: tuple[tuple[str, float], ...]
    base: Pose | None = None


@dataclass(frozen=True)
class Contact:
    """Surface of all collision shapes. friction: sliding (1), torsional (m), rolling (m)."""

    friction: Vec3 = (1.0, 0.005, 0.0001)
    condim: int = 3


@dataclass(frozen=True)
class Simulation:
    """timestep: s; decimation: simulation steps per control step; gravity: m/s2."""

    timestep: float = 0.002
    decimation: int = 1
    gravity: Vec3 = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Control:
    """Everything a recipe adds to the geometry. excludes: pairs of body names, each sorted."""

    actuators: tuple[Actuator, ...] = ()
    keyframes: tuple[Keyframe, ...] = ()
    excludes: tuple[tuple[str, str], ...] = ()
    contact: Contact = Contact()
    simulation: Simulation = Simulation()

    @cached_property
    def by_joint(self) -> dict[str, Actuator]:
        """Actuators by the name of their joint."""
        return {actuator.joint: actuator for actuator in self.actuators}
