"""What the USD asset says is what the robot is, number by number, within float32.

Tolerances. USD physics keeps float32, so a stored number is within 6e-8 of its own size: 2e-7
covers that and one conversion of units. Directions come from a float32 quaternion: four such
errors, 1e-6. Inertia is rebuilt from moments and a quaternion: 1e-6 of the largest moment; the
small moments of a long thin link cannot be held better. Poses are float64: 1e-9.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import MOVING, Actuator, Body, Joint, Tree
from assetbuild.robot.pose import Array, Pose, normalised_quat, rotation_of
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Geometry, Sphere
from assetbuild.robot.tree import forward_kinematics

if TYPE_CHECKING:
    from pxr import Usd


NUMBER, DIRECTION, TENSOR, POSE = 2e-7, 1e-6, 1e-6, 1e-9
DEGREE = math.pi / 180.0
UNDERFLOW = 1e-37
"""Numbers below lose digits in float32, or all of them."""

DIFFERS = Rule(
    "equal.usd.*",
    "error",
    "the stage differs from the robot",
    "report it with both numbers: this is a bug",
)


class UsdEqual(Check):
    """Bodies, joints, limits, gains and shapes of `usd/<robot>.usda` against the robot."""

    version: ClassVar[str] = "6"
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = (
        "tree.json",
        "shapes.json",
        "control.json",
    )
    tools: ClassVar[tuple[str, ...]] = ("usd-core",)
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = (
        "pxr.Usd",
        "pxr.UsdGeom",
        "pxr.UsdPhysics",
        "pxr.UsdShade",
    )

    robot: str
    """Name of the robot: the stem of the main file."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: the largest deviation of each kind, as a share of its tolerance."""
        from pxr import Tf, Usd

        robot = RobotFiles(files.inputs)
        book = Book()
        try:
            stage = Usd.Stage.Open(str(files.inputs / f"usd/{self.robot}.usda"))
        except Tf.ErrorException as error:
            book.differ("unreadable", "robot", f"cannot be opened as USD: {error}")
        else:
            prims = Prims.of(stage)
            _compare_bodies(robot, prims, book)
            _compare_root(robot.tree, prims, book)
            _compare_joints(robot, prims, book)
            _compare_shapes(robot, prims, book)
            _compare_excludes(robot, prims, book)
        write_figures(files, {kind: book.worst[kind] for kind in sorted(book.worst)})
        yield from book.findings


@dataclass
class Book:
    """Findings so far, and how near each kind of number came to its tolerance."""

    findings: list[Finding] = field(default_factory=list)
    worst: dict[str, float] = field(default_factory=dict)

    def differ(self, kind: str, subject: str, message: str, **data: float) -> None:
        """Note one error."""
        self.findings.append(DIFFERS.named(kind)(subject, message, data=dict(sorted(data.items()))))

    def compare(
        self,
        kind: str,
        subject: str,
        what: str,
        found: ArrayLike,
        expected: ArrayLike,
        tolerance: float,
    ) -> None:
        """Note an error unless each entry lies within `tolerance` (absolute) of `expected`."""
        a = np.atleast_1d(np.asarray(found, dtype=np.float64))
        b = np.atleast_1d(np.asarray(expected, dtype=np.float64))
        same = (a == b) | (np.isnan(a) & np.isnan(b))  # equal infinities have no difference
        with np.errstate(invalid="ignore"):
            error = float(np.max(np.where(same, 0.0, np.abs(a - b))))
        tolerance = max(tolerance, UNDERFLOW)
        share = error / tolerance
        if math.isfinite(share):
            self.worst[kind] = max(self.worst.get(kind, 0.0), share)
        if not share <= 1.0:
            shown = f"{what} is {_text(a)} in USD, {_text(b)} in the robot"
            self.differ(kind, subject, shown, error=error, tolerance=tolerance)

    def number(self, kind: str, subject: str, what: str, found: object, expected: float) -> None:
        """Compare a scalar within float32; a missing attribute (None) never equals."""
        if not isinstance(found, int | float):
            self.differ(kind, subject, f"{what} is missing in USD, {expected:.9g} in the robot")
        else:
            self.compare(kind, subject, what, found, expected, NUMBER * abs(expected))


