"""Loaded into real PhysX, is it still the robot? And does it keep its numbers for five seconds?

Tolerance. A number passes three float32 (in the USD, in PhysX, at its interface) and two changes
of unit, each within 6e-8 of its size: 4e-7. Tensors pass a float32 quaternion: 2e-6 of the
largest moment, and so does where a fixed root stands. Other poses are `usd_equal`'s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Joint, Tree
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators import mujoco, mujoco_trials, physx
from assetbuild.simulators.physx_causes import cause_of, overlap_hint

NUMBER, TENSOR = 4e-7, 2e-6
NO_CAUSE = (
    "no bodies lie in one another where it starts: a tiny inertia? a start outside of limits?"
)
FULL_TURN = 2.0 * math.pi
ROUNDED_UP = math.radians(1e-3)
"""PhysX holds 6.28319, which many write for 2π; `usd.limit_clamped` starts beyond."""

ROOT = Rule(
    "physx.root",
    "error",
    "a fixed root is elsewhere in PhysX than in the robot",
    "report it: this is a bug",
)
BASE = Rule(
    "physx.base",
    "error",
    "a floating base is welded, or a fixed one is not",
    "report it: this is a bug",
)
COUNT = Rule(
    "physx.count.*",
    "error",
    "PhysX holds more or fewer bodies, coordinates or shapes",
    "report it: this is a bug",
)
MISSING_LINK = Rule(
    "physx.missing_link", "error", "PhysX does not hold a body", "report it: this is a bug"
)
MISSING_JOINT = Rule(
    "physx.missing_joint", "error", "PhysX does not hold a joint", "report it: this is a bug"
)
START = Rule(
    "physx.start",
    "error",
    "a joint starts outside its limits, where PhysX goes to NaN",
    "correct the initial keyframe: `home`, else the first",
)
DIFFERS = Rule(
    "physx.*",
    "error",
    "mass, com, inertia, limits, gains, effort, velocity, armature, friction, damping or drive "
    "differ from the robot's",
    "report it with both numbers: this is a bug",
)
DRIFT = Rule("physx.drift", "error", "a fixed base moved", "report it: this is a bug")


class PhysxReadback(Check):
    """`usd/<robot>.usda` in PhysX: bodies, joints, gains, limits; then 5 s on a floor."""

    version: ClassVar[str] = "5"
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    also: ClassVar[tuple[str, ...]] = ("mjcf",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "shapes.json", "control.json")
    requires: ClassVar[Mapping[str, str]] = physx.REQUIRES
    tools: ClassVar[tuple[str, ...]] = (*physx.TOOLS, "mujoco")
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = physx.PRELOAD
    limits: ClassVar[Limits] = Limits(wall_s=600.0, memory_mb=16384)

    engines: ClassVar[tuple[str, ...]] = ("physx",)

    robot: str
    """Name of the robot: the stem of the main file."""
    seconds: float = 5.0
    """How long it must keep its numbers on the floor."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: what PhysX holds, joint by joint, beside the robot's."""
        robot = RobotFiles(files.inputs)
        tree, shapes, control = robot.tree, robot.shapes, robot.control
        main = files.inputs / f"usd/{self.robot}.usda"
        experiments = _experiments(tree, control, self.seconds)
        outcomes = physx.perform(main, experiments)
        held = outcomes["load"].held
        if held is None:
            write_figures(files, {"loaded": False})
            yield physx.LOAD(
                "robot", f"PhysX does not load it: {outcomes['load'].failure or 'it holds nothing'}"
            )
            return
        book = Book()
        _compare(held, tree, shapes, control, book)
        alone, moved = outcomes["alone"], outcomes["floor"]
        write_figures(
            files,
            {
                "articulations": held.articulations,
                "bodies": len(held.links),
                "dof": held.dof,
                "shapes": held.shapes,
                "fixed_base": held.fixed_base,
                "mass_kg": _finite(sum(link.mass_kg for link in held.links.values())),
                "finite_alone": alone.finite,
                "finite_on_floor": moved.finite,
                "joints": {name: _shown(joint) for name, joint in held.joints.items()},
            },
        )
        yield from book.findings
        for experiment, where in zip(
            experiments[1:], ("as the asset starts, without a floor", "on a floor"), strict=True
        ):
            outcome = outcomes[experiment.name]
            yield from _judge_motion(tree, outcome, where)
            if not outcome.finite:
                cause = cause_of(main, experiment, tree, control)
                yield _not_finite(where, outcome, cause, self._overlaps(files.inputs))

    def _overlaps(self, inputs: Path) -> Mapping[tuple[str, str], float]:
        """Depth (m) by pair of bodies in the initial pose, as MuJoCo sees it, where it does."""
        path = inputs / "mjcf" / f"{self.robot}.xml"
        if not path.is_file():
            return {}
        try:
            return mujoco_trials.overlaps_at_home(mujoco.load(path, visuals=False).model)
        except StepError:  # `mjcf.load` says so
            return {}


