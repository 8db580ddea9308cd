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
from typing import Any, ClassVar

import numpy as np

from assetbuild.engine.step import Limits
from assetbuild.findings import Rule
from assetbuild.robot.pose import IDENTITY, Array, Pose, normalised_quat, vec3
from assetbuild.simulators.children import ask
from assetbuild.simulators.experiments import (
    Course,
    Experiment,
    Motion,
    Outcome,
    SimulatorCheck,
    Sine,
)
from assetbuild.simulators.physx.scene import StageNames, write_world

REQUIRES: Mapping[str, str] = {"ovphysx": "physx", "physx_usd_schemas": "physx"}
"""Modules of the extra, for `Check.requires`."""
BEYOND_IMPORTS = ("assetbuild.simulators.physx._child", "physx_usd_schemas")
PRELOAD = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")
"""`Step.preload` of a check that opens stages here."""
ITERATIONS: Mapping[str, str] = {"iterations": "usd.articulation.solver_position_iterations"}
"""For `Check.told` of checks that know how often the solver applies gravity in a step."""
TURN = 0.5
"""rad or m; a position of joints at which their axes show."""
UNLIMITED = 3.0e38
"""PhysX writes the largest float32 where nothing limits."""
CLEARANCE_M = 1e-3
"""How far above the floor a standing pose starts: a sole that starts inside of it by the smallest
amount is thrown out with all of `maxDepenetrationVelocity` in the first step."""
_PROGRAM = Path(__file__).with_name("_child.py")

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


def clear_of_floor(base: Pose | None) -> Pose:
    """A standing pose, a hair higher."""
    base = base or IDENTITY
    x, y, z = base.xyz
    return Pose((x, y, z + CLEARANCE_M), base.quat)


class PhysxCheck(SimulatorCheck):
    """Base of the checks that ask PhysX."""

    usual_s = 30.0
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    requires: ClassVar[Mapping[str, str]] = REQUIRES
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = PRELOAD
    limits: ClassVar[Limits] = Limits(wall_s=900.0, memory_mb=16384)
    engines: ClassVar[tuple[str, ...]] = ("physx",)
    engine: ClassVar[str] = "PhysX"

    def perform(self, inputs: Path, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
        """Run experiments on `usd/`."""
        return perform(inputs / f"usd/{self.robot}.usda", experiments, self.limits.wall_s / 2.0)


def perform(
    main: Path, experiments: Sequence[Experiment], seconds: float = 240.0, *, copied: bool = True
) -> dict[str, Outcome]:
    """Run experiments in PhysX on the asset `main`, by name. A crash or a NaN ends only its own.

    seconds: wall-clock limit of the whole. copied: with its whole folder, as the inputs of a step
    must be: they are links into the store, and a resolver that follows them gets lost.
    """

    def start(job: dict[str, object], folder: Path) -> str:
        numbers = sorted({each.metadata["attribute"] for each in fields(HeldJoint)})
        path = os.pathsep.join(os.path.abspath(p) for p in sys.path if p)  # noqa: PTH100
        variables = {"TZ": "UTC", "LC_ALL": "C", "PYTHONPATH": path}
        asked = job | {"joint_numbers": numbers}
        return ask(Path(sys.executable), _PROGRAM, asked, folder, seconds, variables)[1]

    return perform_in(start, _held, main, experiments, copied=copied)


def perform_in(
    start: Callable[[dict[str, object], Path], str],
    read: Callable[[dict[str, Any], StageNames], Any],  # Any: JSON; what an engine holds
    main: Path,
    experiments: Sequence[Experiment],
    *,
    copied: bool = True,
) -> dict[str, Outcome]:
    """As `perform`, in another engine that reads the same stages.

    start: does a job in a folder; how it died, or "" when it ended well. read: what the engine then
    holds.
    """
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
            jobs[experiment.name] = (names, _job(experiment, names, stage))
        waiting, failures = list(jobs), dict[str, str]()
        while waiting:
            runs = [jobs[name][1] for name in waiting]
            died = start({"answers": str(folder), "runs": runs}, folder)
            done = [n for n in waiting if (folder / f"{n}.done").exists()]
            waiting = waiting[len(done) :]
            if waiting and died:
                failures[waiting.pop(0)] = died
            elif not done and waiting:
                failures |= dict.fromkeys(waiting, "it stopped without a word")
                waiting = []
        return {
            name: _outcome(folder / name, names, failures.get(name, ""), read)
            for name, (names, _) in jobs.items()
        }


def _job(experiment: Experiment, names: StageNames, stage: Path) -> dict[str, object]:
    paths = {name: path for path, name in names.joints.items()}

    def shown(values: Mapping[str, float]) -> dict[str, float]:
        """By path, in the unit of the interface: degrees or metres."""
        return {
            paths[name]: math.degrees(value) if name in names.angular else value
            for name, value in values.items()
            if name in paths
        }

    sine, start = experiment.sine, experiment.start or {}
    if sine is None:  # servos that the asset does not know have no target there: hold the start
        servos = experiment.setting.drives or {}
        held = {name: value for name, value in start.items() if name in servos}
        sine = Sine(held, dict.fromkeys(held, 0.0), frequency_hz=0.0)
    middle, swing = shown(sine.middle), shown(sine.swing)
    return {
        "name": experiment.name,
        "stage": str(stage),
        "dt": experiment.setting.timestep,
        "steps": experiment.steps,
        "every": experiment.every,
        "contacts": experiment.setting.contacts,
        "start": shown(start),
        "turn": shown(dict.fromkeys(paths, TURN)),
        "course": _write_course(stage, experiment.course, names) if experiment.course else "",
        "targets": {
            "frequency": sine.frequency_hz,
            "joints": {path: (middle[path], swing[path]) for path in middle},
            "speeds": [paths[name] for name in sine.speeds if name in paths],
        },
    }


def _write_course(stage: Path, course: Course, names: StageNames) -> str:
    """The file that the child reads; angles in degrees, bodies and joints by path."""
    joints = {name: path for path, name in names.joints.items()}
    bodies = {name: path for path, name in names.bodies.items()}
    targets = [
        np.degrees(track) if joint in names.angular else track
        for joint, track in course.targets.items()
    ]
    path = stage.with_suffix(".course.npz")
    np.savez(
        path,
        drives=[joints[joint] for joint in course.targets],
        targets=np.stack(targets, axis=1),
        table=course.table,
        force=course.force,
        watched=[bodies[body] for body in course.watched],
    )
    return str(path)


def _outcome(
    answer: Path,
    names: StageNames,
    failure: str,
    read: Callable[[dict[str, Any], StageNames], Any],  # Any: as `perform_in`
) -> Outcome:
    """answer: without its suffix."""
    held, motion = None, None
    if (said := answer.with_name(f"{answer.name}.json")).exists():
        held = read(json.loads(said.read_bytes()), names)
    if (track := answer.with_name(f"{answer.name}.npz")).exists():
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
