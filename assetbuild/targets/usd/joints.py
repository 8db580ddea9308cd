"""Joints, drives, the articulation and what it must not collide with.

Armature, velocity limit and friction are written three times from one number: `physxJoint:*`
(Isaac Sim up to 4.5; Isaac Lab writes it still), `physxJointAxis:*` (PhysX of 2026) and
`newton:*` (Newton). A runtime that lacks one of the schemas ignores it without a word.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from pxr import Gf, Usd, UsdGeom, UsdPhysics

from assetbuild.errors import StepError
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mimic import leading
from assetbuild.robot.mjcf_only import as_drives
from assetbuild.robot.model import MOVING, Actuator, Control, Joint, Softness
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3, quat_between, quat_multiply
from assetbuild.robot.softness import USUAL, limit_springs
from assetbuild.simulators.usd_names import ACTUATORS, JOINTS, LOOPS, loop_identifiers
from assetbuild.simulators.usd_options import UsdArticulation, UsdOptions
from assetbuild.targets.usd.layers import apply_foreign, label
from assetbuild.targets.usd.names import PrimPaths
from assetbuild.targets.usd.units import COUPLED_DEG, coordinate, gain, instance, is_angular, limits

NEAR = 1e-9
_AXES: dict[Vec3, tuple[str, Quat]] = {
    (1.0, 0.0, 0.0): ("X", (1.0, 0.0, 0.0, 0.0)),
    (0.0, 1.0, 0.0): ("Y", (1.0, 0.0, 0.0, 0.0)),
    (0.0, 0.0, 1.0): ("Z", (1.0, 0.0, 0.0, 0.0)),
    (-1.0, 0.0, 0.0): ("X", (0.0, 0.0, 1.0, 0.0)),
    (0.0, -1.0, 0.0): ("Y", (0.0, 1.0, 0.0, 0.0)),
    (0.0, 0.0, -1.0): ("Z", (0.0, 1.0, 0.0, 0.0)),
}


def joint_axis(axis: Vec3) -> tuple[str, Quat]:
    """(token, R): USD knows the axes X, Y, Z only; R turns the token's onto `axis`.

    R is the identity for +x, +y, +z and an exact half turn for their opposites. Directions that
    differ from these by less than a float32 quaternion holds count as them.
    """
    for plain, token_and_turn in _AXES.items():
        if max(abs(a - b) for a, b in zip(plain, axis, strict=True)) < NEAR:
            return token_and_turn
    if axis[0] >= 0.0:
        return "X", quat_between((1.0, 0.0, 0.0), axis)
    # By way of the exact half turn: the shortest turn from +x is ill-defined near -x.
    _, half_turn = _AXES[(-1.0, 0.0, 0.0)]
    return "X", quat_multiply(quat_between((-1.0, 0.0, 0.0), axis), half_turn)


def define_joints(
    stage: Usd.Stage,
    names: PrimPaths,
    control: Control,
    options: UsdOptions,
    touching: Collection[frozenset[str]],
) -> None:
    """Every joint of the tree, with limits, drive and passive properties.

    touching: pairs of jointed bodies that may touch.
    """
    tree = names.tree
    if tree.joints or tree.base == "fixed":
        UsdGeom.Scope.Define(stage, f"/{names.root}/{JOINTS}")
    starts = dict(initial_pose(tree, control).joints)
    springs, limited = as_drives(control), limit_springs(tree, control)
    soft = dict(control.soft_limits)
    mimics = {j.name: j.mimic.joint for j in tree.joints if j.mimic and options.mimics}
    coupled = mimics.keys() | set(mimics.values())
    for joint in tree.joints:
        prim = _define_joint(stage, names, joint, coupled)
        # As in MuJoCo, bodies that a joint connects do not collide, but for those on the world.
        touch = frozenset((joint.parent, joint.child)) in touching
        UsdPhysics.Joint(prim).CreateCollisionEnabledAttr(touch)
        label(prim, joint.name)
        if joint.kind in MOVING:
            actuator = control.drive_of(joint)
            _apply_passive(prim, joint, actuator)
            if joint.name in springs:
                # It pulls to its rest with a force, whatever kind the drives of the recipe are.
                spring = springs[joint.name]
                _apply_drive(prim, joint, "force", (spring.stiffness, 0.0), spring.rest, None)
            elif actuator.model != "passive":  # the presence of the API is what makes a drive
                gains = drive_gains(actuator)
                target = starts[joint.name] if actuator.model == "pd" else None
                _apply_drive(prim, joint, options.drive_type, gains, target, actuator.effort)
            if joint.name in limited:
                _apply_limit_spring(prim, joint, limited[joint.name], soft.get(joint.name))
            # PhysX starts a joint where this says, wherever the bodies stand.
            axis, start = instance(joint), {"position": coordinate(joint, starts[joint.name])}
            apply_foreign(prim, f"PhysicsJointStateAPI:{axis}", f"state:{axis}:physics", start)
            if joint.name in mimics:
                _apply_mimic(prim, names, joint)


def define_loops(
    stage: Usd.Stage, names: PrimPaths, control: Control, touching: Collection[frozenset[str]]
) -> None:
    """Joints that close loops: outside of the articulation, which is a tree.

    Newton takes how soft MuJoCo's constraint is from `mjc:` words, else MuJoCo's defaults, by which
    loops open a hundred times as far. Of a `MjcEqualityConnectAPI` it reads one end alone, so a
    `connect` is a weld that leaves the turn free.
    """
    if control.loops:
        UsdGeom.Scope.Define(stage, f"/{names.root}/{LOOPS}")
    identifiers = loop_identifiers(control.loops)
    for loop in control.loops:
        kind = UsdPhysics.FixedJoint if loop.kind == "weld" else UsdPhysics.SphericalJoint
        made = kind.Define(stage, f"/{names.root}/{LOOPS}/{identifiers[loop.name]}")
        made.CreateBody0Rel().SetTargets([names.body(loop.a.body)])
        made.CreateBody1Rel().SetTargets([names.body(loop.b.body)])
        made.CreateExcludeFromArticulationAttr(True)
        made.CreateCollisionEnabledAttr(frozenset((loop.a.body, loop.b.body)) in touching)
        _set_frames(made, loop.a.X_body_end, loop.b.X_body_end)
        label(made.GetPrim(), loop.name)
        soft: dict[str, float | tuple[float, ...]] = {
            "solref": loop.solref,
            "solimp": loop.solimp,
            # 0 leaves the turn free.
            "torqueScale": loop.torque_scale if loop.kind == "weld" else 0.0,
        }
        apply_foreign(made.GetPrim(), "MjcEqualityWeldAPI", "mjc", soft)


def _define_joint(
    stage: Usd.Stage, names: PrimPaths, joint: Joint, coupled: Collection[str]
) -> Usd.Prim:
    path = names.joint(joint.name)
    if joint.kind == "fixed":
        made = UsdPhysics.FixedJoint.Define(stage, path)
        turn: Quat = IDENTITY.quat
    elif joint.kind in MOVING:
        kind = UsdPhysics.RevoluteJoint if is_angular(joint) else UsdPhysics.PrismaticJoint
        made = kind.Define(stage, path)
        token, turn = joint_axis(joint.axis)
        made.CreateAxisAttr(token)
        lower, upper = limits(joint)
        if joint.name in coupled and is_angular(joint):
            lower, upper = max(lower, -COUPLED_DEG), min(upper, COUPLED_DEG)
        made.CreateLowerLimitAttr(lower)
        made.CreateUpperLimitAttr(upper)
    else:
        raise StepError(
            f"joint `{joint.name}` is {joint.kind}, which no USD articulation holds",
            hint="make joints of one coordinate of it by `edits: "
            f"[split_joint: {{joint: {joint.name}}}]`",
        )
    made.CreateBody0Rel().SetTargets([names.body(joint.parent)])
    made.CreateBody1Rel().SetTargets([names.body(joint.child)])
    _set_frames(made, joint.X_parent_joint @ Pose(quat=turn), Pose(quat=turn))
    return made.GetPrim()


def _set_frames(joint: object, frame0: Pose, frame1: Pose) -> None:
    made = UsdPhysics.Joint(joint)
    for pose, position, rotation in (
        (frame0, made.CreateLocalPos0Attr(), made.CreateLocalRot0Attr()),
        (frame1, made.CreateLocalPos1Attr(), made.CreateLocalRot1Attr()),
    ):
        position.Set(Gf.Vec3f(*pose.xyz))
        rotation.Set(Gf.Quatf(*pose.quat))


def _apply_passive(prim: Usd.Prim, joint: Joint, actuator: Actuator) -> None:
    """Armature, friction, damping and velocity limit in all three spellings."""
    axis, armature, friction = instance(joint), actuator.armature, actuator.friction
    damping, velocity = gain(joint, actuator.damping), actuator.velocity
    if velocity is not None:
        velocity = coordinate(joint, velocity)
    old = {"armature": armature, "jointFriction": friction, "maxJointVelocity": velocity}
    new = {
        "armature": armature,
        "staticFrictionEffort": friction,
        "dynamicFrictionEffort": friction,
        "viscousFrictionCoefficient": damping,
        "maxJointVelocity": velocity,
    }
    newton = {"armature": armature, "friction": friction, "damping": damping}
    apply_foreign(prim, "PhysxJointAPI", "physxJoint", old)
    apply_foreign(prim, f"PhysxJointAxisAPI:{axis}", f"physxJointAxis:{axis}", new)
    apply_foreign(prim, "NewtonJointAPI", "newton", newton | {"velocityLimit": velocity})


def _apply_limit_spring(
    prim: Usd.Prim, joint: Joint, spring: tuple[float, float], soft: Softness | None
) -> None:
    """How soft a limit is: MuJoCo's own words, and the spring that they make for other solvers.

    With Newton's own defaults a Panda ran 0.4 rad past its limits.
    """
    stiffness, damping = (gain(joint, value) for value in spring)
    newton = {"limitStiffness": stiffness, "limitDamping": damping}
    apply_foreign(prim, "NewtonJointAPI", "newton", newton)
    stated = soft or USUAL
    words = {"solreflimit": stated.solref, "solimplimit": stated.solimp}
    apply_foreign(prim, "MjcJointAPI", "mjc", words)


def drive_gains(actuator: Actuator) -> tuple[float, float]:
    """(stiffness, damping) of the simulator's own drive, per rad or per m.

    Only `pd` and `velocity` are integrated by the simulator. The others compute an effort
    outside of it, so its drive must add none: gains 0, the effort limit stays.
    """
    if actuator.model == "pd":
        return actuator.kp, actuator.kd
    if actuator.model == "velocity":
        return 0.0, actuator.kd
    return 0.0, 0.0


def _apply_drive(
    prim: Usd.Prim,
    joint: Joint,
    kind: str,
    gains: tuple[float, float],
    target: float | None,
    effort: float | None,
) -> None:
    """gains: stiffness and damping, per rad or per m; target: rad or m; effort: N m or N."""
    drive = UsdPhysics.DriveAPI.Apply(prim, instance(joint))
    drive.CreateTypeAttr(kind)
    drive.CreateStiffnessAttr(gain(joint, gains[0]))
    drive.CreateDampingAttr(gain(joint, gains[1]))
    drive.CreateTargetVelocityAttr(0.0)
    if target is not None:
        drive.CreateTargetPositionAttr(coordinate(joint, target))
    if effort is not None:
        drive.CreateMaxForceAttr(effort)


def _apply_mimic(prim: Usd.Prim, names: PrimPaths, joint: Joint) -> None:
    """q = offset + multiplier q(leader), for Newton as it is, for PhysX as q + G q' + c = 0.

    Where an angle follows a length or a length an angle, PhysX counts the angle in degrees and
    Newton in radians: measured, Newton's schema gives no unit.
    """
    assert joint.mimic is not None  # noqa: S101 # the caller has looked
    leader = names.tree.by_joint[joint.mimic.joint]
    units = coordinate(joint, 1.0) / coordinate(leader, 1.0)
    instance_name = f"rot{joint_axis(joint.axis)[0]}"
    prefix = f"physxMimicJoint:{instance_name}"
    physx: dict[str, float | str] = {
        "gearing": -joint.mimic.multiplier * units,
        "offset": -coordinate(joint, joint.mimic.offset),
        "referenceJointAxis": f"rot{joint_axis(leader.axis)[0]}",
    }
    apply_foreign(prim, f"PhysxMimicJointAPI:{instance_name}", prefix, physx)
    first, factor, offset = leading(names.tree, joint)  # Newton takes no chain of mimics
    newton = {"mimicCoef0": coordinate(joint, offset), "mimicCoef1": factor}
    apply_foreign(prim, "NewtonMimicAPI", "newton", newton)
    leaders = {f"{prefix}:referenceJoint": leader.name, "newton:mimicJoint": first.name}
    for relation, name in leaders.items():
        prim.CreateRelationship(relation, custom=False).SetTargets([names.joint(name)])


def apply_articulation(stage: Usd.Stage, names: PrimPaths, options: UsdArticulation) -> None:
    """ArticulationRootAPI where it decides the base: on the root link, it floats; on the fixed
    joint between world and root link, it stands.
    """
    tree = names.tree
    prim = stage.OverridePrim(names.body(tree.root))
    if tree.base == "fixed":
        joint = UsdPhysics.FixedJoint.Define(stage, names.root_joint)
        joint.CreateBody1Rel().SetTargets([names.body(tree.root)])
        _set_frames(joint, tree.X_world_root, IDENTITY)
        prim = joint.GetPrim()
    UsdPhysics.ArticulationRootAPI.Apply(prim)
    apply_foreign(
        prim,
        "PhysxArticulationAPI",
        "physxArticulation",
        {
            "enabledSelfCollisions": options.self_collisions,
            "solverPositionIterationCount": options.solver_position_iterations,
            "solverVelocityIterationCount": options.solver_velocity_iterations,
            # Unauthored, two readers of the same PhysX take values that differ a thousandfold.
            "sleepThreshold": options.sleep_threshold,
            "stabilizationThreshold": options.stabilization_threshold,
        },
    )
    newton = {"selfCollisionEnabled": options.self_collisions}
    apply_foreign(prim, "NewtonArticulationRootAPI", "newton", newton)


# --- drives outside of the solver ----------------------------------------------------------------


EXPLICIT = ("ideal_pd", "dc_motor", "motor")


def define_actuators(stage: Usd.Stage, names: PrimPaths, control: Control) -> None:
    """A `NewtonActuator` for each joint that an explicit model drives.

    PhysX and Isaac Lab take these efforts from a controller of their own. Newton builds one from
    each of these prims, and a program that steps `model.actuators` needs no other. Units are SI and
    radians, unlike those of UsdPhysics' drives. Source: newton-usd-schemas 0.6.
    """
    explicit = [row for row in control.actuators if row.model in EXPLICIT]
    if explicit:
        UsdGeom.Scope.Define(stage, f"/{names.root}/{ACTUATORS}")
    for row in explicit:
        joint = names.joint(row.joint)
        name = joint.rsplit("/", 1)[-1]
        prim = stage.DefinePrim(f"/{names.root}/{ACTUATORS}/{name}", "NewtonActuator")
        label(prim, row.joint)
        prim.CreateRelationship("newton:targets", custom=False).SetTargets([joint])
        _apply_law(prim, row)


def _apply_law(prim: Usd.Prim, row: Actuator) -> None:
    """The PD law (a `motor` adds the command alone), and what limits its effort."""
    apply_foreign(prim, "NewtonPDControlAPI", "newton", {"kp": row.kp, "kd": row.kd})
    effort = _or_infinite(row.effort)
    if row.model == "dc_motor":
        curve = {
            "maxMotorEffort": effort,
            "saturationEffort": _or_infinite(row.saturation),
            "velocityLimit": _or_infinite(row.velocity),
        }
        apply_foreign(prim, "NewtonDCMotorClampingAPI", "newton", curve)
    else:
        apply_foreign(prim, "NewtonMaxEffortClampingAPI", "newton", {"maxEffort": effort})


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else value