def _experiments(tree: Tree, control: Control, seconds: float) -> tuple[physx.Experiment, ...]:
    gravity, dt = control.simulation.gravity, control.simulation.timestep
    plain = physx.Setting(dt, gravity)
    start = initial_pose(tree, control)
    at = physx.clear_of_floor(start.base)
    floor = physx.Setting(dt, gravity, at=at, floor_friction=control.contact.friction[0])
    steps = round(seconds / dt)
    on_floor = floor if tree.base == "floating" and start.name else plain
    return (
        physx.Experiment("load", plain),
        physx.Experiment("alone", plain, steps=round(0.2 / dt), every=10),
        physx.Experiment("floor", on_floor, steps=steps, every=10, start=dict(start.joints)),
    )


def _finite(value: float) -> float | None:
    """JSON has no NaN and no infinity."""
    return value if math.isfinite(value) else None


def _shown(joint: physx.HeldJoint) -> dict[str, float | None]:
    names = ("lower", "upper", "kp", "kd", "effort", "velocity", "armature", "static_friction")
    values = {name: getattr(joint, name) for name in names}
    return {name: None if v is None else _finite(v) for name, v in values.items()}


@dataclass
class Book:
    """Findings so far."""

    findings: list[Finding] = field(default_factory=list)

    def differ(self, rule: Rule, subject: str, message: str, **data: float) -> None:
        """Note one error."""
        finite = {key: value for key, value in data.items() if math.isfinite(value)}
        self.findings.append(rule(subject, message, data=finite))

    def number(
        self, kind: str, subject: str, what: str, found: float | None, expected: float | None
    ) -> None:
        """Compare within float32; None = unlimited."""
        if found is None and expected is None:
            return
        shown = f"{what} is {_text(found)} in PhysX, {_text(expected)} in the robot"
        if found is None or expected is None:
            self.differ(DIFFERS.named(kind), subject, shown)
        elif not abs(found - expected) <= NUMBER * abs(expected) + 1e-12:
            self.differ(DIFFERS.named(kind), subject, shown, found=found, expected=expected)


def _text(value: float | None) -> str:
    return "unlimited" if value is None else f"{value:.7g}"


def _compare(held: physx.Held, tree: Tree, shapes: Shapes, control: Control, book: Book) -> None:
    """Everything that PhysX holds against the robot."""
    if held.articulations != 1:
        book.differ(physx.ARTICULATION, "robot", f"PhysX holds {held.articulations} articulations")
    for name in held.loose:
        book.differ(physx.LOOSE_BODY, f"link {name}", "PhysX holds it outside of the articulation")
    if held.fixed_base != (tree.base == "fixed"):
        base = "fixed" if held.fixed_base else "floating"
        book.differ(BASE, "robot", f"its base is {base} in PhysX, {tree.base} in the robot")
    if tree.base == "fixed":
        _compare_root(held, tree, book)
    for kind, found, expected in (
        ("bodies", len(held.links), len(tree.bodies)),
        ("dof", held.dof, len(tree.moving_joints)),
        ("shapes", held.shapes, len(shapes.of("collision"))),
    ):
        if found != expected:
            book.differ(
                COUNT.named(kind),
                "robot",
                f"{found} {kind} in PhysX, the robot has {expected}",
                found=found,
                expected=expected,
            )
    _compare_links(held, tree, book)
    for joint in tree.moving_joints:
        theirs = held.joints.get(joint.name)
        if theirs is None:
            book.differ(MISSING_JOINT, f"joint {joint.name}", "PhysX holds no such joint")
        else:
            _compare_joint(theirs, joint, control.by_joint.get(joint.name), book)


def _compare_root(held: physx.Held, tree: Tree, book: Book) -> None:
    """Where a fixed root stands decides which way gravity pulls at each joint."""
    found, expected = held.X_world_root, tree.X_world_root
    if found is None:
        return  # nothing was loaded: `physx.articulation`
    moved = float(np.abs(np.subtract(found.xyz, expected.xyz)).max())
    turned = float(np.abs(found.rotation - expected.rotation).max())
    if not (moved <= NUMBER * max(1.0, *map(abs, expected.xyz)) and turned <= TENSOR):
        book.differ(
            ROOT,
            f"link {tree.root}",
            f"its fixed root stands {moved:.3g} m off in PhysX, turned by {turned:.3g} (the "
            "largest difference of a direction cosine)",
            moved_m=moved,
            turned=turned,
        )