def _text(values: Array) -> str:
    return (
        "(" + ", ".join(f"{v:.9g}" for v in values.ravel()) + ")"
        if values.size > 1
        else (f"{values.ravel()[0]:.9g}")
    )


@dataclass(frozen=True)
class Prims:
    """The prims of a stage by the robot's names."""

    stage: Usd.Stage
    bodies: dict[str, Usd.Prim]
    joints: dict[str, Usd.Prim]
    shapes: dict[str, Usd.Prim]
    frames: dict[str, Usd.Prim]

    @classmethod
    def of(cls, stage: Usd.Stage) -> Prims:
        """Finds bodies and joints by schema, shapes and frames by their place below a body."""
        from pxr import UsdGeom, UsdPhysics

        out = cls(stage, {}, {}, {}, {})
        for prim in stage.Traverse():
            parent = prim.GetParent()
            if prim.HasAPI(UsdPhysics.RigidBodyAPI):
                out.bodies[_name(prim)] = prim
            elif prim.IsA(UsdPhysics.Joint):
                out.joints[_name(prim)] = prim
            elif parent.GetName() in ("visuals", "collisions"):
                out.shapes[_name(prim)] = prim
            elif prim.IsA(UsdGeom.Xform) and parent.HasAPI(UsdPhysics.RigidBodyAPI):
                out.frames[_name(prim)] = prim
        return out

    def world(self, prim: Usd.Prim) -> Array:
        """(4, 4) X_world_prim of a prim, columns are axes, m."""
        from pxr import UsdGeom

        matrix = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0.0)
        return np.array(matrix, dtype=np.float64).T  # USD multiplies row vectors


def _name(prim: Usd.Prim) -> str:
    return str(prim.GetMetadata("displayName") or prim.GetName())


def _get(prim: Usd.Prim, attribute: str) -> object:
    """The authored value of an attribute, None without one."""
    found = prim.GetAttribute(attribute)
    return found.Get() if found and found.HasAuthoredValue() else None


def _vector(value: object) -> Array:
    """(3,) of a USD vector; NaN where there is none."""
    return np.full(3, np.nan) if value is None else np.array(value, dtype=np.float64)


def _rotation(value: object) -> Array:
    """(3, 3) of a USD quaternion; NaN where there is none."""
    if value is None:
        return np.full((3, 3), np.nan)
    imaginary = value.GetImaginary()  # type: ignore[attr-defined] # a Gf quaternion, untyped
    x, y, z = (float(v) for v in imaginary)
    real = float(value.GetReal())  # type: ignore[attr-defined] # as above
    return rotation_of(normalised_quat((real, x, y, z)))


# --- bodies -------------------------------------------------------------------------------------


def _compare_bodies(robot: RobotFiles, prims: Prims, book: Book) -> None:
    tree = robot.tree
    in_root = forward_kinematics(tree, {})
    poses = {name: tree.X_world_root @ pose for name, pose in in_root.items()}
    for body in tree.bodies:
        prim = prims.bodies.get(body.name)
        if prim is None:
            book.differ("missing", f"link {body.name}", "is not a rigid body in USD")
            continue
        _compare_mass(body, prim, book)
        _compare_pose("pose", f"link {body.name}", prims.world(prim), poses[body.name], book)
    for frame in tree.frames:
        prim = prims.frames.get(frame.name)
        if prim is None:
            book.differ("missing", f"link {frame.name}", "is not a frame in USD")
            continue
        X_world_frame = poses[frame.body] @ frame.X_body_frame
        _compare_pose("frame", f"link {frame.name}", prims.world(prim), X_world_frame, book)


def _compare_root(tree: Tree, prims: Prims, book: Book) -> None:
    """A fixed root: its joint with the world holds it where it stands.

    On the robot's own prim, not on the link: a framework that spawns the robot replaces the pose
    of the prim and takes it for that of the root link.
    """
    prim = prims.bodies.get(tree.root)
    if tree.base == "floating" or prim is None:
        return
    subject = f"link {tree.root}"
    within = np.linalg.inv(prims.world(prim.GetParent())) @ prims.world(prim)
    _compare_pose("root", f"{subject} in the robot's prim", within, Pose(), book)
    for joint in prims.joints.values():
        if joint.GetRelationship("physics:body0").GetTargets():
            continue
        place = tree.X_world_root
        found = _vector(_get(joint, "physics:localPos0"))
        near = NUMBER * float(np.abs(place.xyz).max())
        book.compare("root", subject, "the world joint's anchor (m)", found, place.xyz, near)
        turn = _rotation(_get(joint, "physics:localRot0"))
        book.compare("root", subject, "the world joint's turn", turn, place.rotation, DIRECTION)


