"""The recipe's drives, pose and time step: tried before they are written, and corrected.

Tried by the code of the checks in MuJoCo, with the hulls of all its links, which may lie inside
each other at home and throw the robot over. What random commands do to its drives is tried on the
hulls of its soles alone.

Corrected until no check of a build objects, in this order: an effort that is unknown and too weak;
a damping ratio that the joints' own damping exceeds; then, where the simulation outruns its drives,
the time step. What the source states and cannot be is left, and said. A driven joint whose rotor
nobody states gets the least that a motor of its effort has: see `rotor_inertias`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from assetbuild.checks.gains import Gains
from assetbuild.checks.stand import Stand as StandCheck
from assetbuild.checks.trials import Trials
from assetbuild.control.control import ControlStep
from assetbuild.control.ground import Ground
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import AssetBuildError
from assetbuild.findings import Finding
from assetbuild.init.anatomy import Anatomy
from assetbuild.init.draft import with_remedy
from assetbuild.init.drives import FIRM, STEP_S, TABLE, DriveRow, drive_rows
from assetbuild.init.home import DEEP_M, UPRIGHT, Depths, Pair, Shift, home_pose, nothing_deep
from assetbuild.init.look import InspectedRobot
from assetbuild.init.strength import Guess, rotor_inertias, rounded_up, strengthened, with_efforts
from assetbuild.recipe_types import listed
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import encode
from assetbuild.robot.contact import Exclude
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.sections import Keyframe, Simulation
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import trials as mujoco_trials
from assetbuild.simulators.mujoco.drives import servoed
from assetbuild.simulators.mujoco.stand import Stand, outcome, outcome_figures, stand
from assetbuild.targets.mjcf import Mjcf

JUDGE = StandCheck()
"""The check `stand` with its defaults, by which a build judges what `init` tries here."""
SOLE_M = 0.02
"""What of a foot is so near to the floor may carry the robot: not every sole is drawn level."""
PUSHED_RAD = JUDGE.max_tilt / 2.0
"""Tilt of the base at which `init` asks whether overlapping bodies push the robot askew."""
ADJACENT = Exclude(adjacent=True)


@dataclass(frozen=True)
class Trial:
    """What came of it. stands: None where it could not be tried; sentence: what it did, or why.

    lean: how far its base tilted, rad.
    off: centre of mass beyond the middle of what stands on the floor at the start, x and y, m.
    errors: what the checks say of drives and pose that a build would stop at.
    refused: why no build takes a key of the recipe, and what to do.
    overlaps: bodies whose hulls must not collide, for else the robot falls or leans, and how deep
    one is inside the other at home, m.
    tried: what did not make it stand, each with what it did then.
    points: whether its feet touch the floor in points that span no area, so that no drive keeps it.
    """

    stands: bool | None
    sentence: str
    lean: float = 0.0
    off: tuple[float, float] = (0.0, 0.0)
    errors: tuple[Finding, ...] = ()
    refused: str = ""
    overlaps: Mapping[Pair, float] = field(default_factory=dict)
    tried: tuple[str, ...] = ()
    points: bool = False

    @property
    def unmended(self) -> tuple[str, ...]:
        """Return what a build has against it, each with the edit that mends it."""
        return (*map(with_remedy, self.errors), *filter(None, (self.refused,)))


@dataclass(frozen=True)
class Stage:
    """The robot as a build has it, with a hull or primitive for each shape, in a folder of its own.

    soles: source links that it stands on; without any nothing is to stand, or nothing can.
    exclude: pairs of bodies that never touch. whole: whether all its links touch the floor and each
    other, or its soles alone.
    """

    robot: InspectedRobot
    soles: Sequence[str]
    shapes: Shapes
    ports: Scratch
    exclude: Exclude
    whole: bool

    def attempt(
        self,
        drives: Sequence[DriveRow],
        pose: Mapping[str, float],
        timestep: float,
        driven_by: Control | None = None,
    ) -> Trial:
        """Two seconds at `home`, with the tables of the recipe, a row for each drive's pattern.

        driven_by: the drives of a source that has its own, which are not judged here.
        """
        rows = [keys for row in drives for keys in row.table(self.robot.tree)]
        joints = {re.escape(name): value for name, value in pose.items()}
        home = Keyframe.model_validate({"base": "on_ground", "joints": joints})
        control = ControlStep(
            rows=tuple(map(ActuatorRow.model_validate, rows)),
            keyframes={"home": home},
            simulation=Simulation(timestep=timestep),
            exclude=self.exclude,
        )
        try:
            findings = list(self.ports.run(control))
            made = RobotFiles(self.ports.folder).control
            if driven_by is not None:
                made = replace(made, actuators=driven_by.actuators)
                self.ports.put("control.json", encode(made))
            model = self._compiled()
            if driven_by is None:
                gains = Gains(feet=listed(self.soles) or None)
                findings += (*self.ports.run(gains), *Trials().dangers(self._on_soles(model)))
            errors = tuple(finding for finding in findings if finding.severity == "error")
            if not self.soles:
                return Trial(False, "has no shape on its feet to stand on", errors=errors)
            if not any(shape.link in self.soles for shape in self.shapes.shapes):
                return Trial(None, "no shape of its soles can be read", errors=errors)
            trial = self._tried(model, control, made)
            points = not mujoco_trials.support(model).is_area
            return replace(
                trial, errors=errors, off=mujoco_trials.support(model, SOLE_M).off_m, points=points
            )
        except AssetBuildError as error:
            refused = f"{error.message} ({error.hint})" if isinstance(error, RowError) else ""
            return Trial(None, error.message, refused=refused)

    def depths(self) -> Depths:
        """How deep bodies lie in each other, in any pose, or of a fixed robot that is drawn to
        stand on z = 0 below it: the scenes' floor gives way, its own does not. {} without shapes.
        """
        try:
            self.ports.run(ControlStep(exclude=self.exclude))
            model = self._compiled()
        except AssetBuildError:  # what only the build can read, it judges
            return nothing_deep
        tree = self.robot.tree
        ground = Ground(tree, self.shapes, self.ports.folder / "meshes")
        scenery = [floor for floor in mujoco.floors(model) if model.geom_bodyid[floor] == 0]
        stands = tree.base == "fixed" and (not scenery or ground.base_stands_on_zero)
        model.geom_pos[scenery, 2] = 0.0

        def measured(pose: Mapping[str, float]) -> dict[Pair, float]:
            between = mujoco_trials.depths(model, with_mimics(tree, pose))
            deepest = self._deepest({pair: d for pair, d in between.items() if stands or pair[0]})
            return {pair: depth for pair, depth in deepest.items() if depth > DEEP_M}

        return measured

    def _deepest(self, depths: Mapping[Pair, float]) -> dict[Pair, float]:
        """The largest depth of each two bodies, by those of two shapes; "" is the floor."""
        shapes = self.shapes.shapes
        bodies = {shape.name: self.robot.tree.placement(shape.link)[0] for shape in shapes}
        deepest: dict[Pair, float] = {}
        for pair, depth in depths.items():
            one, other = sorted(bodies[shape] if shape else "" for shape in pair)
            deepest[one, other] = max(depth, deepest.get((one, other), 0.0))
        return deepest

    def _compiled(self) -> mujoco.Model:
        self.ports.run(Mjcf(robot="robot"))
        return mujoco.load(self.ports.folder / "mjcf" / "scene.xml", visuals=False).model

    def _on_soles(self, model: mujoco.Model) -> mujoco.Model:
        """A copy of the model in which nothing but the soles touches anything."""
        soles = {shape.name for shape in self.shapes.shapes if shape.link in self.soles}
        alone = mujoco.without(model)
        for geom in mujoco.collision_geoms(model):
            if mujoco.name_of(model, "geom", geom) not in soles:
                alone.geom_contype[geom] = alone.geom_conaffinity[geom] = 0
        return alone

    def _tried(self, model: mujoco.Model, control: ControlStep, made: Control) -> Trial:
        """A mesh becomes smaller pieces than its hull, so overlaps count only where they push the
        robot over or askew. It is then tried without the collisions of these pairs.
        """
        scene = model if self.whole else self._on_soles(model)
        stood = stand(servoed(scene, made), "home", JUDGE.seconds)
        found = self._deepest(stood.overlapping)
        deep = {pair: depth for pair, depth in found.items() if depth > JUDGE.sole}
        if deep and self.whole and not _is_upright(stood):
            without = Exclude(adjacent=True, pairs=(*self.exclude.pairs, *deep))
            self.ports.run(control.model_copy(update={"exclude": without}))
            freed = stand(servoed(self._compiled(), made), "home", JUDGE.seconds)
            if _is_upright(freed):
                return replace(self._judged(freed), overlaps=deep)
        return self._judged(stood)

    def _judged(self, stood: Stand) -> Trial:
        """A robot that leans may fall on the shapes of the build, and so may one whose soles are
        not on the floor; below the floor is no height.
        """
        did = outcome(stood, JUDGE.fall)
        if did != "stands":
            verb = "becomes unstable" if did == "unstable" else "falls"
            return Trial(False, f"{verb} within {JUDGE.seconds:g} s")
        if stood.tilt_rad > JUDGE.max_tilt:
            leans = f"leans by {stood.tilt_rad:.2g} rad after {JUDGE.seconds:g} s"
            return Trial(False, f"{leans}, more than {JUDGE.max_tilt:g}")
        if self.whole:
            judge = JUDGE.model_copy(update={"feet": listed(self.soles)})
            findings = judge.evaluate(stood, self.robot.tree, self.shapes)
            error = next((finding for finding in findings if finding.severity == "error"), None)
            if error is not None:
                return Trial(False, f"stands, but {error.subject}: {error.message}")
        sentence = str(outcome_figures(stood, JUDGE.fall)["sentence"])
        return Trial(True, sentence, stood.tilt_rad)


def _is_upright(stood: Stand) -> bool:
    return outcome(stood, JUDGE.fall) == "stands" and stood.tilt_rad <= PUSHED_RAD


@contextmanager
def staged(
    robot: InspectedRobot, soles: Sequence[str], exclude: Exclude = ADJACENT, *, whole: bool = True
) -> Iterator[Stage]:
    """Lay the robot out. soles: source links."""
    links = sorted(robot.solid_links | set(soles))
    with scratch() as ports:
        shapes = robot.simplified(links, ports)
        for name, value in (("links", robot.links), ("tree", robot.tree), ("shapes", shapes)):
            ports.put(f"{name}.json", encode(value))
        yield Stage(robot, soles, shapes, ports, exclude, whole)


LIGHT_KG = 5.0
SHORT_STEP_S, SHORTEST_STEP_S = 0.002, 0.001
ROUNDS = 8
"""Corrections at most: each needs a trial, of a second or two for a humanoid."""
WEAK = ("gains.torque", "trials.dead")
"""Rules that a stronger drive satisfies."""
STRONGER = 2.0
LEANS_RAD = 0.03
"""Tilt beyond which a robot is brought upright: the soles of a build may be smaller than hulls."""
LESS = 0.75
"""Share of a lean that a remedy may leave of a robot that stands without it."""
BALANCED_M = 0.003
"""Nearer to the middle of its feet, along x or y, the centre of mass is not brought."""
FIRMER = 4.0
"""Firmness of legs that yield one after another, so that `FIRM` is not enough."""


@dataclass(frozen=True)
class Tuning:
    """A choice of drives, what made it, and what came of it. tree: with the guessed efforts.

    rotors: inertias that the source states, by joint, kg m2 or kg. notes: what was corrected and
    why.
    """

    tree: Tree
    anatomy: Anatomy
    stage: Stage
    guesses: Mapping[str, Guess]
    rotors: Mapping[str, float]
    depths: Depths
    timestep: float
    pose: Mapping[str, float] = field(default_factory=dict)
    drives: tuple[DriveRow, ...] = ()
    trial: Trial = Trial(None, "not tried")
    notes: tuple[str, ...] = ()
    shift: Shift = UPRIGHT
    firmness: float = FIRM

    @property
    def driven(self) -> set[str]:
        """Joints that get a drive of ours."""
        return {name for row in self.drives if row.gains for name in row.joints}

    def but(self, **change: Any) -> Tuning:  # Any: fields of this class
        """Choose pose, drives and time step anew, and try them; the step grows no longer."""
        tuning = replace(self, **change)
        tree, legs, turning = tuning.tree, tuning.anatomy.legs, tuning.anatomy.turning
        pose = home_pose(tree, legs, tuning.shift, tuning.depths)
        rotors = rotor_inertias(tree, tuning.rotors)
        drives = drive_rows(tree, pose, legs, tuning.guesses, rotors, turning, tuning.firmness)
        hops = any(row.outruns(STEP_S) for row in drives)
        needed = SHORT_STEP_S if hops or total_mass(tree) < LIGHT_KG else STEP_S
        step = min(needed, tuning.timestep)
        trial = tuning.stage.attempt(drives, pose, step)
        return replace(tuning, pose=pose, drives=drives, timestep=step, trial=trial)


def tune(
    stage: Stage,
    anatomy: Anatomy,
    rotors: Mapping[str, float],
    timestep: float = STEP_S,
    depths: Depths = nothing_deep,
) -> Tuning:
    """The first choice of drives that the trial has nothing against, else the last.

    rotors: inertias that the source states, by joint, kg m2 or kg; timestep: the longest, s.
    """
    strong, guesses = strengthened(stage.robot.tree, anatomy)
    tuning = Tuning(strong, anatomy, stage, guesses, rotors, depths, timestep).but()
    for _ in range(ROUNDS):
        better = _corrected(tuning) if tuning.trial.unmended else None
        if better is None:
            break
        tuning = better
    trial = tuning.trial
    askew = trial.stands is False or trial.lean > LEANS_RAD
    return _standing(tuning) if askew and not (trial.unmended or trial.points) else tuning


def _corrected(tuning: Tuning) -> Tuning | None:
    """Efforts that are guesses grow; else a step of 2 ms, then of 1 ms; None: nothing is left."""
    grown = {}
    for error in (error for error in tuning.trial.errors if error.rule in WEAK):
        name = error.subject.partition(" ")[2]
        effort = tuning.tree.by_joint[name].limits.effort or 0.0
        if name in tuning.guesses:
            load = max(float(str(error.data.get("load", 1.0))), 1.0)
            grown[name] = rounded_up(load * STRONGER * effort)
    if grown:
        return tuning.but(tree=with_efforts(tuning.tree, grown))
    other = next((error for error in tuning.trial.errors if error.rule not in WEAK), None)
    step = next((s for s in (SHORT_STEP_S, SHORTEST_STEP_S) if s < tuning.timestep), None)
    if other is None or step is None:
        return None
    note = f"a time step of {1e3 * step:g} ms: at {1e3 * tuning.timestep:g} ms "
    note += f"{other.subject} {other.message}"
    return tuning.but(notes=(*tuning.notes, note), timestep=step)


def _standing(tuning: Tuning) -> Tuning:
    """The first remedy that makes the robot stand upright, else the most upright of those with
    which one that fell stands, or one that leans does so less; else as it was, with what was tried.
    """
    now, trial = tuning, tuning.trial
    stood, tried, kept = list[Tuning](), list[str](), list[str]()
    failed = f"leans by {trial.lean:.2g} rad" if trial.stands else trial.sentence
    for remedy in REMEDIES if tuning.anatomy.legs else ():
        again = _remedied(remedy, now)
        if again is None:
            continue
        after = again.trial
        tried.append(f"{remedy} (it {after.sentence})")
        if after.stands and not after.unmended:
            note = f"{', '.join(dict.fromkeys((*kept, remedy)))}: otherwise it {failed}"
            stood.append(replace(again, notes=(*tuning.notes, note)))
            if after.lean <= LEANS_RAD:
                return stood[-1]
        nearer = math.hypot(*after.off) < math.hypot(*now.trial.off) + BALANCED_M
        if nearer and not after.unmended:
            now = again
            kept.append(remedy)
    better = [it for it in stood if not trial.stands or it.trial.lean < LESS * trial.lean]
    if not (better or trial.stands):
        return replace(tuning, trial=replace(trial, tried=tuple(dict.fromkeys(tried))))
    return min(better, key=lambda it: it.trial.lean, default=tuning)


BALANCED = "feet under the centre of mass"
HASTY = f"a time step of {1e3 * SHORT_STEP_S:g} ms"
FIRM_LEGS = f"legs {FIRMER:g} times as stiff as would let it tip over"
REMEDIES = (BALANCED, BALANCED, HASTY, FIRM_LEGS, BALANCED)
"""What may make a robot stand, in the order in which it is tried; what brings its feet under its
centre of mass is kept for the next."""


def _remedied(remedy: str, tuning: Tuning) -> Tuning | None:
    """Choose anew with one of the remedies; None where it would change nothing."""
    (ahead, aside), firmness, step = tuning.shift, tuning.firmness, tuning.timestep
    if remedy == BALANCED:
        x, y = (way if abs(way) >= BALANCED_M else 0.0 for way in tuning.trial.off)
        ahead, aside = ahead + x, aside + y
    elif remedy == HASTY:
        step = min(step, SHORT_STEP_S)
    elif len(tuning.anatomy.legs) < TABLE:
        firmness = FIRMER
    change = {"shift": (ahead, aside), "firmness": firmness, "timestep": step}
    is_same = all(getattr(tuning, key) == value for key, value in change.items())
    return None if is_same else tuning.but(**change)