def _compare_links(held: physx.Held, tree: Tree, book: Book) -> None:
    for body in tree.bodies:
        found, subject = held.links.get(body.name), f"link {body.name}"
        if found is None:
            book.differ(MISSING_LINK, subject, "PhysX holds no such body")
            continue
        if body.inertial is None or body.is_massless:
            continue  # `usd.mass_missing` says what PhysX does then
        book.number("mass", subject, "mass", found.mass_kg, body.inertial.mass_kg)
        off = float(np.abs(found.com_m - np.array(body.inertial.com_m)).max())
        if not off <= NUMBER * max(1.0, float(np.abs(body.inertial.com_m).max())):
            book.differ(
                DIFFERS.named("com"),
                subject,
                f"centre of mass is {off:.3g} m off in PhysX",
                off_m=off,
            )
        expected = matrix_of(body.inertial.inertia_com_kg_m2)
        error = float(np.abs(found.inertia - expected).max())
        largest = float(np.abs(expected).max())
        if not error <= TENSOR * largest:
            book.differ(
                DIFFERS.named("inertia"),
                subject,
                f"inertia differs by {error:.3g} kg m² in PhysX, of {largest:.3g}",
                error=error,
                largest=largest,
            )


def _compare_joint(
    found: physx.HeldJoint, joint: Joint, actuator: Actuator | None, book: Book
) -> None:
    subject = f"joint {joint.name}"
    expected = expected_joint(joint, actuator)
    low = -math.inf if found.lower is None else found.lower
    high = math.inf if found.upper is None else found.upper
    if not low - 1e-5 <= found.position <= high + 1e-5:
        book.differ(
            START,
            subject,
            f"starts at {found.position:.5g} in PhysX, outside of {low:.5g}..{high:.5g}",
            position=found.position,
        )
    for kind, names in (
        ("limits", ("lower", "upper")),
        ("gains", ("kp", "kd")),
        ("effort", ("effort",)),
        ("velocity", ("velocity",)),
        ("armature", ("armature",)),
        ("friction", ("static_friction", "dynamic_friction")),
        ("damping", ("viscous_friction",)),
        ("drive", ("drive",)),
    ):
        if kind == "effort" and not expected["drive"]:
            continue  # where there is no drive there is no effort to limit
        for name in names:
            book.number(kind, subject, name.replace("_", " "), getattr(found, name), expected[name])


def _within_a_turn(limit: float | None) -> float | None:
    """rad; a limit of 2π that was rounded up stays as it is."""
    if limit is None or abs(limit) <= FULL_TURN + ROUNDED_UP:
        return limit
    return math.copysign(FULL_TURN, limit)


def expected_joint(joint: Joint, actuator: Actuator | None) -> dict[str, float | None]:
    """What PhysX must hold, in the words of `physx.HeldJoint`."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous":
        lower = upper = None
    elif joint.kind == "revolute":  # PhysX clamps there; `usd.limit_clamped` says so
        lower, upper = _within_a_turn(lower), _within_a_turn(upper)
    inside = actuator is not None and actuator.model in ("pd", "velocity")
    driven = actuator is not None and actuator.model != "passive"
    friction = actuator.friction if actuator else joint.friction or 0.0
    return {
        "lower": lower,
        "upper": upper,
        "kp": actuator.kp if actuator and actuator.model == "pd" else 0.0,
        "kd": actuator.kd if actuator and inside else 0.0,
        "effort": actuator.effort if actuator and driven else None,
        "velocity": actuator.velocity if actuator else joint.limits.velocity,
        "armature": actuator.armature if actuator else 0.0,
        "static_friction": friction,
        "dynamic_friction": friction,
        "viscous_friction": actuator.damping if actuator else joint.damping or 0.0,
        "drive": 1.0 if driven else 0.0,
    }


def _not_finite(
    where: str,
    outcome: physx.Outcome,
    cause: tuple[str, str] | None,
    overlaps: Mapping[tuple[str, str], float],
) -> Finding:
    said, hint = cause or ("", overlap_hint(overlaps) or NO_CAUSE)
    return physx.NOT_FINITE(
        "robot",
        f"{where}: {outcome.failure or 'its state is not finite'}"
        f"{f'; it is {said}' if said else ''}",
        hint=hint,
        data={"overlaps": len(overlaps)},
    )


def _judge_motion(tree: Tree, outcome: physx.Outcome, where: str) -> Iterator[Finding]:
    if not outcome.finite:
        return  # `physx.finite`
    if outcome.motion is not None and tree.base == "fixed":
        drift = float(np.abs(outcome.motion.root - outcome.motion.root[0]).max())
        if drift > 0.0:
            yield DRIFT(
                "robot",
                f"{where}: its fixed base drifted by {drift:.3g} m",
                hint="the articulation root must be on the joint with the world",
                data={"drift_m": drift},
            )