def _compare_pose(kind: str, subject: str, found: Array, expected: Pose, book: Book) -> None:
    matrix = expected.matrix()
    reach = max(1.0, float(np.abs(matrix[:3, 3]).max()))
    book.compare(kind, subject, "position (m)", found[:3, 3], matrix[:3, 3], POSE * reach)
    book.compare(kind, subject, "orientation", found[:3, :3], matrix[:3, :3], POSE)


def _compare_mass(body: Body, prim: Usd.Prim, book: Book) -> None:
    subject, inertial = f"link {body.name}", body.inertial
    if inertial is None or body.is_massless:
        if _get(prim, "physics:mass") is not None:
            book.differ("mass", subject, "has a mass in USD, none in the robot")
        return
    book.number("mass", subject, "mass (kg)", _get(prim, "physics:mass"), inertial.mass_kg)
    com = np.array(inertial.com_m)
    found = _vector(_get(prim, "physics:centerOfMass"))
    book.compare("com", subject, "centre of mass (m)", found, com, NUMBER * np.abs(com).max())
    axes = _rotation(_get(prim, "physics:principalAxes"))
    moments = _vector(_get(prim, "physics:diagonalInertia"))
    expected = matrix_of(inertial.inertia_com_kg_m2)
    size = float(np.abs(np.linalg.eigvalsh(expected)).max())
    rebuilt = axes @ np.diag(moments) @ axes.T
    book.compare("inertia", subject, "inertia (kg m²)", rebuilt, expected, TENSOR * size)


# --- joints -------------------------------------------------------------------------------------


def _compare_joints(robot: RobotFiles, prims: Prims, book: Book) -> None:
    start = dict(initial_pose(robot.tree, robot.control).joints)
    for joint in robot.tree.joints:
        prim = prims.joints.get(joint.name)
        if prim is None:
            book.differ("missing", f"joint {joint.name}", "is not a joint in USD")
            continue
        _compare_connection(joint, prim, prims, book)
        if joint.kind not in MOVING:
            continue
        _compare_limits(joint, prim, book)
        actuator = robot.control.by_joint.get(joint.name)
        if actuator is not None:
            _compare_drive(joint, actuator, prim, start[joint.name], book)
            _compare_passive(joint, actuator, prim, book)


def _compare_connection(joint: Joint, prim: Usd.Prim, prims: Prims, book: Book) -> None:
    """Which bodies, where, and about which axis: seen from the parent and from the child."""
    subject = f"joint {joint.name}"
    for side, body in (("0", joint.parent), ("1", joint.child)):
        targets = prim.GetRelationship(f"physics:body{side}").GetTargets()
        if [_name(prims.stage.GetPrimAtPath(t)) for t in targets] != [body]:
            book.differ("connection", subject, f"body{side} is not `{body}`")
    position0 = _vector(_get(prim, "physics:localPos0"))
    position1 = _vector(_get(prim, "physics:localPos1"))
    rotation0 = _rotation(_get(prim, "physics:localRot0"))
    rotation1 = _rotation(_get(prim, "physics:localRot1"))
    anchor = np.array(joint.X_parent_joint.xyz)
    near = NUMBER * float(np.abs(anchor).max())
    book.compare("joint_frame", subject, "anchor in the parent (m)", position0, anchor, near)
    book.compare("joint_frame", subject, "anchor in the child (m)", position1, np.zeros(3), 0.0)
    turn = joint.X_parent_joint.rotation
    zero = rotation0 @ rotation1.T
    book.compare("joint_frame", subject, "orientation at q = 0", zero, turn, DIRECTION)
    if joint.kind in MOVING:
        unit = np.eye(3)["XYZ".index(str(_get(prim, "physics:axis") or "X"))]
        axis = np.array(joint.axis)
        parent_axis = turn @ axis
        book.compare("axis", subject, "axis in the child", rotation1 @ unit, axis, DIRECTION)
        book.compare(
            "axis", subject, "axis in the parent", rotation0 @ unit, parent_axis, DIRECTION
        )


