"""The program that runs PhysX: one process, one job, native crashes and all.

`ovphysx` brings a USD runtime of its own and may crash, hang or return NaN; so it never shares a
process with `pxr` or with a step. It takes and tells degrees and quaternions xyzw; what goes in and
out here is SI, quaternions wxyz, by the robot's own names: see `_moving`.
"""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Mapping, Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import _moving  # type: ignore[import-not-found]  # beside `_answering`
import numpy as np

Array = Any  # numpy.ndarray
Run = dict[str, Any]  # Any: JSON

COMMANDS = ("jointPositionTarget", "jointVelocityTarget")
UNLIMITED = 3.0e38
"""PhysX writes the largest float32 where nothing limits."""
LINK = {
    "mass": "mass",
    "inertia": "inertia",
    "centre of mass": "centerOfMassPosition",
    "shapes": "shapeCount",
    "static friction": "staticFriction",
    "dynamic friction": "dynamicFriction",
    "restitution": "restitution",
}
JOINT = {
    "start": ("jointPosition", 1, 0),
    "drive target": ("jointPositionTarget", 1, 0),
    "lower": ("jointLimit", 1, 0),
    "upper": ("jointLimit", 1, 1),
    "kp": ("jointStiffness", -1, 0),
    "kd": ("jointDamping", -1, 0),
    "effort": ("jointMaxForce", 0, 0),
    "velocity": ("jointMaxVelocity", 1, 0),
    "armature": ("jointArmature", 0, 0),
    "friction": ("jointStaticFriction", 0, 0),
    "physx:dynamic friction": ("jointDynamicFriction", 0, 0),
    "damping": ("jointViscousFriction", -1, 0),
    "physx:drive": ("jointDriveType", 0, 0),
}
"""Our word -> (PhysX's attribute, power of the coordinate's unit in it, place in the attribute)."""


def answer(job: Run) -> Run:
    """Do all runs; the answers are files."""
    import ovstage
    from ovphysx import GlobalConfigKey, PhysX, set_global_config

    PhysX.set_cpu_mode(True)
    # A pool of threads crawls on a shared machine: step in this one.
    set_global_config(GlobalConfigKey.NUM_THREADS, 0)
    sim = PhysX()
    # Newton's schema stays unregistered: its spelling of a number would hide the loss of PhysX's.
    schemas = distribution("physx-usd-schemas")
    names = ("PhysxSchema", "OmniUsdPhysicsDeformableSchema")
    folders = [schemas.locate_file(f"physx_usd_schemas/{name}/resources") for name in names]
    ovstage.population.register_usd_schemas([str(folder) for folder in folders])
    for run in job["runs"]:
        _perform(sim, job, run)
    sim.destroy()
    return {}


def _perform(sim: Any, job: Run, run: Run) -> None:  # Any: ovphysx.PhysX
    """Load one stage; write down what PhysX holds, or where it went."""
    import ovstage

    stage = ovstage.Stage(run["name"])
    everything = ovstage.PopulationDomain.ALL
    ovstage.population.open_usd(stage, run["stage"], ordinal=1, domains=everything)
    stage.advance_write_floor(ordinal=1).wait()
    sim.wait_task(sim.attach_ovstage(stage, read_ordinal=1))
    sim.wait_all()
    world = World(sim, ovstage.PathDictionary(stage), run)
    try:
        result = _moving.perform(world, run)
        _moving.write(job, run, result)
        if not result.get("motion", {}).get("finite", True):
            # PhysX does not come back from a NaN: the next stage gets a fresh process.
            (Path(job["answers"]) / "answer.json").write_text("{}", encoding="utf-8")
            os._exit(0)
    finally:
        del world
        gc.collect()
        sim.wait_task(sim.detach_ovstage())
        stage.destroy()


