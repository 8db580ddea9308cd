"""Both models in the same positions, at the same speeds, under the same commands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from assetbuild.checks.mjcf_source.expected import ROUGH, rest_of, tendon_rest
from assetbuild.findings import Finding, Rule
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.drives import read_drive, read_drives

POSITIONS = 6
TOLERANCE = 1e-9
"""Relative to the size of what is compared; sums of sines and cosines round to about 1e-15."""
SOLVED = 1e-5
"""Constraints are solved to the solver's tolerance, not to rounding."""
ITERATIONS, SOLVER_TOLERANCE = 200, 1e-14
"""Enough for both models to come to the same end, whatever the source asks for."""
ROUNDING = 1e-11
"""Absolute, SI units."""
FREE = 0

MOVES = Rule(
    "equal.source.*",
    "error",
    "our MJCF differs from the MJCF that it was read from, at rest or moving",
    "report it with both numbers: this is a bug",
)


class Motion:
    """A source and our MJCF, moved alike. stated: what the recipe says, see `MjcfSource`."""

    def __init__(
        self, source: mujoco.Model, ours: mujoco.Model, stated: frozenset[str], *, rough: bool
    ) -> None:
        import mujoco as mj

        self.a, self.b = source, ours
        for model in (source, ours):
            # Where meshes touch follows from the order of their corners: surfaces are facts.
            model.opt.disableflags = int(model.opt.disableflags) | int(
                mj.mjtDisableBit.mjDSBL_CONTACT
            )
            model.opt.solver = mj.mjtSolver.mjSOL_NEWTON
            model.opt.iterations = model.opt.ls_iterations = ITERATIONS
            model.opt.tolerance = SOLVER_TOLERANCE
        self.data = mj.MjData(source), mj.MjData(ours)
        self.stated, self.tolerance = stated, ROUGH if rough else TOLERANCE
        self.worst: dict[str, float] = {}
        self.told: set[tuple[str, str]] = set()
        self.joints = self._both("joint", source.njnt, ours.njnt)
        free = [i for i in range(source.njnt) if int(source.jnt_type[i]) == FREE]
        if free and ours.njnt and int(ours.jnt_type[0]) == FREE:
            self.joints = {"free joint": (free[0], 0)} | {
                name: pair for name, pair in self.joints.items() if pair[0] != free[0]
            }
        self.drives = self._both(
            "actuator", len(mujoco.actuators(source)), len(mujoco.actuators(ours))
        )
        self.rest, self.tendons = rest_of(source), tendon_rest(source)
        self.commands = {  # of drives that hold positions, at `ref`
            mujoco.name_of(source, "actuator", one.index): one.command(self.rest[one.joint_name])
            for one in read_drives(source)
            if one.joint_name in self.rest and one.kind == "servo" and not one.filtered
        }

    def _both(self, kind: str, count: int, here: int) -> dict[str, tuple[int, int]]:
        """Numbers in both models of all that has a name in both, in the source's order."""
        there = {mujoco.name_of(self.b, kind, j): j for j in range(here)}
        names = [mujoco.name_of(self.a, kind, i) for i in range(count)]
        return {name: (i, there[name]) for i, name in enumerate(names) if name in there}

    def findings(self) -> Iterator[Finding]:
        """Axes of joints, mass matrix, forces, tendons and sensors in several positions."""
        if "base" in self.stated:
            return  # it stands elsewhere
        random = np.random.default_rng(1)
        for number in range(POSITIONS):
            self._move(random, still=number == 0)
            yield from self._places()
            yield from self._forces()
            yield from self._readings()

    def _move(self, random: np.random.Generator, *, still: bool) -> None:
        import mujoco as mj

        for model, data in zip((self.a, self.b), self.data, strict=True):
            mj.mj_resetData(model, data)
        a, b = self.data
        for name, (i, j) in self.joints.items():
            q, p = int(self.a.jnt_qposadr[i]), int(self.b.jnt_qposadr[j])
            u, v = int(self.a.jnt_dofadr[i]), int(self.b.jnt_dofadr[j])
            if int(self.a.jnt_type[i]) == FREE:
                turn = random.normal(size=4)
                base = [*random.normal(size=3), *(turn / np.linalg.norm(turn))]
                base = [float(x) for x in self.a.qpos0[q : q + 7]] if still else base
                a.qpos[q : q + 7] = b.qpos[p : p + 7] = base
                a.qvel[u : u + 6] = b.qvel[v : v + 6] = random.normal(size=6)
                continue
            value = 0.0 if still else float(random.uniform(-1.0, 1.0))
            a.qpos[q], b.qpos[p] = self.rest.get(name, 0.0) + value, value
            a.qvel[u] = b.qvel[v] = float(random.normal())
        for name, (i, j) in self.drives.items():
            command = float(random.uniform(-0.2, 0.2))
            i, j = mujoco.first_command(self.a, i), mujoco.first_command(self.b, j)
            a.ctrl[i], b.ctrl[j] = command + self.commands.get(name, 0.0), command
        mj.mj_forward(self.a, a)
        mj.mj_forward(self.b, b)

    def _places(self) -> Iterator[Finding]:
        a, b = self.data
        for name, (i, j) in self.joints.items():
            if int(self.a.jnt_type[i]) != FREE:
                yield from self._same("axis", f"joint {name}", "axis", a.xaxis[i], b.xaxis[j])
            anchors = a.xanchor[i], b.xanchor[j]
            yield from self._same("anchor", f"joint {name}", "anchor (m)", *anchors)
        for name, (i, j) in self._both("tendon", self.a.ntendon, self.b.ntendon).items():
            lengths = a.ten_length[i] - self.tendons.get(name, 0.0), b.ten_length[j]
            yield from self._same("tendon", f"tendon {name}", "length", *lengths)

    def _forces(self) -> Iterator[Finding]:
        """Inertia, gravity and speeds, springs and dampers, drives."""
        u, v = (self._dofs(side) for side in (0, 1))
        a, b = self.data
        names = ["qfrc_bias"] if "gravity" not in self.stated else []
        if "actuators" not in self.stated:
            M = mujoco.mass_matrix(self.a, a)[np.ix_(u, u)]
            N = mujoco.mass_matrix(self.b, b)[np.ix_(v, v)]
            yield from self._same("mass_matrix", "robot", "mass matrix", M, N)
            names += ["qfrc_passive", "qfrc_actuator"]
        for name in names:
            x, y = getattr(a, name)[u], getattr(b, name)[v]
            yield from self._same("forces", "robot", f"{name} (N or N m)", x, y)

    def _dofs(self, side: int) -> list[int]:
        """Degrees of freedom in the order of the source's joints."""
        model = (self.a, self.b)[side]
        found: list[int] = []
        for pair in self.joints.values():
            first, joint = int(model.jnt_dofadr[pair[side]]), pair[side]
            found += range(first, first + (6 if int(model.jnt_type[joint]) == FREE else 1))
        return found

    def _readings(self) -> Iterator[Finding]:
        if self.stated & {"actuators", "gravity", "collision", "contact", "merge"}:
            return  # accelerations and touches differ then, and they should
        for name, (i, j) in self._both("sensor", self.a.nsensor, self.b.nsensor).items():
            x, y = (
                np.array(d.sensordata[int(m.sensor_adr[n]) :][: int(m.sensor_dim[n])])
                for m, d, n in zip((self.a, self.b), self.data, (i, j), strict=True)
            )
            x = x - self._offset(i)
            yield from self._same("sensor", f"sensor {name}", "reading", x, y, SOLVED)

    def _offset(self, sensor: int) -> float:
        """What a position of a joint with `ref` reads in the source where it reads 0 here."""
        import mujoco as mj

        watched, kind = int(self.a.sensor_objid[sensor]), self.a.sensor_type[sensor]
        if kind == mj.mjtSensor.mjSENS_ACTUATORPOS:
            drive = read_drive(self.a, watched)
            return drive.gear * self.rest.get(drive.joint_name, 0.0) if drive else 0.0
        if kind == mj.mjtSensor.mjSENS_JOINTPOS:
            return self.rest.get(mujoco.name_of(self.a, "joint", watched), 0.0)
        if kind == mj.mjtSensor.mjSENS_TENDONPOS:
            return self.tendons.get(mujoco.name_of(self.a, "tendon", watched), 0.0)
        return 0.0

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
        same = distance <= max(tolerance, self.tolerance) * size + ROUNDING
        if not same and (what, subject) not in self.told:
            self.told.add((what, subject))
            yield MOVES.named(what)(
                subject,
                f"{words}: the source has {_shown(a)}, our MJCF {_shown(b)}",
                hint="the robot lost something on the way from MJCF to MJCF: please report it",
                data={"expected": tuple(a[:16].tolist()), "found": tuple(b[:16].tolist())},
            )


def _shown(values: Array) -> str:
    return " ".join(f"{v:.9g}" for v in values[:16]) + (" ..." if len(values) > 16 else "")
