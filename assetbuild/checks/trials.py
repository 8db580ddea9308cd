"""Small experiments in MuJoCo: do the drives answer, does energy stay, is the timestep fine, which
bodies run into each other, is the robot balanced, does it come to rest after a drop, does it bear
what an untrained policy asks of it?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.recipe_types import Positive, Real
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.sections import Action
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import ArenaFullError, Model
from assetbuild.simulators.mujoco import trials as experiments
from assetbuild.simulators.mujoco.drives import servoed
from assetbuild.simulators.mujoco.pairs import explicit_pairs, touching_geoms
from assetbuild.simulators.mujoco.stand import outcome_figures, stand

Figures = dict[str, object]
SHOWN_PAIRS = 40
LARGEST_DOFS = 300
"""A file of anybody may hold a cloth; steps of it take minutes."""
ALONE_S, ALONE_FALL = 2.0, 0.5
"""How long nobody touches the robot, and what counts as a fall then: as in the check `stand`."""
ON_POINTS = "it stands on points or edges that span no area: it needs a controller, or wider feet"
WITHOUT_GAINS = "leave it to your controller, or state `kp` in the `actuators` of the recipe"
DEEP_M = 0.001
"""Two bodies may overlap by this at the start: hulls are a little rounder than meshes."""
START_M = 0.005
"""A robot that starts deeper in itself or in the floor is thrown off, and is not ready."""

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
    "is kp in other units, the effort limit too small, or kd or the armature far too large?",
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
    "a smaller timestep, or `mjcf: {integrator: implicitfast}` where an MJCF says otherwise; look "
    "for tiny inertias and overlapping shapes",
)
RESTLESS = Rule(
    "trials.rest",
    ("warning", "info"),
    "two seconds after a drop the joints still move",
    "more kd, a smaller timestep, or the rotors' armature",
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
    "a pose that stands by itself, more kd or kp, or a smaller timestep",
)
FALL = Rule(
    "trials.fall",
    "warning",
    "left alone under its drives for two seconds the robot falls, or a drive of a fixed robot does "
    "not hold its joint",
    "raise kp, check the effort limits, move the feet under the centre of mass; `validate: {stand: "
    "{}}` makes it an error",
)
OVERLAP = Rule(
    "trials.overlap",
    "warning",
    "two bodies touch in almost all random poses, or are inside each other where the robot starts "
    "(by more than 5 mm: not ready)",
    "exclude the pair, or use smaller shapes; in the second case another pose helps, too",
    was={"stand.overlap": ("trials.overlap",)},
)
FLOOR = Rule(
    "trials.floor",
    "warning",
    "a moving body starts inside the floor of the scene (by more than 5 mm: not ready)",
    "turn or raise the robot in the keyframe that it starts in",
)
NOTHING_TOUCHES = Rule(
    "trials.nothing_touches",
    "warning",
    "the robot floats and none of its shapes can touch a floor, so it is not ready",
    "give it collision shapes, whose `contype` or `conaffinity` meets a floor's 1; one that never "
    'lands states it: `rules: {trials.nothing_touches: {severity: info, because: "..."}}`',
    blocks=True,
)
SHAKEN = Rule(
    "trials.random_targets_diverge",
    "error",
    "the random targets of an untrained policy drive the simulation to infinity",
    "a smaller `simulation.timestep`, the rotors' real armature, smaller kp, or an `effort` that "
    "is no placeholder",
)


class Trials(mujoco.InMujoco):
    """Findings `trials.<what>`; one compilation of `mjcf/scene.xml` serves all experiments."""

    usual_s = 0.6
    reads = ("control.json",)

    section = "validate.trials"
    about = (
        "small experiments in MuJoCo: drives, energy, timestep, self-collision, "
        "balance, settling; null = do not run them"
    )
    recipe_fields: ClassVar[Mapping[str, str]] = {"action": "mjlab.action"}
    derived: ClassVar = {
        "alone": lambda recipe: recipe.value("validate.stand") is None,
        "inherited": lambda recipe: (
            recipe.value("source.mjcf") is not None and not recipe.value("actuators")
        ),
    }

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
    min_response: Positive = Field(
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

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and `mjcf/scene.xml`."""
        control = RobotFiles(files.inputs).control
        try:
            model = mujoco.load(files.inputs / "mjcf" / "scene.xml", visuals=False).model
        except StepError as error:
            write_figures(files, {"skipped": error.message})
            yield LOAD("robot", f"nothing to try: {error.message}")
            return
        figures: Figures = {}
        driven = servoed(model, control, {"ideal_pd", "dc_motor"})
        yield from self.examine(driven, figures, servoed(model, control))
        limits = {
            **dict.fromkeys(("asked", "moved"), self.min_response),
            "energy_drift": self.energy,
            "timestep_error": self.timestep,
            "share_of_poses": self.always,
            "depth_m": START_M,
            "fastest_joint": self.speed,
            "deepest_contact_m": self.penetration,
            **dict.fromkeys(("drift_m", "support_margin_m"), self.drift),
            **dict.fromkeys(("height_before_m", "height_after_m"), self.drop),
        }
        write_figures(files, figures, limits)

    def examine(self, model: Model, figures: Figures, alone: Model = None) -> Iterator[Finding]:
        """All experiments on a compiled model, our own or foreign; those on the floor need one.

        alone: the same where plain motors hold their joints as well, as a controller does; None: it
        has no such motors.
        """
        if int(model.nv) > LARGEST_DOFS:
            message = f"{model.nv} degrees of freedom, more than {LARGEST_DOFS}: nothing is tried"
            yield LARGE("robot", message)
            return
        yield from self._drives(model, figures)
        yield from self._numerics(model, figures)
        try:
            yield from self._overlaps(model, figures)
            fall = list(self._left_alone(model if alone is None else alone, figures))
            if model.nkey and mujoco.stands_free(model):
                yield from self._balance(model, figures)
                yield from self._dropped(model, figures, falls=bool(fall))
            yield from fall
            yield from self._shaken(model, figures)
        except ArenaFullError as error:
            yield MEMORY("robot", error.message)

    def dangers(self, model: Model) -> Iterator[Finding]:
        """Yield what can be an error wherever the robot stands: for a recipe being proposed."""
        yield from self._drives(model, {})
        yield from self._shaken(model, {})

    def _drives(self, model: Model, figures: Figures) -> Iterator[Finding]:
        drives = list[Figures]()
        for joint, (asked, moved) in experiments.answers(model).items():
            drives.append({"joint": joint, "asked": asked, "moved": moved})
            if moved < min(self.min_response, 0.2 * asked):
                origin = ", as in the source's own MJCF" if self.inherited else ""
                yield DEAD(
                    f"actuator {joint}",
                    f"commanded to swing by {asked:.3g}, moved by {moved:.3g} "
                    f"{experiments.unit_of(model, joint)}{origin}",
                    severity="warning" if self.inherited else "error",
                    data={"asked": asked, "moved": moved},
                )
        figures["drives"] = drives

    def _numerics(self, model: Model, figures: Figures) -> Iterator[Finding]:
        drift = experiments.energy_drift(model)
        figures["energy_drift"] = _or_unstable(drift)
        if not drift <= self.energy:
            change = f"changed by {drift:.2%}" if math.isfinite(drift) else "went to infinity"
            message = f"in one second of free motion the energy {change} (limit {self.energy:.2%})"
            yield ENERGY("robot", message, data={"limit": self.energy})
        if not model.nu:
            return  # a free swing is judged by its energy; nothing holds it to a path
        errors = experiments.timestep_error(model)
        figures["timestep_error"] = {joint: _or_unstable(e) for joint, e in errors.items()}
        worst = max(errors, key=lambda joint: errors[joint], default="")
        if errors.get(worst, 0.0) > self.timestep:
            yield TIMESTEP(
                f"actuator {worst}",
                f"moves otherwise at a quarter of the timestep: by {errors[worst]:.3g} "
                f"{experiments.unit_of(model, worst)} (limit {self.timestep:g})",
                data={"timestep_s": float(model.opt.timestep), "limit": self.timestep},
            )

    def _overlaps(self, model: Model, figures: Figures) -> Iterator[Finding]:
        """Bodies inside one another in almost all random poses or at the start; in the floor."""
        pairs = experiments.touching_pairs(model, self.poses)
        figures["self_collision"] = [
            {"a": a, "b": b, "share_of_poses": share}
            for (a, b), share in list(pairs.items())[:SHOWN_PAIRS]
        ]
        overlaps = experiments.overlaps_at_home(model)
        at_home = {pair: depth for pair, depth in overlaps.items() if pair[0]}
        for (a, b), share in pairs.items():
            if share >= self.always and at_home.get((a, b), 0.0) <= START_M:
                yield OVERLAP(
                    f"link {a}",
                    f"runs into {b} in {share:.0%} of {self.poses} random poses",
                    hint=f"`collision.exclude.pairs: [[{a}, {b}]]`, or smaller shapes",
                    data={"share": share, "poses": self.poses},
                )
        for (a, b), depth in at_home.items():
            if depth > START_M or (depth >= DEEP_M and pairs.get((a, b), 0.0) < self.always):
                yield OVERLAP(
                    f"link {a}",
                    f"lies {depth * 1e3:.3g} mm in {b} where it starts: they are thrown apart",
                    hint=f"another pose, `collision.exclude.pairs: [[{a}, {b}]]`, or smaller "
                    "shapes",
                    data={"depth_m": depth, "limit_m": START_M},
                    blocks=depth > START_M,
                )
        free = mujoco.stands_free(model)
        placed = model.nkey or not free  # where a free robot starts, a keyframe alone says
        depths = {b: depth for (a, b), depth in overlaps.items() if placed and not a}
        figures["in_floor"] = [{"body": body, "depth_m": depth} for body, depth in depths.items()]
        for body, depth in depths.items():
            if depth >= DEEP_M:
                yield FLOOR(
                    f"link {body}",
                    f"starts {depth * 1e3:.3g} mm inside the floor (not ready above "
                    f"{START_M * 1e3:g} mm): simulators throw it off or jam it",
                    hint=f"turn or raise the keyframe `{model.key(0).name}`" if model.nkey else "",
                    data={"depth_m": depth, "limit_m": START_M},
                    blocks=depth > START_M,
                )
        floors, able = set(mujoco.floors(model)), (*touching_geoms(model), *explicit_pairs(model))
        if free and not any(floors & set(pair) for pair in able):
            message = "it floats, and none of its shapes can touch the floor: it falls through"
            yield NOTHING_TOUCHES("robot", message)

    def _balance(self, model: Model, figures: Figures) -> Iterator[Finding]:
        under = experiments.support(model)
        figures["support_margin_m"], figures["support_points"] = under.margin_m, under.points
        if under.margin_m is not None and under.margin_m < self.support:
            side = "outside of" if under.margin_m < 0.0 else "inside"
            yield BALANCE(
                "robot",
                f"at home the centre of mass is {1e3 * abs(under.margin_m):.3g} mm {side} its feet",
                data={"margin_m": under.margin_m, "limit_m": self.support},
            )

    def _dropped(self, model: Model, figures: Figures, *, falls: bool) -> Iterator[Finding]:
        """falls: it falls by itself, so that it also lies, rolls and moves after a drop."""
        settled = experiments.settle(model, self.drop)
        values = settled or dict.fromkeys(experiments.SETTLED)
        figures["settle"] = {"finite": settled is not None, **values}
        if settled is None:
            message = f"dropped from {self.drop:g} m, the simulation went to infinity"
            yield UNSTABLE("robot", message, data={"drop_m": self.drop})
            return
        for rule, name, limit, what, unit in (
            (RESTLESS, "fastest_joint", self.speed, "its fastest joint moves at", "rad/s"),
            (SUNK, "deepest_contact_m", self.penetration, "a contact still penetrates", "m"),
            (DRIFT, "drift_m", self.drift, "in 1000 steps its base wandered", "m"),
        ):
            if (value := settled[name]) > limit:
                yield rule(
                    "robot",
                    f"two seconds after a drop from {self.drop:g} m {what} {value:.3g} {unit}",
                    hint="a smaller `simulation.timestep`, the rotors' real armature, other gains, "
                    "or a pose that stands by itself",
                    severity="info" if falls else None,
                    data={"value": value, "limit": limit},
                )

    def _left_alone(self, model: Model, figures: Figures) -> Iterator[Finding]:
        """Nobody touches the robot at its first keyframe; its drives hold what they can."""
        if not (self.alone and model.nkey and mujoco.floors(model)):
            return
        stood = stand(model, 0, ALONE_S)
        did = figures["untouched"] = outcome_figures(stood, ALONE_FALL)
        if did["outcome"] == "falls" and mujoco.turning(model):
            under = experiments.support(model)
            hint = ON_POINTS if stood.floats and under.points and not under.is_area else ""
            yield FALL(
                "robot" if stood.floats else f"actuator {stood.worst_held[0]}",
                f"left alone it {did['sentence']}",
                hint=hint if stood.worst_held[0] or not stood.driven else WITHOUT_GAINS,
                data={"tilt_rad": stood.tilt_rad, "sag_m": stood.sag_m},
            )

    def _shaken(self, model: Model, figures: Figures) -> Iterator[Finding]:
        """Does it bear what an untrained policy asks of it?"""
        shaken = experiments.shake(model, self.action)
        if shaken is None:
            return
        seconds, joint, speed = shaken
        fastest = speed if seconds is None else None
        figures["shake"] = {"seconds": seconds, "joint": joint, "fastest_joint": fastest}
        if seconds is not None:
            yield SHAKEN(
                f"joint {joint}",
                "an untrained policy's random targets drive the simulation to infinity after "
                f"{seconds:.2g} s, this joint foremost",
                data={"seconds": seconds},
            )


def _or_unstable(value: float) -> float | str:
    return value if math.isfinite(value) else "unstable"
