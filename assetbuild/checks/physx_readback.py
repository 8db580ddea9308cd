"""Loaded into real PhysX, is it still the robot? And does it keep its numbers for five seconds?

Tolerance. A number passes three float32 (in the USD, in PhysX, at its interface) and two changes
of unit, each within 6e-8 of its size: 4e-7. Tensors pass a float32 quaternion: 2e-6, and so does
where a fixed root stands. What PhysX does not hold is compared in the USD.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits
from assetbuild.errors import StepError
from assetbuild.facts.compare import Precision, differences, equality_findings
from assetbuild.facts.reference import inertial_facts, pose_value
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Joint, Tree
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators import mujoco, mujoco_trials, physx
from assetbuild.simulators.physx_causes import cause_of, overlap_hint

PRECISION = Precision(
    {"number": 4e-7, "vector": 4e-7, "direction": 2e-6, "pose": 2e-6, "tensor": 2e-6},
    {("body", "centre of mass"): 1e-6},
)
SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""xx, yy, zz, xy, xz, yz of a matrix."""
NO_CAUSE = (
    "no bodies lie in one another where it starts: a tiny inertia? a start outside of limits?"
)
FULL_TURN = 2.0 * math.pi
ROUNDED_UP = math.radians(1e-3)
"""PhysX holds 6.28319, which many write for 2π; `usd.limit_clamped` starts beyond."""

START = Rule(
    "physx.start",
    "error",
    "a joint starts outside its limits, where PhysX goes to NaN",
    "correct the initial keyframe: `home`, else the first",
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
        yield from differing(held, tree, shapes, control)
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


# --- what it holds -------------------------------------------------------------------------


def held_table(held: physx.Held) -> Table:
    """What PhysX holds, as facts."""
    book = Writer()
    book.put("robot", "", {
        "base": "fixed" if held.fixed_base else "floating",
        "physx:dof": float(held.dof),
        "physx:shapes": float(held.shapes),
    })  # fmt: skip
    if held.fixed_base and held.X_world_root is not None:
        book.put("robot", "", {"base pose": pose_value(held.X_world_root)})
    for name, link in held.links.items():
        book.put("body", name, {
            "physx:held": True,
            "mass": link.mass_kg,
            "centre of mass": tuple(map(float, link.com_m)),
            "inertia": tuple(float(link.inertia[i, j]) for i, j in SIX),
        })  # fmt: skip
    for name, joint in held.joints.items():
        driven = joint.drive != 0.0
        book.put("joint", name, {
            "physx:held": True,
            "lower": joint.lower,
            "upper": joint.upper,
            "kp": joint.kp,
            "kd": joint.kd,
            # Where there is no drive there is no effort to limit.
            "effort": joint.effort if driven else None,
            "velocity": joint.velocity,
            "armature": joint.armature,
            "friction": joint.static_friction,
            "damping": joint.viscous_friction,
            "physx:dynamic friction": joint.dynamic_friction,
            "physx:drive": joint.drive,
        })  # fmt: skip
    return book.table()


def expected_table(tree: Tree, shapes: Shapes, control: Control) -> Table:
    """What PhysX must hold. `usd.mass_missing` says what it does with a body without mass."""
    book = Writer()
    book.put("robot", "", {
        "base": tree.base,
        "physx:dof": float(len(tree.moving_joints)),
        "physx:shapes": float(len(shapes.of("collision"))),
    })  # fmt: skip
    if tree.base == "fixed":
        book.put("robot", "", {"base pose": pose_value(tree.X_world_root)})
    for body in tree.bodies:
        facts = {} if body.is_massless else inertial_facts(body.inertial)
        book.put("body", body.name, {"physx:held": True, **facts})
    for joint in tree.moving_joints:
        book.put("joint", joint.name, expected_joint(joint, control.by_joint.get(joint.name)))
    return book.table()


def differing(held: physx.Held, tree: Tree, shapes: Shapes, control: Control) -> Iterator[Finding]:
    """Everything that PhysX holds against the robot."""
    if held.articulations != 1:
        yield physx.ARTICULATION("robot", f"PhysX holds {held.articulations} articulations")
    for name in held.loose:
        yield physx.LOOSE_BODY(f"link {name}", "PhysX holds it outside of the articulation")
    massless = {body.name for body in tree.bodies if body.is_massless}
    found = held_table(held).only(
        lambda key: key.kind != "body" or key.name not in massless or key.is_foreign
    )
    known = {(key.kind, key.name) for key in found.facts}
    expected = expected_table(tree, shapes, control).only(
        lambda key: (key.kind, key.name) in known or key.quantity == "physx:held"
    )
    yield from equality_findings(differences(expected, found, PRECISION), "physx", "PhysX", {})
    for name, joint in held.joints.items():
        low = -math.inf if joint.lower is None else joint.lower
        high = math.inf if joint.upper is None else joint.upper
        if not low - 1e-5 <= joint.position <= high + 1e-5:
            yield START(
                f"joint {name}",
                f"starts at {joint.position:.5g} in PhysX, outside of {low:.5g}..{high:.5g}",
                data={"position": joint.position},
            )


def _within_a_turn(limit: float | None) -> float | None:
    """rad; a limit of 2π that was rounded up stays as it is."""
    if limit is None or abs(limit) <= FULL_TURN + ROUNDED_UP:
        return limit
    return math.copysign(FULL_TURN, limit)


def expected_joint(joint: Joint, actuator: Actuator | None) -> dict[str, Value]:
    """What PhysX must hold of a moving joint."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous":
        lower = upper = None
    elif joint.kind == "revolute":  # PhysX clamps there; `usd.limit_clamped` says so
        lower, upper = _within_a_turn(lower), _within_a_turn(upper)
    inside = actuator is not None and actuator.model in ("pd", "velocity")
    driven = actuator is not None and actuator.model != "passive"
    friction = actuator.friction if actuator else joint.friction or 0.0
    return {
        "physx:held": True,
        "lower": lower,
        "upper": upper,
        "kp": actuator.kp if actuator and actuator.model == "pd" else 0.0,
        "kd": actuator.kd if actuator and inside else 0.0,
        "effort": actuator.effort if actuator and driven else None,
        "velocity": actuator.velocity if actuator else joint.limits.velocity,
        "armature": actuator.armature if actuator else 0.0,
        "friction": friction,
        "damping": actuator.damping if actuator else joint.damping or 0.0,
        "physx:dynamic friction": friction,
        "physx:drive": 1.0 if driven else 0.0,
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
