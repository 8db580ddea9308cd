"""What the gains of the actuator table really do, joint by joint at the first pose.

Nominal numbers mislead: mjlab's Go1 is tuned for 10 Hz on the rotor alone, and the joint with all
that it carries swings at 5. Here every figure is of the joint as it stands at `home`:
I = 1 / (M^-1)_ii with armature; kd and passive damping summed, as they act.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Data, Finding, Rule
from assetbuild.plugin_types import Check, write_figures
from assetbuild.recipe_types import Positive
from assetbuild.robot.closure import felt_inertia
from assetbuild.robot.dynamics import dynamics, holding_torques, soles
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator

EXPLICIT = frozenset({"ideal_pd", "dc_motor"})
"""Models whose gains a controller applies once a step, instead of the integrator."""
SMALL_ERROR_RAD = 0.1
UNBALANCED = 0.05
"""Share of the weight that the soles cannot carry: above this the robot would not stand."""

TORQUE = Rule(
    "gains.torque",
    ("warning", "error"),
    "holding the pose needs more than 80 % of the effort limit (an error above 100 %)",
    "a pose with the feet under the hips, or check the effort limit",
)
SAG = Rule(
    "gains.sag",
    "warning",
    "the robot's own weight moves the joint off its target, by more than 0.25 rad",
    "raise kp",
)
SATURATED = Rule(
    "gains.saturated",
    "info",
    "0.1 rad of error already asks for more than the effort limit",
    "lower kp where a policy commands positions",
)
UNSTABLE = Rule(
    "gains.unstable",
    ("warning", "error"),
    "the drive diverges at this timestep (an error), or is within a factor of two of it",
    "lower the gains or the timestep, give the motor's `rotor_inertia`, or `model: pd`",
)
UNDERDAMPED = Rule(
    "gains.underdamped",
    "warning",
    "the joint rings: its damping ratio is below 0.1, with kd and damping summed, and dry friction "
    "as at a swing of 0.1 rad",
    "raise kd; a damping ratio of 0.5 to 2 suits most joints",
)
OVERDAMPED = Rule(
    "gains.overdamped",
    "warning",
    "the joint creeps: with kd and damping summed its damping ratio is above 3, and it lags its "
    "target by more than 0.15 s",
    "lower kd or damping, or raise kp; a damping ratio of 0.5 to 2 suits most joints",
)
DAMPED_TWICE = Rule(
    "gains.damped_twice",
    "info",
    "kd of the drive and damping of the joint are both set, and add up",
    "set one to 0",
)
INHERITED = Rule(
    "gains.inherited",
    "warning",
    "gains come from the source's MJCF",
    "state the gains that the robot will run with in `actuators`",
)


@dataclass(frozen=True)
class Effective:
    """One joint. inertia: kg m2 or kg; frequency: Hz; sag: rad or m; torques: N m or N.

    stiffness: kp dt^2 / I; margin: how many times stiffer before the simulation diverges.
    """

    inertia: float
    frequency_hz: float
    damping_ratio: float | None
    holding: float
    load: float | None
    sag: float | None
    stiffness: float
    margin: float | None
    per_tenth_rad: float


class Gains(Check):
    """Findings `gains.<what>`; figures: `Effective` by joint. Reads no simulator."""

    shares = True
    reads = ("tree.json", "shapes.json", "control.json")

    section = "validate.gains"
    about = "where the rules `gains.*` draw the line"
    recipe_fields: ClassVar = {"integrator": "mjcf.integrator", "feet": "feet.links"}
    derived: ClassVar = {"inherited": lambda recipe: not recipe.value("actuators")}

    torque: Positive = Field(
        0.8, description="share of the effort limit that holding the pose may need, warning"
    )
    sag: Positive = Field(0.25, description="rad or m off the target by its own weight, warning")
    margin: Positive = Field(
        2.0, description="times stiffer before the drive diverges at this timestep, warning below"
    )
    damping_ratio: tuple[Positive, Positive] = Field(
        (0.1, 3.0), description="least, and most of a joint that lags, warning"
    )
    lag: Positive = Field(
        0.15,
        description="s that an overdamped joint may need for 63 % of a step, kd and damping over "
        "kp; warning",
    )
    integrator: str = "implicitfast"
    feet: str | None = None
    """Pattern of the source links that stand on the ground; None: the lowest shapes."""
    inherited: bool = False
    """The recipe has no actuator table: any gains are the source's own."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot without its meshes."""
        stored = RobotFiles(files.inputs)
        tree, control = stored.tree, stored.control
        start = initial_pose(tree, control)
        home, armature = dict(start.joints), {a.joint: a.armature for a in control.actuators}
        gravity, timestep = control.simulation.gravity, control.simulation.timestep
        robot = dynamics(tree, home, armature, gravity, tree.root_pose(start))
        ground = soles(tree, stored.shapes, robot, self.feet)
        torque, left_over = holding_torques(robot, ground)
        if left_over > UNBALANCED and tree.base == "floating":
            torque = {}  # it would not stand, so no joint can be said to hold anything
        closed = bool(control.loops) and not any(joint.kind == "ball" for joint in tree.joints)
        inertia = felt_inertia(control.loops if closed else (), robot)
        joints: dict[str, Effective] = {}
        for name in robot.joints:
            actuator = control.by_joint.get(name)
            if actuator is None or actuator.model not in ("pd", *EXPLICIT):
                continue
            if math.isfinite(inertia[name]):  # else its loops lock it: `loop.locked`
                joints[name] = self._effective(actuator, inertia[name], torque.get(name), timestep)
        figures: dict[str, object] = {
            "keyframe": start.name or None,
            "soles": len(ground),
            "unbalanced": left_over,
            "joints": {name: asdict(one) for name, one in joints.items()},
        }
        limits = {"unbalanced": UNBALANCED, "load": self.torque, "sag": self.sag, "holding": 0.1}
        write_figures(files, figures, limits)
        for name, one in joints.items():
            actuator, slides = control.by_joint[name], tree.by_joint[name].kind == "prismatic"
            yield from self._judge_strength(actuator, one, timestep, slides=slides)
            yield from self._judge_damping(actuator, one)
        if self.inherited and joints:
            drives = "1 drive keeps" if len(joints) == 1 else f"{len(joints)} drives keep"
            hertz = [one.frequency_hz for one in joints.values()]
            span = " to ".join(dict.fromkeys(f"{end(hertz):.3g}" for end in (min, max)))
            text = f"{drives} the gains of the source's MJCF ({span} Hz at this pose): such files "
            text += "are often tuned for a viewer"
            yield INHERITED("robot", text, data={"joints": len(joints)})

    def _effective(
        self, actuator: Actuator, inertia: float, torque: float | None, dt: float
    ) -> Effective:
        """The drive at its joint. Its margin says how much kp and kd may grow before it diverges.

        Semi-implicit Euler on x'' = -(kp x + kd v) / I with a = kp dt^2/I, b = kd dt/I: the
        amplification matrix has trace 2 - a - b and determinant 1 - b where the damping is
        explicit, so it is stable for a + 2 b < 4 (Jury); where it is implicit, trace
        (2 - a + b) / (1 + b) and determinant 1 / (1 + b): stable for a < 4 + 2 b. With both kinds,
        v' = ((1 - b) v - a x / dt) / (1 + c): a + 2 b < 4 + 2 c.
        """
        kp, damping, held = actuator.kp, actuator.kd + actuator.damping, abs(torque or 0.0)
        inside = actuator.model not in EXPLICIT and self.integrator.startswith("implicit")
        a, b = kp * dt * dt / inertia, (0.0 if inside else actuator.kd) * dt / inertia
        c = (damping if inside else actuator.damping) * dt / inertia
        bounded = self.integrator != "RK4" and bool(a or b)
        return Effective(
            inertia=inertia,
            frequency_hz=math.sqrt(kp / inertia) / (2 * math.pi),
            damping_ratio=damping / (2 * math.sqrt(kp * inertia)) if kp else None,
            holding=held,
            load=held / actuator.effort if actuator.effort else None,
            sag=held / kp if kp else None,
            stiffness=a,
            margin=(4.0 + 2.0 * c) / (a + 2.0 * b) if bounded else None,
            per_tenth_rad=kp * SMALL_ERROR_RAD,
        )

    def _judge_strength(
        self, actuator: Actuator, one: Effective, timestep: float, *, slides: bool
    ) -> Iterator[Finding]:
        subject = f"actuator {actuator.joint}"
        way, unit = ("m", "N") if slides else ("rad", "N m")
        if one.load is not None and one.load > self.torque:
            cannot = one.load > 1.0
            yield TORQUE(
                subject,
                f"{'cannot hold' if cannot else 'hardly holds'} its pose: {one.holding:.3g} of "
                f"{actuator.effort:g} {unit}",
                severity="error" if cannot else "warning",
                data={"holding": one.holding, "load": one.load},
            )
        if one.sag is not None and one.sag > self.sag:
            yield SAG(
                subject,
                f"gives way by {one.sag:.3g} {way} under the robot's weight at kp "
                f"{actuator.kp:.3g}",
                data={"sag": one.sag, "limit": self.sag},
            )
        if actuator.effort is not None and one.per_tenth_rad > actuator.effort:
            most = actuator.effort / actuator.kp
            yield SATURATED(
                subject,
                f"saturates at {most:.3g} {way} of error: it acts as a switch rather than a spring",
                data={"error_at_limit": most},
            )
        if one.margin is not None and one.margin < self.margin:
            diverges = one.margin <= 1.0
            yield UNSTABLE(
                subject,
                f"{'diverges' if diverges else 'is close to diverging'} at a timestep of "
                f"{timestep:g} s: {one.margin:.3g} times its gains are the limit",
                severity="error" if diverges else "warning",
                data={"margin": one.margin, "kp_dt2_over_I": one.stiffness},
            )

    def _judge_damping(self, actuator: Actuator, one: Effective) -> Iterator[Finding]:
        """Far above a ratio of 1, a step is followed as exp(-t kp / damping): a light joint that is
        damped so follows in no time all the same. Dry friction F takes 4 F A from a swing of A, as
        much as a damping ratio of 2 F / (pi kp A) does.
        """
        subject, ratio = f"actuator {actuator.joint}", one.damping_ratio
        least, most = self.damping_ratio
        kp, kd, damping = actuator.kp, actuator.kd, actuator.kd + actuator.damping
        data: Data = {"damping_ratio": ratio, "frequency_hz": one.frequency_hz}
        dry = 2.0 * actuator.friction / (math.pi * one.per_tenth_rad) if kp else 0.0
        if ratio is not None and ratio + dry < least:
            message = f"damping ratio {ratio:.3g} at {one.frequency_hz:.3g} Hz: it rings"
            yield UNDERDAMPED(subject, message, data=data)
        if ratio is not None and ratio > most and damping > self.lag * kp:
            yield OVERDAMPED(
                subject,
                f"damping ratio {ratio:.3g}: it creeps to its target, with a time constant of "
                f"{damping / kp:.3g} s (damping {damping:.3g} over kp {kp:.3g})",
                data={**data, "lag_s": damping / kp},
            )
        if kd and actuator.damping > 0.2 * kd:
            message = f"the drive's kd {kd:.3g} and the joint's damping {actuator.damping:.3g}"
            data = {"kd": kd, "damping": actuator.damping}
            yield DAMPED_TWICE(subject, f"{message} add up", data=data)
