"""PhysX as checks use it: `ovphysx` on the CPU, in a child process of its own.

The extra `physx` brings it. Its licence forbids to publish its figures: they may stand in the
user's own bundle, never in the repository or on a public page.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from assetbuild.findings import Rule
from assetbuild.robot.pose import IDENTITY, Array, Pose, normalised_quat, vec3
from assetbuild.simulators._physx_scene import Setting as Setting  # checks take it from here
from assetbuild.simulators._physx_scene import StageNames, write_world
from assetbuild.simulators.children import run_child
from assetbuild.simulators.experiments import FreeFall, Motion, Sine, fall_of

REQUIRES: Mapping[str, str] = {"ovphysx": "physx", "physx_usd_schemas": "physx"}
"""Modules of the extra, for `Check.requires`."""
BEYOND_IMPORTS = ("assetbuild.simulators._physx_child", "physx_usd_schemas")
PRELOAD = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")
"""`Step.preload` of a check that opens stages here."""
TURN = 0.5
"""rad or m; a position of joints at which their axes show."""
UNLIMITED = 3.0e38
"""PhysX writes the largest float32 where nothing limits."""
CLEARANCE_M = 1e-3
"""How far above the floor a standing pose starts: a sole that starts inside of it by the smallest
amount is thrown out with all of `maxDepenetrationVelocity` in the first step."""
_PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from assetbuild.simulators import _physx_child; _physx_child.main()"
)

LOAD = Rule(
    "physx.load", "error", "PhysX refuses the asset, or crashes on it", "read the `usd.*` findings"
)
NOT_FINITE = Rule(
    "physx.finite",
    "error",
    "the simulation crashed, hung or went to infinity within 5 s",
    "look for overlaps, tiny inertias and starts outside the limits",
)
ARTICULATION = Rule(
    "physx.articulation",
    ("error", "warning"),
    "there is not exactly one articulation (a warning for a foreign USD)",
    "check that a variant is selected, and that there is one articulation root",
)
LOOSE_BODY = Rule(
    "physx.loose_body",
    ("error", "warning"),
    "a body is outside the articulation (a warning for a foreign USD)",
    "attach it to the robot by a joint",
)
FREE_FALL = Rule(
    "physx.free_fall",
    ("warning", "error"),
    "the robot does not fall by g/2 t (t + dt/N) (an error above 5 %)",
    "check whether a body is damped or welded",
)


@dataclass(frozen=True)
class HeldLink:
    """One body as PhysX holds it. inertia: (3, 3) about the centre of mass, kg m2.

    com_m: (3,) in the body. The inertia's axes are those of the body. surfaces: (static friction,
    dynamic friction, restitution) of each collision shape. X_world_zero, X_world_turned: its place
    with every joint at 0, and at `TURN`; None after a run with steps.
    """

    mass_kg: float
    com_m: Array
    inertia: Array
    surfaces: tuple[tuple[float, float, float], ...]
    X_world_zero: Pose | None = None
    X_world_turned: Pose | None = None


def _read(attribute: str, angle: int = 0, *, end: int = 0, limit: bool = False) -> Any:
    """A field of `HeldJoint`: which number of PhysX it is. Any: as `dataclasses.field`.

    angle: power of the coordinate's unit in it, degrees in PhysX; end: place in the attribute.
    """
    return field(metadata={"attribute": attribute, "angle": angle, "end": end, "limit": limit})


@dataclass(frozen=True)
class HeldJoint:
    """One joint as PhysX holds it. SI and radians; None = unlimited.

    drive: 0 none, 1 force, 2 acceleration.
    """

    position: float = _read("jointPosition", 1)
    target: float = _read("jointPositionTarget", 1)
    lower: float | None = _read("jointLimit", 1, limit=True)
    upper: float | None = _read("jointLimit", 1, end=1, limit=True)
    kp: float = _read("jointStiffness", -1)
    kd: float = _read("jointDamping", -1)
    effort: float | None = _read("jointMaxForce", limit=True)
    velocity: float | None = _read("jointMaxVelocity", 1, limit=True)
    armature: float = _read("jointArmature")
    static_friction: float = _read("jointStaticFriction")
    dynamic_friction: float = _read("jointDynamicFriction")
    viscous_friction: float = _read("jointViscousFriction", -1)
    drive: float = _read("jointDriveType")


@dataclass(frozen=True)
class Held:
    """What PhysX holds after loading a stage. loose: bodies that belong to no articulation.

    X_world_root: of the root link of the first articulation; None where there is none.
    """

    articulations: int
    fixed_base: bool
    X_world_root: Pose | None
    dof: int
    links: Mapping[str, HeldLink]
    joints: Mapping[str, HeldJoint]
    shapes: int
    loose: tuple[str, ...]


@dataclass(frozen=True)
class Course:
    """What is done in every step to an object that is gripped.

    targets: (n,) of drives by joint, rad or m. table: (n, 3) world, m. force: (n, 3) on the object,
    world, N. watched: bodies from which the object is seen. n: steps and one.
    """

    targets: Mapping[str, Array]
    table: Array
    force: Array
    watched: tuple[str, ...]


@dataclass(frozen=True)
class Experiment:
    """One stage, loaded and stepped. steps: 0 = only loaded. every: steps between samples.

    start: joint positions, rad or m; joints without one stay where the asset puts them.
    """

    name: str
    setting: Setting
    steps: int = 0
    every: int = 1
    start: Mapping[str, float] | None = None
    sine: Sine | None = None
    course: Course | None = None


@dataclass(frozen=True)
class Outcome:
    """held, motion: None where PhysX did not get that far, and `failure` says why."""

    held: Any  # `Held` of PhysX; JSON of Newton
    motion: Motion | None
    failure: str = ""

    @property
    def finite(self) -> bool:
        """It got to its end and nothing was NaN."""
        return not self.failure and (self.motion is None or self.motion.finite)


def clear_of_floor(base: Pose | None) -> Pose:
    """A standing pose, a hair higher."""
    base = base or IDENTITY
    x, y, z = base.xyz
    return Pose((x, y, z + CLEARANCE_M), base.quat)


Start = Callable[[list[dict[str, object]], Path, float], str]
"""Runs an engine's program on some jobs in a folder; how it died, or "" when it ended well."""


