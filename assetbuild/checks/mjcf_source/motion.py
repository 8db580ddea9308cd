"""Both models in the same positions, at the same speeds, under the same commands.

It shows what counts from a joint's `ref`, such as laws of drives and springs of tendons, and that
all facts together make the same robot.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from assetbuild.checks.mjcf_source.at_rest import FREE, ROUGH, Side
from assetbuild.facts.mjcf_fields import subjects
from assetbuild.findings import Finding, Rule
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model

POSITIONS = 6
TOLERANCE = 1e-9
"""Relative to the size of what is compared; sums of sines and cosines round to about 1e-15."""
SOLVED = 1e-5
"""Constraints are solved to the solver's tolerance, not to rounding."""
ITERATIONS, SOLVER_TOLERANCE = 200, 1e-14
"""Enough for both models to come to the same end, whatever the source asks for."""
ROUNDING = 1e-11
"""Absolute, SI units."""

MOVES = Rule(
    "equal.source.*",
    "error",
    "our MJCF differs from the MJCF that it was read from, at rest or moving",
    "report it with both numbers: this is a bug",
)
Pairs = dict[str, tuple[int, int]]
"""Numbers in both models of all that has a name in both, in the source's order."""


class Motion:
    """A source and our MJCF, moved alike. stated: what the recipe says, see `MjcfSource`."""

    def __init__(self, source: Side, ours: Side, stated: frozenset[str], *, rough: bool) -> None:
        self.sides, self.stated = (source, ours), stated
        self.tolerance = ROUGH if rough else TOLERANCE
        self.models = source.model, ours.model
        self.data = tuple(_prepared(model) for model in self.models)
        self.worst: dict[str, float] = {}
        self.joints = self._both("jnt")
        if all(model.njnt and int(model.jnt_type[0]) == FREE for model in self.models):
            hinges = {name: pair for name, pair in self.joints.items() if pair[0]}
            self.joints = {"free joint": (0, 0)} | hinges

    def _both(self, prefix: str) -> Pairs:
        one, other = ({name: i for i, name in enumerate(subjects(m, prefix))} for m in self.models)
        return {name: (i, other[name]) for name, i in one.items() if name in other}

    def findings(self) -> Iterator[Finding]:
        """One for each subject that differs in any of several positions."""
        if "base" in self.stated:
            return  # it stands elsewhere
        told: dict[tuple[str, str], Finding] = {}
        for number in range(POSITIONS):
            for side in (0, 1):  # the same numbers for both
                self._move(side, np.random.default_rng(number), still=number == 0)
            before, after = self._measured(0), self._measured(1)
            for key, value in before.items():
                for finding in self._differ(*key, value, after[key]):
                    told.setdefault((finding.rule, finding.subject), finding)
        yield from told.values()

    def _move(self, side: int, random: np.random.Generator, *, still: bool) -> None:
        """In the source positions and commands count from a joint's `ref`."""
        import mujoco as mj

        model, data = self.models[side], self.data[side]
        rest = self.sides[0].rest if side == 0 else {}
        mj.mj_resetData(model, data)
        for name, pair in self.joints.items():
            q, v = int(model.jnt_qposadr[pair[side]]), int(model.jnt_dofadr[pair[side]])
            if int(model.jnt_type[pair[side]]) == FREE:
                turn = random.normal(size=4)
                data.qpos[q : q + 7] = [*random.normal(size=3), *(turn / np.linalg.norm(turn))]
                data.qvel[v : v + 6] = random.normal(size=6)
            else:
                data.qpos[q] = rest.get(name, 0.0) + (0.0 if still else random.uniform(-1.0, 1.0))
                data.qvel[v] = random.normal()
        servos = self.sides[side].servos
        at_rest = {one.index: one.command_step(rest.get(j, 0.0)) for j, one in servos.items()}
        for pair in self._both("actuator").values():
            command = random.uniform(-0.2, 0.2) + at_rest.get(pair[side], 0.0)
            data.ctrl[mujoco.first_command(model, pair[side])] = command
        mj.mj_forward(model, data)

    def _measured(self, side: int) -> dict[tuple[str, str, str], Array]:
        """Inertia, gravity and speeds, springs and dampers, drives, sensors: (what, subject, words)
        -> numbers. Accelerations and touches differ, and should, where the recipe states drives.
        """
        model, data, dofs = self.models[side], self.data[side], list[int]()
        for pair in self.joints.values():
            first, joint = int(model.jnt_dofadr[pair[side]]), pair[side]
            dofs += range(first, first + (6 if int(model.jnt_type[joint]) == FREE else 1))
        found: dict[tuple[str, str, str], Array] = {}
        names = ["qfrc_bias"] if "gravity" not in self.stated else []
        if "actuators" not in self.stated:
            inertia = mujoco.mass_matrix(model, data)[np.ix_(dofs, dofs)]
            found["mass_matrix", "robot", "mass matrix"] = inertia
            names += ["qfrc_passive", "qfrc_actuator"]
        for name in names:
            found["forces", "robot", f"{name} (N or N m)"] = getattr(data, name)[dofs]
        others = {"actuators", "gravity", "collision", "contact", "merge"}
        for name, pair in {} if self.stated & others else self._both("sensor").items():
            kind, index = int(self.models[0].sensor_type[pair[0]]), pair[side]
            if not (self.sides[0].rest and kind in _of_positions()):  # those count from a `ref`
                first = int(model.sensor_adr[index])
                reading = data.sensordata[first : first + int(model.sensor_dim[index])]
                found["sensor", f"sensor {name}", "reading"] = np.array(reading)
        return found

    def _differ(
        self, what: str, subject: str, words: str, expected: Array, found: Array
    ) -> Iterator[Finding]:
        """A finding when two arrays differ by more than the tolerance, relative to their norm."""
        a, b = np.ravel(expected), np.ravel(found)
        distance = float(np.linalg.norm(a - b)) if a.shape == b.shape else np.inf
        size = float(np.linalg.norm(a))
        if size > 0.0:
            self.worst[what] = max(distance / size, self.worst.get(what, 0.0))
        tolerance = max(SOLVED if what == "sensor" else 0.0, self.tolerance)
        if not distance <= tolerance * size + ROUNDING:
            yield MOVES.named(what)(
                subject,
                f"{words}: the source has {_shown(a)}, our MJCF {_shown(b)}",
                hint="the robot lost something on the way from MJCF to MJCF: please report it",
                data={"expected": tuple(a[:16].tolist()), "found": tuple(b[:16].tolist())},
            )


def _of_positions() -> set[int]:
    import mujoco as mj

    kinds = mj.mjtSensor
    return {int(k) for k in (kinds.mjSENS_JOINTPOS, kinds.mjSENS_ACTUATORPOS,
                             kinds.mjSENS_TENDONPOS)}  # fmt: skip


def _prepared(model: Model) -> Data:
    """Without contacts: where meshes touch follows from the order of their corners."""
    import mujoco as mj

    model.opt.disableflags = int(model.opt.disableflags) | int(mj.mjtDisableBit.mjDSBL_CONTACT)
    model.opt.solver = mj.mjtSolver.mjSOL_NEWTON
    model.opt.iterations = model.opt.ls_iterations = ITERATIONS
    model.opt.tolerance = SOLVER_TOLERANCE
    return mj.MjData(model)


def _shown(values: Array) -> str:
    return " ".join(f"{v:.9g}" for v in values[:16]) + (" ..." if len(values) > 16 else "")
