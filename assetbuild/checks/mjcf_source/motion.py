"""Both models in the same positions, at the same speeds, under the same commands.

It shows what counts from a joint's `ref`, such as laws of drives and springs of tendons, and that
all facts together make the same robot.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from assetbuild.checks.mjcf_source.at_rest import FREE, Side
from assetbuild.checks.mjcf_source.reasons import ROUGH
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
        free = [int(model.jnt_type[0]) == FREE if model.njnt else False for model in self.models]
        if all(free):
            self.joints = {"free joint": (0, 0)} | {
                name: pair for name, pair in self.joints.items() if pair[0]
            }

    def _both(self, prefix: str) -> Pairs:
        one, other = ({name: i for i, name in enumerate(subjects(m, prefix))} for m in self.models)
        return {name: (i, other[name]) for name, i in one.items() if name in other}

    def findings(self) -> Iterator[Finding]:
        """One for each subject that differs in any of several positions."""
        if "base" in self.stated:
            return  # it stands elsewhere
        random, told = np.random.default_rng(1), set[tuple[str, str]]()
        for number in range(POSITIONS):
            self._move(random, still=number == 0)
            for finding in (*self._forces(), *self._readings()):
                if (finding.rule, finding.subject) not in told:
                    told.add((finding.rule, finding.subject))
                    yield finding

    def _move(self, random: np.random.Generator, *, still: bool) -> None:
        import mujoco as mj

        for model, data in zip(self.models, self.data, strict=True):
            mj.mj_resetData(model, data)
        rest = self.sides[0].rest
        for name, pair in self.joints.items():
            is_free = int(self.models[0].jnt_type[pair[0]]) == FREE
            turn = random.normal(size=4)
            base = [*random.normal(size=3), *(turn / np.linalg.norm(turn))]
            value = 0.0 if still else float(random.uniform(-1.0, 1.0))
            speed = random.normal(size=6 if is_free else 1)
            for side, joint in enumerate(pair):
                model, data = self.models[side], self.data[side]
                q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
                data.qvel[v : v + len(speed)] = speed
                if is_free:
                    data.qpos[q : q + 7] = base
                else:
                    data.qpos[q] = value + (rest.get(name, 0.0) if side == 0 else 0.0)
        self._command(random)
        for model, data in zip(self.models, self.data, strict=True):
            mj.mj_forward(model, data)

    def _command(self, random: np.random.Generator) -> None:
        source, rest = self.sides[0], self.sides[0].rest
        at_rest = {one.index: one.command_step(rest.get(joint, 0.0))
                   for joint, one in source.servos.items()}  # fmt: skip
        for pair in self._both("actuator").values():
            command = float(random.uniform(-0.2, 0.2))
            for side, actuator in enumerate(pair):
                at = mujoco.first_command(self.models[side], actuator)
                self.data[side].ctrl[at] = command + (
                    at_rest.get(pair[0], 0.0) if side == 0 else 0.0
                )

    def _forces(self) -> Iterator[Finding]:
        """Inertia, gravity and speeds, springs and dampers, drives."""
        u, v = (self._dofs(side) for side in (0, 1))
        (a, b), (m, n) = self.data, self.models
        names = ["qfrc_bias"] if "gravity" not in self.stated else []
        if "actuators" not in self.stated:
            M, N = mujoco.mass_matrix(m, a)[np.ix_(u, u)], mujoco.mass_matrix(n, b)[np.ix_(v, v)]
            yield from self._same("mass_matrix", "robot", "mass matrix", M, N)
            names += ["qfrc_passive", "qfrc_actuator"]
        for name in names:
            x, y = getattr(a, name)[u], getattr(b, name)[v]
            yield from self._same("forces", "robot", f"{name} (N or N m)", x, y)

    def _dofs(self, side: int) -> list[int]:
        """Degrees of freedom in the order of the source's joints."""
        model, found = self.models[side], list[int]()
        for pair in self.joints.values():
            first, joint = int(model.jnt_dofadr[pair[side]]), pair[side]
            found += range(first, first + (6 if int(model.jnt_type[joint]) == FREE else 1))
        return found

    def _readings(self) -> Iterator[Finding]:
        if self.stated & {"actuators", "gravity", "collision", "contact", "merge"}:
            return  # accelerations and touches differ then, and they should
        for name, (i, j) in self._both("sensor").items():
            if self.sides[0].rest and int(self.models[0].sensor_type[i]) in _of_positions():
                continue  # it counts from a `ref`
            x, y = (
                np.array(d.sensordata[int(m.sensor_adr[n]) :][: int(m.sensor_dim[n])])
                for m, d, n in zip(self.models, self.data, (i, j), strict=True)
            )
            yield from self._same("sensor", f"sensor {name}", "reading", x, y, SOLVED)

    def _same(
        self,
        what: str,
        subject: str,
        words: str,
        expected: ArrayLike,
        found: ArrayLike,
        tolerance: float = 0.0,
    ) -> Iterator[Finding]:
        """A finding when two arrays differ by more than the tolerance, relative to their norm."""
        a, b = (np.atleast_1d(np.asarray(v, dtype=np.float64)).ravel() for v in (expected, found))
        distance = float(np.linalg.norm(a - b)) if a.shape == b.shape else np.inf
        size = float(np.linalg.norm(a))
        if size > 0.0:
            self.worst[what] = max(distance / size, self.worst.get(what, 0.0))
        if not distance <= max(tolerance, self.tolerance) * size + ROUNDING:
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