def perform(
    main: Path, experiments: Sequence[Experiment], seconds: float = 240.0, *, copied: bool = True
) -> dict[str, Outcome]:
    """Run experiments in PhysX on the asset `main`, by name. A crash or a NaN ends only its own.

    seconds: wall-clock limit of the whole. copied: with its whole folder, as the inputs of a step
    must be: they are links into the store, and a resolver that follows them gets lost.
    """
    return perform_in(_start, _held, main, experiments, seconds, copied=copied)


def perform_in(
    start: Start,
    read: Callable[[dict[str, Any], StageNames], Any],  # Any: JSON; what an engine holds
    main: Path,
    experiments: Sequence[Experiment],
    seconds: float,
    *,
    copied: bool = True,
) -> dict[str, Outcome]:
    """As `perform`, in the engine whose program `start` runs. read: what the engine then holds."""
    with TemporaryDirectory(prefix="physx-") as temporary:
        folder = Path(temporary).resolve()
        asset = main.resolve()
        if copied:
            shutil.copytree(main.parent, folder / "asset")
            asset = folder / "asset" / main.name
        jobs = {}
        for experiment in experiments:
            stage = folder / f"{experiment.name}.usda"
            names = write_world(stage, asset, experiment.setting)
            job = _job(experiment, names, stage)
            if experiment.course is not None:
                job["course"] = _write_course(folder, experiment.name, experiment.course, names)
            jobs[experiment.name] = (experiment, names, job)
        waiting = list(jobs)
        failures: dict[str, str] = {}
        while waiting:
            died = start([jobs[name][2] for name in waiting], folder, seconds)
            done = [n for n in waiting if (folder / f"{n}.done").exists()]
            waiting = waiting[len(done) :]
            if waiting and died:
                failures[waiting.pop(0)] = died
            elif not done and waiting:
                failures |= dict.fromkeys(waiting, "it stopped without a word")
                waiting = []
        return {
            name: _outcome(folder, names, experiment, failures.get(name, ""), read)
            for name, (experiment, names, _) in jobs.items()
        }


