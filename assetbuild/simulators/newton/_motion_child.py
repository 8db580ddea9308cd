"""Newton moves: the experiments that PhysX does, on the same stages; runs without assetbuild.

MuJoCo on the CPU through `SolverMuJoCo`. Answers lie in the job's folder as PhysX's program writes
them: `<run>.json` (what Newton holds) and `<run>.npz` (what it did), joints in degrees or metres,
quaternions xyzw. Newton's API as of 1.8.
"""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import _child as reading  # type: ignore[import-not-found]  # beside this file


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Each run in turn; an exception ends the program, and whoever started it goes on."""
    import numpy

    reading.quiet_cpu()
    answers = Path(job["answers"])
    for run in job["runs"]:
        from newton.solvers import SolverMuJoCo

        model = reading.loaded("usd", run["stage"])
        solver = SolverMuJoCo(model, use_mujoco_cpu=True, disable_contacts=not run["contacts"])
        if run["steps"]:
            numpy.savez(answers / f"{run['name']}.npz", **moved(model, solver, run))
        else:
            held = reading.readings(model, solver.mj_model, usd=True)
            held["touching"] = touching(model, solver.mj_model)
            (answers / f"{run['name']}.json").write_text(json.dumps(held), encoding="utf-8")
        (answers / f"{run['name']}.done").touch()
    return {}


def moved(model: Any, solver: Any, run: dict[str, Any]) -> dict[str, Any]:
    """Trajectories, the start included, until something is not finite."""
    import newton
    import numpy

    joints = Joints(model)
    joints.put(model.joint_q, joints.positions, run["start"])
    now, after, control = model.state(), model.state(), model.control()
    newton.eval_fk(model, model.joint_q, model.joint_qd, now)
    drive, mass = run["targets"], model.body_mass.numpy()
    centres, root = model.body_com.numpy(), int(model.joint_child.numpy()[0])
    tracks: dict[str, list[Any]] = {"time": [], "root": [], "turn": [], "com": [], "joints": []}
    for step in range(run["steps"] + 1):
        if step:
            if drive["joints"] and (drive["frequency"] or step == 1):
                asked, speeds = asked_at(drive, run["dt"] * step)
                joints.put(control.joint_target_q, joints.targets, asked)
                joints.put(control.joint_target_qd, joints.speeds, speeds)
            solver.step(now, after, control, None, run["dt"])
            now, after = after, now
        if step % run["every"] and step != run["steps"]:
            continue
        poses = now.body_q.numpy().copy()  # on the CPU it is a view of what the next step writes
        places = poses[:, :3] + numpy.array(
            [turned(p[3:], c) for p, c in zip(poses, centres, strict=True)]
        )
        tracks["time"].append(run["dt"] * step)
        tracks["root"].append(poses[root, :3])
        tracks["turn"].append(poses[root, 3:])
        tracks["com"].append(mass @ places / mass.sum())
        tracks["joints"].append(joints.shown(now.joint_q))
        if not all(numpy.isfinite(track[-1]).all() for track in tracks.values()):
            break
    found = {key: numpy.array(track, dtype=float) for key, track in tracks.items()}
    return found | {"names": numpy.array(list(joints.positions), dtype=str)}


def asked_at(drive: dict[str, Any], time: float) -> tuple[dict[str, float], dict[str, float]]:
    """Position and speed targets of the driven joints: middle + swing sin(2 pi f t)."""
    omega = 2.0 * math.pi * drive["frequency"]
    places = {p: m + s * math.sin(omega * time) for p, (m, s) in drive["joints"].items()}
    speeds = {p: drive["joints"][p][1] * omega * math.cos(omega * time) for p in drive["speeds"]}
    return places, speeds


def turned(quat: Any, vector: Any) -> Any:
    """The vector in the world; quat: xyzw."""
    import numpy

    x, w = quat[:3], quat[3]
    half = 2.0 * numpy.cross(x, vector)
    return vector + w * half + numpy.cross(x, half)


class Joints:
    """Where each joint of one coordinate lies in Newton's arrays, by the path of its prim."""

    def __init__(self, model: Any) -> None:
        import newton

        q, qd, target = (
            a.numpy()
            for a in (model.joint_q_start, model.joint_qd_start, model.joint_target_q_start)
        )
        kinds = model.joint_type.numpy()
        one = {int(newton.JointType.REVOLUTE), int(newton.JointType.PRISMATIC)}
        rows = {
            label: i
            for i, (label, kind) in enumerate(zip(model.joint_label, kinds, strict=True))
            if int(kind) in one
        }
        self.turning = {p for p, i in rows.items() if int(kinds[i]) == newton.JointType.REVOLUTE}
        self.positions = {path: int(q[i]) for path, i in rows.items()}
        self.targets = {path: int(target[i]) for path, i in rows.items()}
        self.speeds = {path: int(qd[i]) for path, i in rows.items()}

    def put(self, array: Any, places: dict[str, int], values: dict[str, float]) -> None:
        """Write degrees or metres into one of Newton's arrays; does nothing without values."""
        if not values:
            return
        numbers = array.numpy()
        for path, value in values.items():
            numbers[places[path]] = math.radians(value) if path in self.turning else value
        array.assign(numbers)

    def shown(self, array: Any) -> list[float]:
        """Degrees or metres, in the order of `positions`."""
        numbers = array.numpy()
        return [
            math.degrees(float(numbers[at])) if path in self.turning else float(numbers[at])
            for path, at in self.positions.items()
        ]


def touching(model: Any, held: Any) -> list[list[str]]:
    """Pairs of bodies, by name, that the solver's masks, excludes and own filter let touch."""
    names = {"_".join(p.strip("/").split("/")): p.rsplit("/", 1)[-1] for p in model.body_label}
    excluded = {int(signature) for signature in held.exclude_signature}
    solid = [i for i in range(held.ngeom) if held.geom_contype[i] or held.geom_conaffinity[i]]
    pairs = [(int(held.pair_geom1[i]), int(held.pair_geom2[i])) for i in range(held.npair)]
    for a, b in itertools.combinations(solid, 2):
        one, two = sorted((int(held.geom_bodyid[a]), int(held.geom_bodyid[b])))
        masks = (held.geom_contype[a] & held.geom_conaffinity[b]) | (
            held.geom_contype[b] & held.geom_conaffinity[a]
        )
        if masks and (one << 16) + two not in excluded and not passes(held, one, two):
            pairs.append((a, b))
    found = set()
    for pair in pairs:
        bodies = [held.body(int(held.geom_bodyid[geom])).name.strip("_") for geom in pair]
        if "world" not in bodies:
            found.add(tuple(sorted(names.get(body, body) for body in bodies)))
    return [list(pair) for pair in sorted(found)]


def passes(held: Any, one: int, two: int) -> bool:
    """Whether both are one rigid piece, or parent and child that both move."""
    here, there = int(held.body_weldid[one]), int(held.body_weldid[two])
    above = [int(held.body_weldid[held.body_parentid[weld]]) for weld in (here, there)]
    return here == there or (0 not in (here, there) and (here == above[1] or there == above[0]))
