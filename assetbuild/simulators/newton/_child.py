"""The program that runs Newton: reads the USD and the MJCF, and moves; runs without assetbuild.

MuJoCo on the CPU through `SolverMuJoCo`; see `_moving`. Newton's API as of 1.8.
"""

from __future__ import annotations

import math
from typing import Any

import _moving  # type: ignore[import-not-found]  # beside `_answering`
import numpy as np

KINDS = {
    "body": "body_mass",
    "joint": "jnt_type",
    "geom": "geom_type",
    "site": "site_type",
    "actuator": "actuator_trntype",
    "equality": "eq_type",
    "sensor": "sensor_type",
    "key": "key_time",
    "tendon": "tendon_adr",
}
"""What has names, and an array that has a row for each."""
LEFT_OUT = ("_", "mesh", "hfield", "tex", "bvh", "skin", "flex", "plugin", "names", "paths")
"""Beginnings of words of the model that nobody needs and that fill megabytes."""
LAW = {
    "kp": "kp",
    "kd": "kd",
    "max_effort": "maxEffort",
    "max_motor_effort": "maxMotorEffort",
    "saturation_effort": "saturationEffort",
    "velocity_limit": "velocityLimit",
}
"""Arrays of Newton's drives and clamps, and what the USD calls them."""


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Each run in turn; the answers are files."""
    import warp

    warp.config.quiet = True
    warp.set_device("cpu")
    for run in job["runs"]:
        try:
            result = _moving.perform(World(loaded(run["stage"]), run), run)
        except Exception as error:  # whatever Newton says is the answer
            result = {"failure": f"{type(error).__name__}: {error}"[:400]}
        _moving.write(job, run, result)
    return {}


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

    def __init__(self, model: Any, run: dict[str, Any]) -> None:
        import newton

        self.model, self.run = model, run
        apart, options = not run["contacts"], run["solver"]
        self.solver = newton.solvers.SolverMuJoCo(
            model, use_mujoco_cpu=True, disable_contacts=apart, **options
        )
        self.now, self.after, self.control = model.state(), model.state(), model.control()
        columns = ("joint_q_start", "joint_qd_start", "joint_target_q_start", "joint_type")
        q, qd, target, kinds = (getattr(model, name).numpy() for name in columns)
        one = (int(newton.JointType.REVOLUTE), int(newton.JointType.PRISMATIC))
        rows = {
            run["joints"].get(label, label): index
            for index, label in enumerate(model.joint_label)
            if int(kinds[index]) in one
        }
        self.positions = {name: int(q[i]) for name, i in rows.items()}
        self.targets = {name: int(target[i]) for name, i in rows.items()}
        self.speeds = {name: int(qd[i]) for name, i in rows.items()}
        self.bodies = {run["bodies"].get(p, p): i for i, p in enumerate(model.body_label)}
        self.first = {int(body): int(q[i]) for i, body in enumerate(model.joint_child.numpy())}
        """Body -> place of its joint's first coordinate."""

    def held(self) -> Any:
        """The solver's model."""
        return readings(self.model, self.solver.mj_model, self.run)

    def start(self, positions: dict[str, float]) -> None:
        """Put the joints where they begin."""
        import newton

        put(self.model.joint_q, self.positions, positions)
        self.now = self.model.state()
        newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.now)

    def command(self, targets: dict[str, float], speeds: dict[str, float]) -> None:
        """What drives are asked for."""
        put(self.control.joint_target_q, self.targets, targets)
        put(self.control.joint_target_qd, self.speeds, speeds)

    def push(self, table: list[float], force: list[float]) -> None:
        """Move the table and shake the object."""
        first = self.first[self.bodies[_moving.TABLE]]
        places = {str(axis): first + axis for axis in range(3)}
        put(self.now.joint_q, places, {str(axis): at for axis, at in enumerate(table)})
        forces = self.now.body_f.numpy()
        forces[self.bodies[_moving.OBJECT]] = [*force, 0.0, 0.0, 0.0]
        self.now.body_f.assign(forces)

    def step(self, dt: float) -> None:
        """One step."""
        self.solver.step(self.now, self.after, self.control, None, dt)
        self.now, self.after = self.after, self.now

    def look(self) -> Any:
        """Where all is now."""
        q, poses = self.now.joint_q.numpy(), self.now.body_q.numpy()[:, [0, 1, 2, 6, 3, 4, 5]]
        mass, centres = self.model.body_mass.numpy(), self.model.body_com.numpy()
        places = [p[:3] + _moving.turned(p[3:], c) for p, c in zip(poses, centres, strict=True)]
        joints = {name: float(q[at]) for name, at in self.positions.items()}
        root = poses[int(self.model.joint_child.numpy()[0])]
        centre = mass @ np.array(places) / mass.sum()
        return root, centre, joints, lambda name: poses[self.bodies[name]]


