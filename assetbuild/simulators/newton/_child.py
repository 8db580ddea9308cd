"""The program that runs Newton: reads the USD and the MJCF, and moves; runs without assetbuild.

MuJoCo on the CPU through `SolverMuJoCo`. What goes in and out is as of PhysX's program: SI, by the
robot's own names, in `<run>.json` beside the job. Newton's API as of 1.8.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import _reading as reading  # type: ignore[import-not-found]  # beside this file
import numpy as np

TABLE, OBJECT = "/World/table", "/World/object"
"""As `stage_world` defines them."""


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Each run in turn; the answers are files."""
    import warp

    warp.config.quiet = True
    warp.set_device("cpu")
    for run in job["runs"]:
        try:
            found = tried(run)
        except Exception as error:  # whatever Newton says is the answer
            found = {"failure": f"{type(error).__name__}: {error}"[:400]}
        path = Path(job["answers"]) / f"{run['name']}.json"
        path.write_text(json.dumps(found), encoding="utf-8")
    return {}


def tried(run: dict[str, Any]) -> dict[str, Any]:
    """What Newton holds of a file, or how it moves; both where the run asks so."""
    from newton.solvers import SolverMuJoCo

    model, own = loaded(run["stage"]), run.get("solver", {})
    apart = not run["contacts"]
    solver = SolverMuJoCo(model, use_mujoco_cpu=True, disable_contacts=apart, **own)
    found: dict[str, Any] = {}
    if not run["steps"] or run.get("reads"):
        found["held"] = reading.readings(model, solver.mj_model, run)
    if run["steps"]:
        found["motion"] = World(model, solver, run).moved()
    return found


def loaded(file: str) -> Any:
    """The finished model of a USD or an MJCF."""
    import newton
    from newton.usd import SchemaResolverNewton, SchemaResolverPhysx

    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    if file.endswith(".xml"):
        builder.add_mjcf(file)
    else:
        resolvers = [SchemaResolverNewton(), SchemaResolverPhysx()]
        builder.add_usd(file, schema_resolvers=resolvers)
    return builder.finalize()


class World:
    """A model and where each joint of one coordinate and each body lies in Newton's arrays."""

    def __init__(self, model: Any, solver: Any, run: dict[str, Any]) -> None:
        import newton

        self.model, self.solver, self.run = model, solver, run
        self.now, self.after, self.control = model.state(), model.state(), model.control()
        columns = ("joint_q_start", "joint_qd_start", "joint_target_q_start", "joint_type")
        q, qd, target, kinds = (getattr(model, name).numpy() for name in columns)
        one = (int(newton.JointType.REVOLUTE), int(newton.JointType.PRISMATIC))
        names = run.get("joints", {})
        rows = {
            names.get(label, label): index
            for index, label in enumerate(model.joint_label)
            if int(kinds[index]) in one
        }
        self.positions = {name: int(q[i]) for name, i in rows.items()}
        self.targets = {name: int(target[i]) for name, i in rows.items()}
        self.speeds = {name: int(qd[i]) for name, i in rows.items()}
        self.bodies = {run.get("bodies", {}).get(p, p): i for i, p in enumerate(model.body_label)}
        self.first = {int(body): int(q[i]) for i, body in enumerate(model.joint_child.numpy())}
        """Of each body, the place of its joint's first coordinate."""

    def put(self, array: Any, places: dict[str, int], values: dict[str, float]) -> None:
        """Write rad or m into one of Newton's arrays; does nothing without values."""
        if values:
            numbers = array.numpy()
            for name, value in values.items():
                numbers[places[name]] = value
            array.assign(numbers)

    def moved(self) -> dict[str, Any]:
        """Trajectories, the start included, until something is not finite."""
        import newton

        run, model, course = self.run, self.model, self.run.get("course")
        self.put(model.joint_q, self.positions, run.get("start", {}))
        self.now = model.state()
        newton.eval_fk(model, model.joint_q, model.joint_qd, self.now)
        track: dict[str, Any] = {"time": [], "root": [], "com": [], "seen": [], "joints": {}}
        for step in range(run["steps"] + 1):
            if step:
                for array, places, rows in (
                    (self.control.joint_target_q, self.targets, run.get("targets", {})),
                    (self.control.joint_target_qd, self.speeds, run.get("speeds", {})),
                ):
                    asked = {name: row[step - 1] for name, row in rows.items() if step <= len(row)}
                    self.put(array, places, asked)
                if course:
                    self.push(course, step)
                self.solver.step(self.now, self.after, self.control, None, run["dt"])
                self.now, self.after = self.after, self.now
            if step % run.get("every", 1) and step != run["steps"]:
                continue
            track["time"].append(run["dt"] * step)
            if not self.look(track, course["watched"] if course else []):
                break
        return track

    def look(self, track: dict[str, Any], watched: list[str]) -> bool:
        """Add where everything is now; whether all of it is finite."""
        q, poses = self.now.joint_q.numpy(), self.now.body_q.numpy()
        mass, centres = self.model.body_mass.numpy(), self.model.body_com.numpy()
        root = poses[int(self.model.joint_child.numpy()[0])]
        places = [p[:3] + turned(p[3:], c) for p, c in zip(poses, centres, strict=True)]
        track["root"].append([*root[:3].tolist(), float(root[6]), *root[3:6].tolist()])
        track["com"].append((mass @ np.array(places) / mass.sum()).tolist())
        for name, at in self.positions.items():
            track["joints"].setdefault(name, []).append(float(q[at]))
        if watched:
            at = poses[self.bodies[OBJECT], :3]
            frames = [poses[self.bodies[name]] for name in watched]
            seen = [turned([*-f[3:6], f[6]], at - f[:3]).tolist() for f in frames]
            track["seen"].append(seen)
        return bool(np.isfinite(q).all() and np.isfinite(poses).all())

    def push(self, course: dict[str, Any], step: int) -> None:
        """Move the table and shake the object as the course says for this step."""
        first = self.first[self.bodies[TABLE]]
        places = {str(axis): first + axis for axis in range(3)}
        table = {str(axis): value for axis, value in enumerate(course["table"][step - 1])}
        self.put(self.now.joint_q, places, table)
        forces = self.now.body_f.numpy()
        forces[self.bodies[OBJECT]] = [*course["force"][step - 1], 0.0, 0.0, 0.0]
        self.now.body_f.assign(forces)


def turned(quat: Any, vector: Any) -> Any:
    """The vector in the world; quat: xyzw."""
    x, w = np.asarray(quat[:3]), quat[3]
    half = 2.0 * np.cross(x, vector)
    return vector + w * half + np.cross(x, half)
