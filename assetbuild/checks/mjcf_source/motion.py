"""Both models in the same positions, at the same speeds, under the same commands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from assetbuild.checks.mjcf_source.compare import FREE, MESH, ROUNDING, Comparison, Side
from assetbuild.findings import Finding
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.joint_drives import read_drive

POSITIONS = 6
SAME_FRAME = 2e-6
"""Two frames that differ by less count as one in MuJoCo's compiler, in each of the two files."""
MESH_TOLERANCE = 2e-6
"""Relative to a mesh's size: MuJoCo keeps vertices as float32."""


class Motion(Comparison):
    """Poses, forces and readings."""

    def motion(self) -> Iterator[Finding]:
        """Both in the same positions, at the same speeds, under the same commands."""
        random = np.random.default_rng(1)
        for number in range(POSITIONS):
            self._move(random, still=number == 0)
            yield from self._poses()
            if "base" not in self.stated:
                yield from self._forces()
        yield from self._keys()

    def _move(self, random: np.random.Generator, *, still: bool) -> None:
        import mujoco as mj

        for side in (self.a, self.b):
            mj.mj_resetData(side.model, side.data)
        a, b = self.a, self.b
        for name, i in a.ids["joint"].items():
            here = self.here("joint", name)
            if here is None:
                continue
            j = b.ids["joint"][here]
            q, p = int(a.model.jnt_qposadr[i]), int(b.model.jnt_qposadr[j])
            u, v = int(a.model.jnt_dofadr[i]), int(b.model.jnt_dofadr[j])
            if a.model.jnt_type[i] == FREE:
                turn = random.normal(size=4)
                base = [*random.normal(size=3), *(turn / np.linalg.norm(turn))]
                base = [float(x) for x in a.model.qpos0[q : q + 7]] if still else base
                a.data.qpos[q : q + 7] = b.data.qpos[p : p + 7] = base
                a.data.qvel[u : u + 6] = b.data.qvel[v : v + 6] = random.normal(size=6)
                continue
            value = 0.0 if still else float(random.uniform(-1.0, 1.0))
            a.data.qpos[q], b.data.qpos[p] = a.model.qpos0[q] + value, value
            a.data.qvel[u] = b.data.qvel[v] = float(random.normal())
        for _, i, j in self.pairs("actuator"):
            command = float(random.uniform(-0.2, 0.2))
            a.data.ctrl[i], b.data.ctrl[j] = command + self._rest(i), command
        for side in (a, b):
            mj.mj_forward(side.model, side.data)

    def _rest(self, actuator: int) -> float:
        """`ref` of the joint of a position drive, from which its commands count here."""
        model = self.a.model
        drive = read_drive(model, actuator)
        if drive is None or drive.kind != "servo" or drive.filtered:
            return 0.0
        return drive.command(float(model.qpos0[model.jnt_qposadr[drive.joint]]))

    def _poses(self) -> Iterator[Finding]:
        a, b = self.a.data, self.b.data
        if "merge" not in self.stated:
            for name, i, j in self.pairs("body", expected=self.robot_bodies()):
                subject = f"link {name}"
                yield from self.same("pose", subject, "axes", a.xmat[i], b.xmat[j])
                if self.a.model.body_mass[i]:
                    yield from self.same("com", subject, "centre (m)", a.xipos[i], b.xipos[j])
                    tensors = _tensor(self.a, i), _tensor(self.b, j)
                    yield from self.same("inertia", subject, "inertia (kg m2)", *tensors)
        for name, i, j in self.pairs(
            "joint", expected=self.on_robot("joint", self.a.model.jnt_bodyid)
        ):
            if self.a.model.jnt_type[i] != FREE:
                yield from self.same("axis", f"joint {name}", "axis", a.xaxis[i], b.xaxis[j])
            yield from self.same(
                "anchor", f"joint {name}", "anchor (m)", a.xanchor[i], b.xanchor[j]
            )
        for name, i, j in self.pairs(
            "site", expected=self.on_robot("site", self.a.model.site_bodyid)
        ):
            slack = self._shared("site", i, j)
            yield from self.same(
                "site", f"link {name}", "place (m)", a.site_xpos[i], b.site_xpos[j], absolute=slack
            )
            yield from self.same(
                "site", f"link {name}", "axes", a.site_xmat[i], b.site_xmat[j], absolute=slack
            )
        for name, i, j in self.pairs("camera"):
            yield from self.same(
                "camera", f"camera {name}", "place (m)", a.cam_xpos[i], b.cam_xpos[j]
            )
            yield from self.same("camera", f"camera {name}", "axes", a.cam_xmat[i], b.cam_xmat[j])
        yield from self._shape_poses()

    def _shared(self, kind: str, i: int, j: int) -> float:
        """Absolute slack: MuJoCo takes the body's or the inertia's frame for one that is close."""
        shared = (getattr(s.model, f"{kind}_sameframe")[n] for s, n in ((self.a, i), (self.b, j)))
        return SAME_FRAME if any(shared) else ROUNDING

    def _shape_poses(self) -> Iterator[Finding]:
        a, b = self.a, self.b
        for name, i, j in self.pairs("geom", expected=self.on_robot("geom", a.model.geom_bodyid)):
            subject = f"shape {name}"
            if a.model.geom_type[i] != b.model.geom_type[j]:
                continue
            if a.model.geom_type[i] == MESH:
                if "decimated" not in self.stated:
                    before, now = _bounds(a, i), _bounds(b, j)
                    slack = MESH_TOLERANCE * float(np.linalg.norm(before[1] - before[0]))
                    yield from self.same(
                        "mesh", subject, "bounds (m)", before, now, tolerance=0.0, absolute=slack
                    )
                continue
            slack, x, y = self._shared("geom", i, j), a.data, b.data
            yield from self.same(
                "geom", subject, "place (m)", x.geom_xpos[i], y.geom_xpos[j], absolute=slack
            )
            yield from self.same(
                "geom", subject, "axes", x.geom_xmat[i], y.geom_xmat[j], absolute=slack
            )

    def _forces(self) -> Iterator[Finding]:
        """Inertia, gravity and speeds, springs and dampers, drives; and what sensors see."""
        rows = [self._dofs(side) for side in (self.a, self.b)]
        if len(rows[0]) != len(rows[1]):
            yield from self.same("dofs", "robot", "degrees of freedom", len(rows[0]), len(rows[1]))
            return
        u, v = rows
        if "actuators" not in self.stated:
            M = mujoco.mass_matrix(self.a.model, self.a.data)[np.ix_(u, u)]
            N = mujoco.mass_matrix(self.b.model, self.b.data)[np.ix_(v, v)]
            yield from self.same("mass_matrix", "robot", "mass matrix", M, N)
        names = ["qfrc_bias"] if "gravity" not in self.stated else []
        if "actuators" not in self.stated:
            names += ["qfrc_passive", "qfrc_actuator"]
        for name in names:
            x, y = getattr(self.a.data, name)[u], getattr(self.b.data, name)[v]
            yield from self.same("forces", "robot", f"{name} (N or N m)", x, y)
        for name, i, j in self.pairs("tendon"):
            lengths = self.a.data.ten_length[i], self.b.data.ten_length[j]
            yield from self.same("tendon", f"tendon {name}", "length", *lengths)
        if self.stated & {"actuators", "gravity", "collision", "contact", "merge"}:
            return  # accelerations and touches differ then, and they should
        for name, i, j in self.pairs("sensor"):
            x, y = _reading(self.a, i) - self._offset(i), _reading(self.b, j)
            # Contacts and constraints are solved to the solver's tolerance, not to rounding.
            yield from self.same("sensor", f"sensor {name}", "reading", x, y, tolerance=1e-5)

    def _offset(self, sensor: int) -> float:
        """What a position of a joint with `ref` reads in the source where it reads 0 here."""
        import mujoco as mj

        model, watched = self.a.model, int(self.a.model.sensor_objid[sensor])
        gear, joint = 1.0, watched
        if model.sensor_type[sensor] == mj.mjtSensor.mjSENS_ACTUATORPOS:
            drive = read_drive(model, watched)
            if drive is None:
                return 0.0
            gear, joint = drive.gear, drive.joint
        elif model.sensor_type[sensor] != mj.mjtSensor.mjSENS_JOINTPOS:
            return 0.0
        return gear * float(model.qpos0[model.jnt_qposadr[joint]])

    def _dofs(self, side: Side) -> list[int]:
        """Degrees of freedom in the order of the source's joints."""
        found: list[int] = []
        for name, i in self.a.ids["joint"].items():
            here = self.here("joint", name)
            if here is not None:
                joint = i if side is self.a else self.b.ids["joint"][here]
                width = 6 if side.model.jnt_type[joint] == FREE else 1
                first = int(side.model.jnt_dofadr[joint])
                found += range(first, first + width)
        return found

    def _keys(self) -> Iterator[Finding]:
        a, b = self.a.model, self.b.model
        yield from self.missing("key", self.a.ids["key"])
        for name, i, j in self.pairs("key"):
            for joint, u, v in self.pairs("joint"):
                q, p = int(a.jnt_qposadr[u]), int(b.jnt_qposadr[v])
                width = 7 if a.jnt_type[u] == FREE else 1
                x = a.key_qpos[i][q : q + width] - (a.qpos0[q] if width == 1 else 0.0)
                if width == 7:
                    x[3:] /= np.linalg.norm(x[3:])
                y = b.key_qpos[j][p : p + width]
                yield from self.same("key", f"keyframe {name}", f"position of {joint}", x, y)
            for actuator, u, v in self.pairs("actuator") if "actuators" not in self.stated else ():
                x, y = a.key_ctrl[i][u] - self._rest(u), b.key_ctrl[j][v]
                yield from self.same("key", f"keyframe {name}", f"command of {actuator}", x, y)


def _tensor(side: Side, body: int) -> Array:
    """(3, 3) about the centre of mass, in world axes."""
    R = np.array(side.data.xmat[body]).reshape(3, 3)
    tensor: Array = R @ mujoco.inertia_of(side.model, body) @ R.T
    return tensor


def _bounds(side: Side, geom: int) -> Array:
    """(2, 3): lowest and highest corner of a mesh in the world, m."""
    model = side.model
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    R = np.array(side.data.geom_xmat[geom]).reshape(3, 3)
    points = model.mesh_vert[first : first + count] @ R.T + side.data.geom_xpos[geom]
    return np.stack((points.min(axis=0), points.max(axis=0)))


def _reading(side: Side, sensor: int) -> Array:
    first, width = int(side.model.sensor_adr[sensor]), int(side.model.sensor_dim[sensor])
    return np.array(side.data.sensordata[first : first + width])