def _job(experiment: Experiment, names: StageNames, stage: Path) -> dict[str, object]:
    sine, dt = experiment.sine, experiment.setting.timestep
    paths = {name: path for path, name in names.joints.items()}
    drives = {}
    if sine is not None:
        drives = {
            paths[name]: (
                _shown(name, sine.middle[name], names),
                _shown(name, sine.swing[name], names),
            )
            for name in sine.middle
            if name in paths
        }
    start = {n: v for n, v in (experiment.start or {}).items() if n in paths}
    if sine is None:  # servos that the asset does not know have no target there: hold the start
        held = {n: v for n, v in start.items() if n in (experiment.setting.drives or {})}
        drives = {paths[n]: (_shown(n, v, names), 0.0) for n, v in held.items()}
    return {
        "name": experiment.name,
        "stage": str(stage),
        "dt": dt,
        "steps": experiment.steps,
        "every": experiment.every,
        "contacts": experiment.setting.contacts,
        "start": {paths[n]: _shown(n, v, names) for n, v in start.items()},
        "turn": {path: _shown(name, TURN, names) for path, name in names.joints.items()},
        "course": "",
        "targets": {
            "frequency": sine.frequency_hz if sine else 0.0,
            "joints": drives,
            "speeds": [paths[name] for name in (sine.speeds if sine else ()) if name in paths],
        },
    }


def _write_course(folder: Path, name: str, course: Course, names: StageNames) -> str:
    """The file that the child reads; angles in degrees, bodies and joints by path."""
    joints = {name: path for path, name in names.joints.items()}
    bodies = {name: path for path, name in names.bodies.items()}
    targets = [
        np.degrees(track) if joint in names.angular else track
        for joint, track in course.targets.items()
    ]
    path = folder / f"{name}.course.npz"
    np.savez(
        path,
        drives=[joints[joint] for joint in course.targets],
        targets=np.stack(targets, axis=1),
        table=course.table,
        force=course.force,
        watched=[bodies[body] for body in course.watched],
    )
    return str(path)


def _shown(joint: str, value: float, names: StageNames) -> float:
    """A coordinate in the unit of the interface: degrees or metres."""
    return math.degrees(value) if joint in names.angular else value


def _start(runs: list[dict[str, object]], folder: Path, seconds: float) -> str:
    """Run the child on some jobs; how it died, or "" when it ended well."""
    job = folder / "job.json"
    numbers = sorted({each.metadata["attribute"] for each in fields(HeldJoint)})
    asked = {"answers": str(folder), "runs": runs, "joint_numbers": numbers}
    job.write_text(json.dumps(asked), encoding="utf-8")
    path = json.dumps([os.path.abspath(p) for p in sys.path if p])  # noqa: PTH100
    command = [sys.executable, "-P", "-s", "-c", _PROGRAM, path, str(job)]
    ended = run_child(command, folder, seconds, {"TZ": "UTC", "LC_ALL": "C"})
    return f"PhysX {ended}" if ended else ""


def _outcome(
    folder: Path,
    names: StageNames,
    experiment: Experiment,
    failure: str,
    read: Callable[[dict[str, Any], StageNames], Any],  # Any: as `perform_in`
) -> Outcome:
    held, motion = None, None
    answer = folder / f"{experiment.name}.json"
    if answer.exists():
        held = read(json.loads(answer.read_bytes()), names)
    track = folder / f"{experiment.name}.npz"
    if track.exists():
        with np.load(track) as data:
            motion = _motion({key: data[key] for key in data.files}, names)
        if not failure and not motion.finite:
            failure = f"it lost its numbers (NaN) after {motion.time[-1]:.3g} s"
    return Outcome(held, motion, failure)


