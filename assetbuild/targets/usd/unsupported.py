"""What USD, or the runtimes that read it, cannot hold of this robot."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import lost_in_usd, no_drives, whole_gravity
from assetbuild.robot.model import Contact, Control, Joint, Tree
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd.units import is_angular, limits

MAX_LINKS = 64
MAX_ANGLE_DEG = 360.0

KEYFRAMES = Rule(
    "usd.keyframes", "info", "USD has no keyframes; drives aim at the initial one", "nothing"
)
PARALLEL_AXIS = Rule(
    "usd.parallel_axis",
    "info",
    "joint axes are exactly parallel to a body axis",
    "`edits: perturb_axis`, for a runtime that treats them as a special case",
)
START_OUTSIDE = Rule(
    "usd.start",
    "info",
    "0 is outside the limits of a joint and there is no keyframe: the joint starts at the nearest "
    "limit",
    "add a keyframe `home`",
)
FRICTION_UNIT = Rule(
    "usd.friction_unit",
    "info",
    "older runtimes read friction as a coefficient",
    "check on Isaac Sim 4.5 and older",
)
CONTACT = Rule(
    "usd.contact",
    "info",
    "PhysX does not hold a kind of contact value (condim, torsional and rolling friction, "
    "priority, solref, solimp, margin, gap)",
    "nothing, or look at the report's table of `alignment`",
)
EXPLICIT_ACTUATOR = Rule(
    "usd.explicit_actuator",
    "info",
    "torque motors: their gains belong to the controller",
    "nothing",
)
MANY_LINKS = Rule(
    "usd.links",
    "warning",
    "there are more links than older PhysX versions accept",
    "merge fixed joints",
)
LIMIT_CLAMPED = Rule(
    "usd.limit_clamped",
    "info",
    "a limit is beyond a full turn: PhysX's documentation says that it is clamped there; PhysX 0.7 "
    "holds and reaches it",
    "nothing, or make the joint continuous for other versions of PhysX",
)
ONE_SIDED_LIMIT = Rule(
    "usd.one_sided_limit",
    "warning",
    "one bound is infinite; some readers of PhysX then limit neither side",
    "give the joint both limits",
)
SPRING = Rule(
    "usd.spring",
    "error",
    "a joint has a spring that the USD is written without, because the joint has a drive of its "
    "own or the stiffness is a polynomial: it moves otherwise in PhysX and Newton than in MuJoCo",
    "leave `usd` and `isaaclab` out of `targets`, add the spring in the simulator, or accept the "
    "loss by `rules: {usd.spring: {severity: warning, because: ...}}`",
)
MOTION = Rule(
    "usd.motion",
    "error",
    "the source's MJCF says what moves the robot and no USD can say (see `mjcf.motion`): in PhysX "
    "and Newton it moves otherwise than in MuJoCo",
    "leave `usd` and `isaaclab` out of `targets`, or accept the loss by `rules: {usd.motion: "
    "{severity: warning, because: ...}}`",
)
GRAVITY = Rule(
    "usd.gravity",
    "info",
    "the weight of bodies is compensated wholly (`gravcomp` 1 in the MJCF): PhysX does not pull "
    "them; other readers of the USD do",
    "nothing for PhysX and Isaac Lab",
)
MIMIC = Rule(
    "usd.mimic",
    "info",
    "a mimic joint that the USD does not couple, because the recipe says `usd.mimics: false`",
    "couple the joints in the simulator",
)

_ROLLING = "torsional and rolling friction"
_NOT_IN_PHYSX = {
    "condim": "PhysX has sliding friction only",
    _ROLLING: "Newton reads them from the physics material, PhysX does not",
    "priority": "PhysX takes the mean of two frictions",
    "solref": "PhysX's contacts are hard",
    "solimp": "PhysX's contacts are hard",
    "margin": "PhysX has contact offsets of its own",
    "gap": "PhysX has contact offsets of its own",
}
"""Why PhysX does not hold a field of `Contact`."""


def unsupported(tree: Tree, control: Control, options: UsdOptions) -> Iterator[Finding]:
    """Findings for all that is missing, clamped or read differently."""
    for joint in tree.moving_joints:
        yield from _limits(joint)
        if joint.mimic is not None and not options.mimics:
            yield MIMIC(
                f"joint {joint.name}",
                f"does not follow `{joint.mimic.joint}` in USD: the recipe says "
                "`usd.mimics: false`",
            )
    yield from _actuators(control)
    yield from _springs(control)
    yield from _motion(control)
    yield from _contact(control)
    yield from _keyframes(control)
    yield from _starts(tree, control)
    yield from _parallel_axes(tree)
    if len(tree.bodies) > MAX_LINKS:
        yield MANY_LINKS(
            "robot",
            f"{len(tree.bodies)} bodies: older PhysX and Isaac Sim hold {MAX_LINKS} in an "
            "articulation; unverified on newer ones",
            hint=f"merge {_mergeable(tree)}: `fixed_joints`",
            data={"bodies": len(tree.bodies), "limit": MAX_LINKS},
        )


def _mergeable(tree: Tree) -> str:
    """The bodies that fixed joints hold, for a hint."""
    held = [joint.child for joint in tree.joints if joint.kind == "fixed"]
    if not held:
        return "what hangs on joints that need not move"
    return ", ".join(f"`{name}`" for name in held[:6]) + (", ..." if len(held) > 6 else "")


def _limits(joint: Joint) -> Iterator[Finding]:
    if joint.kind == "continuous":
        return
    lower, upper = limits(joint)
    stated = (joint.limits.lower is not None, joint.limits.upper is not None)
    if any(stated) and not all(stated):
        yield ONE_SIDED_LIMIT(
            f"joint {joint.name}",
            "has one limit; some readers of PhysX then limit neither side",
            hint="give the joint both limits",
        )
    worst = max(abs(v) for v in (lower, upper) if abs(v) != float("inf")) if any(stated) else 0.0
    if is_angular(joint) and worst > MAX_ANGLE_DEG + 1e-3:
        yield LIMIT_CLAMPED(
            f"joint {joint.name}",
            f"limit {worst:.6g}° lies beyond ±360°: PhysX 0.7 keeps it, though its documentation "
            "says that it clamps",
            hint="for other versions of PhysX make the joint continuous, or narrow its limits",
            data={"limit_deg": worst},
        )


def _actuators(control: Control) -> Iterator[Finding]:
    for model in ("ideal_pd", "dc_motor", "motor", "general"):
        joints = [a.joint for a in control.actuators if a.model == model]
        if joints:
            yield EXPLICIT_ACTUATOR(
                "robot",
                f"`{model}` computes efforts outside of the simulator: the drives of "
                f"{len(joints)} joints have gains 0 and the effort limit",
                hint="PhysX needs the controller of the generated Isaac Lab module; Newton builds "
                "one from the `NewtonActuator` prims below `Actuators`",
                data={"model": model, "joints": tuple(joints)},
            )
    rubbed = [a.joint for a in control.actuators if a.friction > 0.0]
    if rubbed:
        yield FRICTION_UNIT(
            "robot",
            f"dry friction of {len(rubbed)} joints is written as an effort; Isaac Sim 4.5 "
            "and older read `physxJoint:jointFriction` as a coefficient",
            hint="set `friction=0` in the actuator configuration there",
            data={"joints": tuple(rubbed)},
        )


def _springs(control: Control) -> Iterator[Finding]:
    for joint, why in no_drives(control).items():
        yield SPRING(
            f"joint {joint}",
            f"its spring is not in the USD: a spring can be the drive of its joint, but {why}",
            hint="leave out the targets `usd` and `isaaclab`, or accept it by `rules: {usd.spring: "
            "{severity: warning, because: ...}}` and add the spring in the simulator",
        )


def _motion(control: Control) -> Iterator[Finding]:
    weightless = whole_gravity(control.mjcf_only)
    if weightless:
        names = ", ".join(f"`{name}`" for name in sorted(weightless)[:4])
        yield GRAVITY(
            "robot",
            f"{len(weightless)} bodies have no weight in PhysX (`disableGravity`): {names}",
            data={"bodies": tuple(sorted(weightless))},
        )
    for what, names_of in lost_in_usd(control.mjcf_only).items():
        listed = ", ".join(f"`{name}`" for name in names_of[:4] if name)
        yield MOTION(
            "robot",
            f"{what} are not in the USD, which moves otherwise: {listed or 'the whole robot'}",
            hint="leave out the targets `usd` and `isaaclab`, or accept it by `rules: {usd.motion: "
            "{severity: warning, because: ...}}`",
            data={"what": what, "names": names_of},
        )


def _contact(control: Control) -> Iterator[Finding]:
    """One finding for each kind of MuJoCo's contact values that PhysX does not hold."""
    surfaces = (control.contact, *(surface for _, surface in control.contacts))
    for name, why in _NOT_IN_PHYSX.items():
        unusual = [_beyond_usual(surface, name) for surface in surfaces]
        values = sorted({repr(value) for value in unusual if value is not None})
        if values:
            yield CONTACT(
                "robot",
                f"PhysX does not apply {name} {', '.join(values[:4])}: {why}",
                hint="compare the standing height in the alignment form",
                data={"value": name, "surfaces": len(values)},
            )