def put(array: Any, places: dict[str, int], values: dict[str, float]) -> None:
    """Write rad or m into one of Newton's arrays; does nothing without values."""
    if values:
        numbers = array.numpy()
        for name, value in values.items():
            numbers[places[name]] = value
        array.assign(numbers)


# --- what the solver holds, as MuJoCo's compiled model -------------------------------------------

# The arrays of that model go out as they are: who reads MuJoCo's own model reads this one too.


def readings(model: Any, held: Any, run: dict[str, Any]) -> dict[str, Any]:
    """The solver's model as plain values, and the laws of drives that act outside of it.

    run: has the robot's names by what the file calls them, its whole path or the end of it.
    """
    values = plain(held) | {"opt": plain(held.opt), "laws": laws(model, run["joints"])}
    values["names"] = {
        kind: [getattr(held, kind)(index).name for index in range(len(values[count]))]
        for kind, count in KINDS.items()
    }
    for kind, names, known in (
        ("body", run["bodies"], model.body_label),
        ("joint", run["joints"], model.joint_label),
    ):
        # The solver's name of a label is its path with `_` in place of `/`.
        labels = {label.strip("/").replace("/", "_").strip("_"): label for label in known}
        words = [word.strip("_") for word in values["names"][kind]]
        values["names"][kind] = [called(labels.get(word, word), names) for word in words]
    margins, gaps = model.shape_margin.numpy(), model.shape_gap.numpy()
    for index, word in enumerate(values["names"]["geom"]):
        label, _, shape = word.rpartition("_")  # Newton appends its number
        if shape.isdigit():  # margin and gap are Newton's, whose solver has none
            values["names"]["geom"][index] = called(label, run.get("shapes", {}))
            values["geom_margin"][index] = float(margins[int(shape)])
            values["geom_gap"][index] = float(gaps[int(shape)])
    return values


def plain(held: Any) -> dict[str, Any]:
    """Numbers and arrays of one of MuJoCo's structures."""
    words = [word for word in dir(held) if not word.startswith(LEFT_OUT)]
    values = {word: getattr(held, word) for word in words}
    return {
        word: value.tolist() if isinstance(value, np.ndarray) else value
        for word, value in values.items()
        if isinstance(value, int | float | np.ndarray)
    }


def called(label: str, names: dict[str, str]) -> str:
    """The robot's name of a label."""
    end = label.rsplit("/", 1)[-1]
    return names.get(label, names.get(end, end))


def laws(model: Any, names: dict[str, str]) -> dict[str, dict[str, float | None]]:
    """Return the law of each joint's `NewtonActuator`: gains, what limits the effort, SI, rad."""
    starts = [int(start) for start in model.joint_qd_start.numpy()]
    labels = dict(zip(starts, model.joint_label, strict=False))
    by_joint: dict[str, dict[str, float | None]] = {}
    for group in model.actuators:
        columns = {
            word: getattr(part, name).numpy()
            for part in (group.drive, *group.clamping)
            for name, word in LAW.items()
            if getattr(part, name, None) is not None
        }
        for row, dof in enumerate(group.indices.numpy()):
            values = {word: float(column[row]) for word, column in columns.items()}
            by_joint[called(labels[int(dof)], names)] = {
                word: value if math.isfinite(value) else None for word, value in values.items()
            }
    return by_joint
