"""What USD, or the runtimes that read it, cannot hold of this robot."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import lost_in_usd, no_drives, whole_gravity
from assetbuild.robot.model import Contact, Control, Joint, Tree
from assetbuild.simulators.usd_options import UsdOptions

START_OUTSIDE = Rule(
    "usd.start",
    "info",
    "0 is outside the limits of a joint and there is no keyframe: the joint starts at the nearest "
    "limit",
    "add a keyframe `home`",
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
    """Findings for all that is missing or read differently."""
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
    yield from _starts(tree, control)


def _limits(joint: Joint) -> Iterator[Finding]:
    stated = (joint.limits.lower is not None, joint.limits.upper is not None)
    if joint.kind != "continuous" and any(stated) and not all(stated):
        yield ONE_SIDED_LIMIT(
            f"joint {joint.name}",
            "has one limit; some readers of PhysX then limit neither side",
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


def _starts(tree: Tree, control: Control) -> Iterator[Finding]:
    if control.initial_keyframe is not None:
        return
    for name, position in initial_pose(tree, control).joints:
        if position != 0.0:
            yield START_OUTSIDE(
                f"joint {name}",
                f"0 is outside of its limits: it starts at {position:.4g} in PhysX, which "
                "blows up outside of them",
                data={"position": position},
            )