def _per_unit(joint: Joint) -> float:
    """Radians or metres in one unit of USD: degrees for angles, metres for lengths."""
    return 1.0 if joint.kind == "prismatic" else DEGREE


def _kind(joint: Joint) -> str:
    return "linear" if joint.kind == "prismatic" else "angular"


def _scaled(value: object, factor: float) -> object:
    return value * factor if isinstance(value, int | float) else value


def _compare_limits(joint: Joint, prim: Usd.Prim, book: Book) -> None:
    limits = joint.limits
    lower = -math.inf if joint.kind == "continuous" or limits.lower is None else limits.lower
    upper = math.inf if joint.kind == "continuous" or limits.upper is None else limits.upper
    for name, expected in (("lowerLimit", lower), ("upperLimit", upper)):
        found = _scaled(_get(prim, f"physics:{name}"), _per_unit(joint))
        book.number("limits", f"joint {joint.name}", f"{name} (rad or m)", found, expected)


def _compare_drive(
    joint: Joint, actuator: Actuator, prim: Usd.Prim, target: float, book: Book
) -> None:
    """Gains of the drive per rad or m; models that the simulator does not integrate have none."""
    from pxr import UsdPhysics

    kind, unit, subject = _kind(joint), _per_unit(joint), f"actuator {joint.name}"
    driven = prim.HasAPI(UsdPhysics.DriveAPI, kind)
    if driven == (actuator.model == "passive"):
        book.differ("drive", subject, f"is `{actuator.model}`; drive in USD: {driven}")
    if not driven or actuator.model == "passive":
        return
    prefix = f"drive:{kind}:physics"
    kp = actuator.kp if actuator.model == "pd" else 0.0
    kd = actuator.kd if actuator.model in ("pd", "velocity") else 0.0
    for name, expected in (("stiffness", kp), ("damping", kd)):
        found = _scaled(_get(prim, f"{prefix}:{name}"), 1.0 / unit)
        book.number("gains", subject, f"{name} per rad or m", found, expected)
    if str(_get(prim, f"{prefix}:type")) != "force":
        book.differ("gains", subject, "the drive is not of type `force`")
    force = _get(prim, f"{prefix}:maxForce")
    if actuator.effort is not None:
        book.number("effort", subject, "maxForce (N m or N)", force, actuator.effort)
    elif force is not None and force != math.inf:
        book.differ("effort", subject, f"maxForce is {force} in USD, unlimited in the robot")
    if actuator.model == "pd":
        found = _scaled(_get(prim, f"{prefix}:targetPosition"), unit)
        book.number("target", subject, "targetPosition (rad or m)", found, target)


def _compare_passive(joint: Joint, actuator: Actuator, prim: Usd.Prim, book: Book) -> None:
    """Armature, friction, damping and velocity limit, in each spelling that some runtime reads."""
    subject, unit, axis = (
        f"actuator {joint.name}",
        _per_unit(joint),
        f"physxJointAxis:{_kind(joint)}",
    )
    checks: list[tuple[str, str, float, float | None]] = [
        ("armature", "physxJoint:armature", 1.0, actuator.armature),
        ("armature", f"{axis}:armature", 1.0, actuator.armature),
        ("armature", "newton:armature", 1.0, actuator.armature),
        ("friction", "physxJoint:jointFriction", 1.0, actuator.friction),
        ("friction", f"{axis}:staticFrictionEffort", 1.0, actuator.friction),
        ("friction", f"{axis}:dynamicFrictionEffort", 1.0, actuator.friction),
        ("friction", "newton:friction", 1.0, actuator.friction),
        ("damping", f"{axis}:viscousFrictionCoefficient", 1.0 / unit, actuator.damping),
        ("damping", "newton:damping", 1.0 / unit, actuator.damping),
        ("velocity", "physxJoint:maxJointVelocity", unit, actuator.velocity),
        ("velocity", f"{axis}:maxJointVelocity", unit, actuator.velocity),
        ("velocity", "newton:velocityLimit", unit, actuator.velocity),
    ]
    for kind, attribute, factor, expected in checks:
        found = _scaled(_get(prim, attribute), factor)
        if expected is not None:
            book.number(kind, subject, f"`{attribute}` (SI)", found, expected)
        elif found is not None and found != math.inf:
            book.differ(kind, subject, f"`{attribute}` is {found} in USD, unlimited in the robot")