class World:
    """A loaded stage. paths: ovstage.PathDictionary; run: see `simulators.physx`."""

    def __init__(self, sim: Any, paths: Any, run: Run) -> None:
        from ovphysx.types import SimObjectType

        self.sim, self.paths, self.run = sim, paths, run
        self.kinds = SimObjectType
        names = run["joints"]
        angular = {path for path, name in names.items() if name in run["angular"]}
        self.unit = {path: math.radians(1.0) if path in angular else 1.0 for path in names}
        """rad or m in PhysX's unit of a joint's coordinate."""
        self.joint_paths = {name: path for path, name in names.items()}
        self.counted = self.joint_order()

    # --- reading and writing ----------------------------------------------------------------

    def read(self, kind: Any, attribute: str) -> dict[str, Array]:  # Any: an enumeration's member
        """Values by path. Copied at once: a live alias keeps the simulation from closing."""
        from ovphysx.types import ObjectScope

        values: dict[str, Array] = {}
        with self.sim.read_sync(kind, [attribute], scope=ObjectScope.ALL) as result:
            for group in result.groups:
                if group.is_delete or not group.tensors:
                    continue
                names = [str(name) for name in self.paths.get_path_strings(group.prim_list)]
                arrays = [np.array(tensor.numpy(), copy=True) for tensor in group.tensors]
                # A fixed group stacks its prims in one array, an array group has one for each.
                rows = arrays if len(arrays) == len(names) else list(arrays[0])
                values |= {
                    n: np.ravel(row).astype(float) for n, row in zip(names, rows, strict=True)
                }
        return values

    def joint_order(self) -> list[str]:
        """Paths of the joints in the order of the articulation's coordinates, as Isaac Lab's."""
        from ovphysx.types import ObjectScope

        kind, column = self.kinds.ARTICULATION, ["dofJointPath"]
        with self.sim.read_sync(kind, column, scope=ObjectScope.ALL) as result:
            handles = [np.ravel(t.numpy()) for group in result.groups for t in group.tensors]
            return [self.paths.path_to_string(int(h)) for row in handles for h in row if h]

    def write(self, attribute: str, values: Mapping[str, float]) -> None:
        """Write one value for each joint, by path; there is no mask, so it must name them all."""
        if not values:
            return
        with self.sim.write_sync(self.kinds.ARTICULATION_JOINT, attribute) as writing:
            for group in writing.groups:
                # Each group has its own order, so the names are asked of this very group.
                names = self.paths.get_path_strings(group.prim_list)
                for name, tensor in zip(names, group.tensors, strict=True):
                    tensor.numpy()[...] = values[str(name)]
                writing.commit_sync(group)

    def joints(self, attribute: str) -> dict[str, float]:
        """One number of every joint, by path, in PhysX's unit."""
        rows = self.read(self.kinds.ARTICULATION_JOINT, attribute)
        return {path: float(values[0]) for path, values in rows.items()}

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values by path, in PhysX's unit, from our names and SI; of joints that PhysX knows."""
        return {
            self.joint_paths[name]: value / self.unit[self.joint_paths[name]]
            for name, value in values.items()
            if name in self.joint_paths
        }

    def poses(self, kind: Any, place: str, turn: str) -> dict[str, list[float]]:  # Any: as above
        """(7,) xyz and quaternion wxyz by path."""
        places, turns = self.read(kind, place), self.read(kind, turn)
        return {path: [*xyz, *np.roll(turns[path], 1)] for path, xyz in places.items()}

    # --- what PhysX holds -------------------------------------------------------------------

    def held(self) -> Run:
        """Facts of roots, bodies and joints."""
        kinds, bodies = self.kinds, self.run["bodies"]
        roots = {
            word: self.read(kinds.ARTICULATION, attribute)
            for word, attribute in (
                ("fixed", "isFixedBase"), ("dof", "dofCount"), ("shapes", "shapeCount"),
            )
        }  # fmt: skip
        at = self.poses(kinds.ARTICULATION, "rootPosition", "rootOrientation")
        links = {word: self.read(kinds.ARTICULATION_LINK, name) for word, name in LINK.items()}
        joints = self.joint_rows()
        zero, turned = self.places()  # moves the joints
        loose = self.read(kinds.RIGID_BODY, "mass")
        return {
            "articulations": len(at),
            "fixed_base": any(bool(row[0]) for row in list(roots["fixed"].values())[:1]),
            "root": next(iter(at.values()), None),
            "dof": int(sum(row[0] for row in roots["dof"].values())),
            "shapes": int(sum(row[0] for row in roots["shapes"].values())),
            "loose": sorted(bodies.get(path, path) for path in loose),
            "bodies": {
                bodies.get(path, path): {word: rows[path].tolist() for word, rows in links.items()
                                         if path in rows}
                | {"zero": zero.get(path), "turned": turned.get(path)}
                for path in links["mass"]
            },
            "joints": joints,
        }  # fmt: skip

    def joint_rows(self) -> Run:
        """Facts of joints by name, SI; None where nothing limits."""
        attributes = {attribute for attribute, *_ in JOINT.values()}
        rows = {a: self.read(self.kinds.ARTICULATION_JOINT, a) for a in attributes}
        facts: Run = {}
        for path in rows["jointPosition"]:
            one = self.unit.get(path, 1.0)
            joint = facts.setdefault(self.run["joints"].get(path, path), {})
            for word, (attribute, power, end) in JOINT.items():
                raw = float(rows[attribute][path][end])
                value = raw / one if power < 0 else raw * one**power
                joint[word] = None if abs(raw) >= UNLIMITED else value
        return facts

    def places(self) -> list[dict[str, list[float]]]:
        """Poses of the links with every joint at 0, and with every joint at `turn`."""
        link_poses, here = [], self.joints("jointPosition")
        turned = self.own(dict.fromkeys(self.run["joints"].values(), float(self.run["turn"])))
        for values in (dict.fromkeys(here, 0.0), dict.fromkeys(here, 0.0) | turned):
            # This moves links; `update_articulations_kinematic` would let drives and limits pull.
            self.write("jointPosition", values)
            link_poses.append(self.poses(self.kinds.ARTICULATION_LINK, "position", "orientation"))
        return link_poses

    # --- what it does -----------------------------------------------------------------------

    def start(self, positions: Mapping[str, float]) -> None:
        """Put the joints where they begin."""
        self.write("jointPosition", self.joints("jointPosition") | self.own(positions))
        self.asked = {word: self.joints(word) for word in COMMANDS}
        self.sim.update_articulations_kinematic()

    def command(self, *now: Mapping[str, float]) -> None:
        """Write targets and speeds of this step, where there are any."""
        for word, values in zip(COMMANDS, now, strict=True):
            if values:
                self.asked[word] |= self.own(values)
                self.write(word, self.asked[word])

    def push(self, table: Sequence[float], force: Sequence[float]) -> None:
        """Move the table and shake the object."""
        for path, attribute, value in (
            (_moving.TABLE, "kinematicTargetPosition", table),
            (_moving.OBJECT, "force", force),
        ):
            with self.sim.write_sync(self.kinds.RIGID_BODY, attribute, pattern=path) as writing:
                for group in writing.groups:
                    group.tensors[0].numpy()[...] = value
                    writing.commit_sync(group)

    def step(self, dt: float) -> None:
        """One step."""
        self.sim.step_sync(dt)

    def look(self) -> Any:
        """Where all is now."""
        kind, names = self.kinds.ARTICULATION, self.run["joints"]
        root = next(iter(self.poses(kind, "rootPosition", "rootOrientation").values()))
        centre = next(iter(self.read(kind, "centerOfMassWorld").values()))
        places = self.joints("jointPosition")
        joints = {
            names.get(path, path): places[path] * self.unit.get(path, 1.0) for path in self.counted
        }
        return root, centre, joints, self.pose

    def pose(self, name: str) -> list[float]:
        """The pose of a link, or of the object."""
        if name == _moving.OBJECT:
            return self.poses(self.kinds.RIGID_BODY, "position", "orientation")[name]
        links = self.poses(self.kinds.ARTICULATION_LINK, "position", "orientation")
        return next(links[path] for path, body in self.run["bodies"].items() if body == name)