# --- from the interface's units to ours -----------------------------------------------------


def _held(raw: dict[str, Any], names: StageNames) -> Held:  # Any: JSON of the child
    roots = list(raw["articulations"].values())
    first = roots[0] if roots else {}
    return Held(
        articulations=len(roots),
        fixed_base=bool(first.get("isFixedBase", [0.0])[0]),
        X_world_root=_pose(first, "rootPosition", "rootOrientation"),
        dof=int(sum(root["dofCount"][0] for root in roots)),
        links={
            names.bodies.get(p, p): replace(
                _link(row),
                X_world_zero=_pose(raw.get("zero", {}).get(p), "position", "orientation"),
                X_world_turned=_pose(raw.get("turned", {}).get(p), "position", "orientation"),
            )
            for p, row in raw["links"].items()
        },
        joints={
            names.joints.get(p, p): _joint(row, names.joints.get(p) in names.angular)
            for p, row in raw["joints"].items()
        },
        shapes=int(sum(root["shapeCount"][0] for root in roots)),
        loose=tuple(sorted(names.bodies.get(p, p) for p in raw["loose"])),
    )


def _pose(row: dict[str, list[float]] | None, place: str, turn: str) -> Pose | None:
    if not row or not {place, turn} <= row.keys():
        return None
    x, y, z, w = row[turn]
    return Pose(vec3(row[place]), normalised_quat((w, x, y, z)))


def _link(row: dict[str, list[float]]) -> HeldLink:
    shapes = int(row["shapeCount"][0])
    columns = [row.get(key, []) for key in ("staticFriction", "dynamicFriction", "restitution")]
    return HeldLink(
        mass_kg=row["mass"][0],
        com_m=np.array(row["centerOfMassPosition"]),
        inertia=np.array(row["inertia"]).reshape(3, 3),
        surfaces=tuple(zip(*(column[:shapes] for column in columns), strict=True)),  # padded
    )


def _joint(row: dict[str, list[float]], angular: bool) -> HeldJoint:
    one = math.radians(1.0) if angular else 1.0
    values: dict[str, Any] = {}  # Any: numbers, None where nothing limits
    for each in fields(HeldJoint):
        said = each.metadata
        raw = row[said["attribute"]][said["end"]]
        endless = said["limit"] and abs(raw) >= UNLIMITED
        value = raw / one if said["angle"] < 0 else raw * one ** said["angle"]
        values[each.name] = None if endless else value
    return HeldJoint(**values)


def _motion(data: dict[str, Array], names: StageNames) -> Motion:
    joints = {}
    for column, path in enumerate(data["names"]):
        name = names.joints.get(str(path), str(path))
        one = math.radians(1.0) if name in names.angular else 1.0
        joints[name] = data["joints"][:, column] * one
    turn = data["turn"][:, [3, 0, 1, 2]]  # xyzw to wxyz
    return Motion(data["time"], joints, data["root"], turn, data["com"], seen=data.get("seen"))


# --- the experiments ------------------------------------------------------------------------


def free_fall_of(outcome: Outcome, setting: Setting, iterations: int) -> FreeFall:
    """The drop of the centre of mass against PhysX's own integrator.

    TGS applies gravity in each of N position iterations, so n steps of h from rest fall
    g/2 t (t + h / N), t = n h.
    """
    motion = outcome.motion
    if motion is None or not outcome.finite:
        return FreeFall(0.0, math.nan, math.nan, math.nan, finite=False)
    t, moved = float(motion.time[-1]), motion.com[-1] - motion.com[0]
    return fall_of(moved, t, np.asarray(setting.gravity), setting.timestep / iterations)
