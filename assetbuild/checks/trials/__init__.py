"""Small experiments in MuJoCo: do the drives answer, does energy stay, is the timestep fine, which
bodies run into each other, is the robot balanced, does it come to rest after a drop, does it bear
what an untrained policy asks of it?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

from pydantic import Field

from assetbuild.checks.trials.shaken import shaken
from assetbuild.checks.trials.start import START_M, overlapping, starting
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import RecipeView, write_figures
from assetbuild.quantities import Positive, Real
from assetbuild.robot.action import Action
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import ArenaFullError, floors, turning
from assetbuild.simulators.mujoco import motion as mujoco_motion
from assetbuild.simulators.mujoco import trials as mujoco_trials
from assetbuild.simulators.mujoco.stand import Gains, outcome_figures, stand
from assetbuild.simulators.mujoco.trials import FINER, Settled

EXTERNAL = frozenset({"ideal_pd", "dc_motor"})
"""Models whose PD law runs outside of the simulator: here it is put inside."""
SHOWN_PAIRS = 40
LARGEST_DOFS = 300
"""A file of anybody may hold a cloth; steps of it take minutes."""
ALONE_S, ALONE_FALL = 2.0, 0.5
"""How long nobody touches the robot, and what counts as a fall then: as in the check `stand`."""
ON_POINTS = (
    "it stands on points or edges that span no area: only a controller that balances it keeps it "
    "up, or wider feet"
)

LOAD = Rule("trials.load", "error", "the scene does not load", "see `mjcf.load`")
LARGE = Rule(
    "trials.large",
    "info",
    "there are more than 300 degrees of freedom, so `validate` simulates nothing",
    "remove the cloth or the other robots",
)
MEMORY = Rule(
    "trials.memory",
    "error",
    "MuJoCo's own memory does not hold the contacts of the robot: it goes on without any "
    "constraint, or stops",
    "`collision.exclude.pairs` of what always touches (`trials.overlap`), fewer collision shapes, "
    "or more memory (`<size memory>` in the source's MJCF)",
)
DEAD = Rule(
    "trials.dead",
    ("error", "warning"),
    "a joint hardly moves when its drive is commanded (a warning where an MJCF's own drive does "
    "that in the source, too)",
    "is kp in other units, the effort limit too small, or kd far too large?",
)
ENERGY = Rule(
    "trials.energy",
    "warning",
    "free motion does not conserve energy at this timestep",
    "a smaller timestep; look for tiny inertias far from the others",
)
TIMESTEP = Rule(
    "trials.timestep",
    "warning",
    "the drives move differently at a quarter of the timestep",
    "a smaller `simulation.timestep`, a smaller kp, or the real armature",
)
BALANCE = Rule(
    "trials.balance",
    "warning",
    "at home the centre of mass is not above the feet",
    "move the feet of the keyframe under the centre of mass",
)
UNSTABLE = Rule(
    "trials.unstable",
    "error",
    "after a drop the simulation went to infinity",
    "a smaller timestep; look for tiny inertias and overlapping shapes",
)
RESTLESS = Rule(
    "trials.rest",
    ("warning", "info"),
    "two seconds after a drop the joints still move",
    "more kd; a smaller timestep or the rotors' armature, where the finding says so",
)
SUNK = Rule(
    "trials.sunk",
    ("warning", "info"),
    "two seconds after a drop a contact is too deep",
    "adjust the contact softness or the timestep",
)
DRIFT = Rule(
    "trials.drift",
    ("warning", "info"),
    "the settled base drifts",
    "a pose that stands by itself, more kd or kp; a smaller timestep, where the finding says so",
)
FALL = Rule(
    "trials.fall",
    "warning",
    "left alone under its drives for two seconds the robot falls, or a drive of a fixed robot does "
    "not hold its joint",
    "raise kp, move the feet under the centre of mass; `validate: {stand: {}}` makes it an error",
)


class _Row(NamedTuple):
    rule: Rule
    value: float
    limit: float
    what: str
    unit: str


def _as_consequence(finding: Finding) -> Finding:
    """What a fall explains, as information."""
    explained = finding.rule in (RESTLESS.id, SUNK.id, DRIFT.id)
    return replace(finding, severity="info") if explained else finding


class Trials(mujoco.InMujoco):
    """Findings `trials.<what>`; one compilation of `mjcf/scene.xml` serves all experiments."""

    usual_s = 0.6
    reads = ("control.json",)

    section = "validate.trials"
    about = (
        "small experiments in MuJoCo: drives, energy, timestep, self-collision, "
        "balance, settling; null = do not run them"
    )
    told: ClassVar[Mapping[str, str]] = {"action": "mjlab.action"}

    action: Action = Action()
    """What an untrained policy asks for, as mjlab's module has it."""

    drift: Positive = Field(
        0.01, description="m: how far a settled base may wander in 1000 steps, warning"
    )
    drop: Positive = Field(0.05, description="m: height that the robot is dropped from")
    speed: Positive = Field(
        0.05, description="rad/s or m/s: fastest joint after two seconds on the floor, warning"
    )
    penetration: Positive = Field(
        0.005, description="m: deepest contact after two seconds on the floor, warning"
    )
    support: Real = Field(
        0.0, description="m: least distance of the centre of mass inside the feet, warning"
    )
    energy: Positive = Field(
        0.05, description="relative change of energy in 1 s of free motion, warning"
    )
    timestep: Positive = Field(
        0.02, description="rad or m: difference to a quarter of the timestep, warning"
    )
    dead: Positive = Field(
        0.01, description="rad or m: a joint that moves less when its drive is commanded, error"
    )
    poses: int = Field(200, ge=1, le=100_000, description="random poses for self-collision")
    always: Positive = Field(
        0.9, description="share of random poses in which a pair touches that should be excluded"
    )
    alone: bool = True
    """Whether to leave the robot alone under its drives: not where `validate.stand` does."""
    inherited: bool = False
    """Whether the drives are those of the source's MJCF, whose forces `mjcf_source` compares."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """The check `stand` sees the robot fall where the recipe asks for it."""
        found = super().values(recipe)
        if found is None:
            return None
        inherited = recipe.value("source.mjcf") is not None and not recipe.value("actuators")
        alone = recipe.value("validate.stand") is None
        return found | {"alone": alone, "inherited": inherited}

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and `mjcf/scene.xml`."""
        control = RobotFiles(files.inputs).control
        try:
            model = mujoco.load(files.inputs / "mjcf" / "scene.xml", visuals=False).model
        except StepError as error:
            write_figures(files, {"skipped": error.message})
            yield LOAD("robot", f"nothing to try: {error.message}")
            return
        outside = {a.joint: a for a in control.actuators if a.model in EXTERNAL}
        mujoco_motion.drive_as(model, outside)
        torques = {
            a.joint: Gains(a.kp, a.kd, a.effort) for a in control.actuators if a.model == "motor"
        }
        figures: dict[str, object] = {}
        yield from self.examine(model, figures, torques)
        write_figures(files, figures, self._limits())

    def _limits(self) -> dict[str, float]:
        """Name of a figure -> what it is compared with."""
        return {
            **dict.fromkeys(("asked", "moved"), self.dead),
            "energy_drift": self.energy,
            "timestep_error": self.timestep,
            "share_of_poses": self.always,
            "depth_m": START_M,
            "fastest_joint": self.speed,
            "deepest_contact_m": self.penetration,
            **dict.fromkeys(("drift_m", "support_margin_m"), self.drift),
            **dict.fromkeys(("height_before_m", "height_after_m"), self.drop),
        }

    def examine(
        self,
        model: mujoco.Model,
        figures: dict[str, object],
        torques: Mapping[str, Gains] | None = None,
    ) -> Iterator[Finding]:
        """All experiments on a compiled model, our own or foreign; those on the floor need one.

        torques: PD laws by joint, for plain motors that a controller outside commands.
        """
        if int(model.nv) > LARGEST_DOFS:
            message = f"{model.nv} degrees of freedom, more than {LARGEST_DOFS}: nothing is tried"
            yield LARGE("robot", message)
            return
        yield from self._drives(model, figures)
        yield from self._numerics(model, figures)
        try:
            yield from self._touching(model, figures, torques or {})
        except ArenaFullError as error:
            yield MEMORY("robot", error.message)

    def _touching(
        self, model: mujoco.Model, figures: dict[str, object], torques: Mapping[str, Gains]
    ) -> Iterator[Finding]:
        """Experiments with contacts; ArenaFullError where MuJoCo's memory does not hold them."""
        yield from self._collisions(model, figures)
        yield from starting(model, figures)
        dropped: list[Finding] = []
        if model.nkey and mujoco_trials.stands_free(model):
            dropped += self._floor(model, figures)
        alone: list[Finding] = []
        if self.alone and model.nkey and floors(model):
            alone += self._left_alone(model, figures, torques)
        falls = any(finding.rule == FALL.id for finding in alone)
        # A robot that falls by itself also lies, rolls and moves after a drop.
        yield from ((_as_consequence(f) if falls else f) for f in dropped)
        yield from alone
        yield from shaken(model, self.action, figures)

    def dangers(self, model: mujoco.Model) -> Iterator[Finding]:
        """Only what can be an error wherever the robot stands: for a recipe being proposed."""
        figures: dict[str, object] = {}
        yield from self._drives(model, figures)
        yield from shaken(model, self.action, figures)

    def _drives(self, model: mujoco.Model, figures: dict[str, object]) -> Iterator[Finding]:
        answers = mujoco_trials.answers(model)
        figures["drives"] = [
            {"joint": joint, "asked": a.asked, "moved": a.moved} for joint, a in answers.items()
        ]
        for joint, answer in answers.items():
            if answer.moved < min(self.dead, 0.2 * answer.asked):
                own = ", as in the source's own MJCF" if self.inherited else ""
                yield DEAD(
                    f"actuator {joint}",
                    f"told to swing by {answer.asked:.3g}, the joint moved by {answer.moved:.3g}"
                    f"{own}",
                    severity="warning" if self.inherited else "error",
                    data={"asked": answer.asked, "moved": answer.moved},
                )

    def _numerics(self, model: mujoco.Model, figures: dict[str, object]) -> Iterator[Finding]:
        drift = mujoco_trials.energy_drift(model)
        figures["energy_drift"] = drift if math.isfinite(drift) else "unstable"
        if not drift <= self.energy:
            told = f"changed by {drift:.2%}" if math.isfinite(drift) else "went to infinity"
            yield ENERGY(
                "robot",
                f"in one second of free motion the energy {told}",
                data={"limit": self.energy},
            )
        if not model.nu:
            return  # a free swing is judged by its energy; nothing holds it to a path
        errors = mujoco_trials.timestep_error(model)
        worst = max(errors, key=lambda joint: errors[joint], default=None)
        figures["timestep_error"] = {
            joint: error if math.isfinite(error) else "unstable" for joint, error in errors.items()
        }
        if worst is not None and not errors[worst] <= self.timestep:
            yield TIMESTEP(
                f"actuator {worst}",
                f"moves otherwise at a quarter of the timestep: by {errors[worst]:.3g} rad or m",
                data={"timestep_s": float(model.opt.timestep), "limit": self.timestep},
            )

    def _collisions(self, model: mujoco.Model, figures: dict[str, object]) -> Iterator[Finding]:
        pairs = mujoco_trials.touching_pairs(model, self.poses)
        figures["self_collision"] = [
            {"a": a, "b": b, "share_of_poses": share}
            for (a, b), share in list(pairs.items())[:SHOWN_PAIRS]
        ]
        yield from overlapping(model, pairs, self.poses, self.always)

    def _floor(self, model: mujoco.Model, figures: dict[str, object]) -> Iterator[Finding]:
        under = mujoco_trials.support(model)
        figures["support_margin_m"], figures["support_points"] = under.margin_m, under.points
        if under.margin_m is not None and under.margin_m < self.support:
            side = "outside of" if under.margin_m < 0.0 else "inside"
            yield BALANCE(
                "robot",
                f"at home the centre of mass is {1e3 * abs(under.margin_m):.3g} mm {side} its feet",
                data={"margin_m": under.margin_m, "limit_m": self.support},
            )
        settled = mujoco_trials.settle(model, self.drop)
        figures["settle"] = _settled_figures(settled)
        if not settled.finite:
            message = f"dropped from {self.drop:g} m, the simulation went to infinity"
            yield UNSTABLE("robot", message, data={"drop_m": self.drop})
            return
        restless = [row for row in self._rows(settled) if row.value > row.limit]
        if restless:
            finer = mujoco_trials.settle(model, self.drop, finer=FINER)
            figures["settle_at_a_finer_timestep"] = _settled_figures(finer)
            yield from self._judge_restless(restless, finer)

    def _rows(self, settled: Settled) -> tuple[_Row, ...]:
        return (
            _Row(RESTLESS, settled.speed, self.speed, "its fastest joint moves at", "rad/s"),
            _Row(SUNK, settled.penetration_m, self.penetration, "a contact is deep by", "m"),
            _Row(DRIFT, settled.drift_m, self.drift, "in 1000 steps its base wandered", "m"),
        )

    def _judge_restless(self, restless: Sequence[_Row], finer: Settled) -> Iterator[Finding]:
        """finer: the same at a finer timestep."""
        calm = {row.rule for row in self._rows(finer) if row.value <= row.limit}
        for row in restless:
            hasty = finer.finite and row.rule in calm
            yield row.rule(
                "robot",
                f"two seconds after a drop from {self.drop:g} m {row.what} {row.value:.3g} "
                f"{row.unit}" + (f", at 1/{FINER} of the timestep not" if hasty else ""),
                hint="a smaller `simulation.timestep`, less kd, or the rotors' real armature"
                if hasty
                else "more kd, more kp, or a pose that stands by itself",
                data={"value": row.value, "limit": row.limit, "timestep": hasty},
            )

    def _left_alone(
        self, model: mujoco.Model, figures: dict[str, object], torques: Mapping[str, Gains]
    ) -> Iterator[Finding]:
        """Nobody touches the robot at its first keyframe; its drives hold what they can."""
        try:
            stood = stand(model, 0, ALONE_S, torques)
        except ArenaFullError:
            raise
        except StepError:  # a shape whose lowest point is not known
            return
        did = outcome_figures(stood, ALONE_FALL)
        figures["untouched"] = did
        if did["outcome"] == "falls" and turning(model):
            joint, _ = stood.worst_held
            yield FALL(
                "robot" if stood.floats else f"actuator {joint}",
                f"left alone it {did['sentence']}",
                hint=ON_POINTS
                if stood.floats and not mujoco_trials.support(model).is_area
                else "raise kp, check the effort limits and the pose; "
                "`validate: {stand: {}}` makes it an error",
                data={"tilt_rad": stood.tilt_rad, "sag_m": stood.sag_m},
            )


def _settled_figures(settled: Settled) -> dict[str, object]:
    """None for what is not finite, which JSON cannot say."""
    known = settled.finite
    return {
        "finite": known,
        "fastest_joint": settled.speed if known else None,
        "deepest_contact_m": settled.penetration_m if known else None,
        "drift_m": settled.drift_m if known else None,
    }