def _beyond_usual(surface: Contact, name: str) -> object:
    """The value where it is not MuJoCo's default, else None."""
    if name == _ROLLING:
        return surface.friction[1:] if surface.condim > 3 else None
    value: object = getattr(surface, name)
    return value if value != getattr(Contact(), name) else None


def _keyframes(control: Control) -> Iterator[Finding]:
    initial = control.initial_keyframe
    lost = tuple(key.name for key in control.keyframes if key is not initial)
    if initial is not None and lost:
        yield KEYFRAMES(
            "robot",
            f"USD has no keyframes: {', '.join(lost)} left out; drives aim at `{initial.name}`",
            hint="take them from the MJCF or the generated Isaac Lab module",
            data={"keyframes": lost},
        )


def _starts(tree: Tree, control: Control) -> Iterator[Finding]:
    if control.initial_keyframe is not None:
        return
    for name, position in initial_pose(tree, control).joints:
        if position != 0.0:
            yield START_OUTSIDE(
                f"joint {name}",
                f"0 is outside of its limits: it starts at {position:.4g} in PhysX, which "
                "blows up outside of them",
                hint="add a keyframe `home`",
                data={"position": position},
            )


def _parallel_axes(tree: Tree) -> Iterator[Finding]:
    plain = [j.name for j in tree.moving_joints if max(map(abs, j.axis)) >= 1.0 - 1e-12]
    if plain:
        yield PARALLEL_AXIS(
            "robot",
            f"the axes of {len(plain)} joints are exactly parallel to axes of their bodies",
            hint="harmless; should a runtime stumble over it, `edits: perturb_axis` turns them",
            data={"joints": tuple(plain)},
        )