# --- shapes, excludes ---------------------------------------------------------------------------


def _compare_shapes(robot: RobotFiles, prims: Prims, book: Book) -> None:
    """Each shape at its place on the right body; sizes of primitives are part of the pose."""
    for shape in robot.shapes.shapes:
        subject = f"shape {shape.name}"
        prim = prims.shapes.get(shape.name)
        body, X_body_shape = robot.tree.shape_placement(shape)
        carrier = prims.bodies.get(body)
        if prim is None or carrier is None:
            book.differ("missing", subject, "is not below its body in USD")
            continue
        relative = np.linalg.inv(prims.world(carrier)) @ prims.world(prim)
        scale = np.linalg.norm(relative[:3, :3], axis=0)
        relative[:3, :3] /= scale
        _compare_pose("shape", subject, relative, X_body_shape, book)
        _compare_size(subject, shape.geometry, prim, scale, book)
        if shape.role == "collision":
            _compare_surface(robot, shape.name, prim, book)


def _compare_surface(robot: RobotFiles, shape: str, prim: Usd.Prim, book: Book) -> None:
    """Static and dynamic friction both are MuJoCo's sliding one; nothing bounces by itself."""
    expected = dict(robot.control.contacts).get(shape, robot.control.contact)
    targets = prim.GetRelationship("material:binding:physics").GetTargets()
    material = prim.GetStage().GetPrimAtPath(targets[0]) if targets else None
    for name, value in (
        ("physics:staticFriction", expected.friction[0]),
        ("physics:dynamicFriction", expected.friction[0]),
        ("physics:restitution", 0.0),
    ):
        found = material.GetAttribute(name).Get() if material else None
        book.number("surface", f"shape {shape}", name, found, value)


def _compare_size(
    subject: str, geometry: Geometry, prim: Usd.Prim, scale: Array, book: Book
) -> None:
    expected: Sequence[float]
    if isinstance(geometry, Box):
        found, expected = _lengths(prim, "size") * scale, geometry.size
    elif isinstance(geometry, Sphere):
        found, expected = _lengths(prim, "radius"), [geometry.radius]
    elif isinstance(geometry, Cylinder | Capsule):
        found, expected = _lengths(prim, "radius", "height"), [geometry.radius, geometry.length]
    else:
        found, expected = scale, (1.0, 1.0, 1.0)
    book.compare("size", subject, "size (m)", found, expected, NUMBER * max(expected))


def _lengths(prim: Usd.Prim, *attributes: str) -> Array:
    """(n,) authored lengths, m; NaN where there is none."""
    values = [_get(prim, name) for name in attributes]
    return np.array([v if isinstance(v, float) else np.nan for v in values])


def _compare_excludes(robot: RobotFiles, prims: Prims, book: Book) -> None:
    """Each excluded pair is filtered: by a joint between the two, or by a filtered pair."""
    jointed = {frozenset((joint.parent, joint.child)) for joint in robot.tree.joints}
    filtered = jointed | _filtered(robot.tree, prims)
    has_colliders = {robot.tree.placement(s.link)[0] for s in robot.shapes.of("collision")}
    for pair in robot.control.excludes:
        if frozenset(pair) not in filtered and has_colliders >= set(pair):
            book.differ("excludes", f"link {pair[0]}", f"collides with `{pair[1]}` in USD")


def _filtered(tree: Tree, prims: Prims) -> set[frozenset[str]]:
    pairs = set()
    for name, prim in prims.bodies.items():
        for target in prim.GetRelationship("physics:filteredPairs").GetTargets():
            other = prims.stage.GetPrimAtPath(target)
            while other and _name(other) not in tree.by_body:
                other = other.GetParent()
            pairs.add(frozenset((name, _name(other) if other else "")))
    return pairs
