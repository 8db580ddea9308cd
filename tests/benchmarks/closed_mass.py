"""The mass matrix of a bundle's robot with its loops closed: MuJoCo beside pinocchio.

    python -m tests.benchmarks.closed_mass BUNDLE...

Nothing of assetbuild takes part. MuJoCo reads the bundle's MJCF, pinocchio its URDF; the loops are
the `connect` and `weld` constraints of the MJCF, between sites. In ten closed poses around its
first keyframe each library gives its mass matrix M and its Jacobian J of the loops. The reduced
matrix is N^T M N, where N spans the null space of J and is scaled so that the same independent
coordinates are the identity in both. Joints that mimic are folded into their leaders, armature
counts as 0, and a floating base stands at the origin. The error is the largest
|difference| / sqrt(M_ii M_jj).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio
from numpy.typing import NDArray

POSES, STEP, CLOSED, RANK, LIMIT = 10, 0.1, 1e-12, 1e-9, 1e-8
Array = NDArray[np.float64]
Library = Any  # the extension modules have no types


def main(bundles: list[str]) -> int:
    """One row per bundle."""
    print("| bundle | loops | coordinates | of which move | poses | relative error |")
    print("| --- | --- | --- | --- | --- | --- |")
    worst = 0.0
    for bundle in map(Path, bundles):
        robot = Robot(bundle)
        errors, free = [], 0
        for q in robot.closed_poses():
            error, free = robot.error(q)
            errors.append(error)
        worst = max([worst, *errors] if errors else [np.inf])
        shown = f"{max(errors):.1e}" if errors else "no closed pose"
        kinds = ", ".join(f"{len(loops)} `{kind}`" for kind, loops in robot.by_kind().items())
        size = robot.gains.shape[1] + robot.base
        print(f"| {bundle.name} | {kinds} | {size} | {free} | {len(errors)} | {shown} |")
    return 0 if worst <= LIMIT else 1


@dataclass(frozen=True)
class Loop:
    """Two sites of the MJCF: (body, its frame in the body) each."""

    kind: str
    ends: tuple[tuple[str, Library], tuple[str, Library]]


class Robot:
    """One robot in both libraries, joint by joint under the same names."""

    def __init__(self, bundle: Path) -> None:
        urdf = next((bundle / "urdf").glob("*.urdf"))
        model = mujoco.MjModel.from_xml_path(str(bundle / "mjcf" / f"{urdf.stem}.xml"))
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.dof_armature[:] = 0.0
        self.mj: Library = model
        self.data: Library = mujoco.MjData(model)
        mujoco.mj_setConst(model, self.data)
        self.base = 6 if model.njnt and int(model.jnt_type[0]) == mujoco.mjtJoint.mjJNT_FREE else 0
        joints = range(1 if self.base else 0, model.njnt)
        self.names = [model.joint(j).name for j in joints]
        self.at = [int(model.jnt_qposadr[j]) for j in joints]
        self.columns = [int(model.jnt_dofadr[j]) for j in joints]
        free = (pinocchio.JointModelFreeFlyer(),) if self.base else ()
        self.pin: Library = pinocchio.buildModelFromXML(_with_limits(urdf), *free)
        self.pin_data: Library = self.pin.createData()
        of = [self.pin.joints[self.pin.getJointId(name)] for name in self.names]
        self.pin_joints, self.pin_columns = of, [joint.idx_v for joint in of]
        self.gains, self.offset = self._mimics()
        self.loops = self._loops()

    def _mimics(self) -> tuple[Array, Array]:
        """q = gains @ leaders + offset, from the joint equalities of the MJCF, all linear."""
        follows = {}
        for n in range(self.mj.neq):
            if int(self.mj.eq_type[n]) == mujoco.mjtEq.mjEQ_JOINT:
                c = self.mj.eq_data[n]
                assert not any(c[2:5]), "a polynomial coupling"
                one, two = (
                    self.mj.joint(int(i[n])).name for i in (self.mj.eq_obj1id, self.mj.eq_obj2id)
                )
                follows[one] = (two, float(c[1]), float(c[0]))
        leaders = [name for name in self.names if name not in follows]
        gains, offset = np.zeros((len(self.names), len(leaders))), np.zeros(len(self.names))
        for row, name in enumerate(self.names):
            factor = 1.0
            while name in follows:
                name, slope, more = follows[name]
                offset[row] += factor * more
                factor *= slope
            gains[row, leaders.index(name)] = factor
        return gains, offset

    def _loops(self) -> list[Loop]:
        found = []
        kinds = {int(mujoco.mjtEq.mjEQ_CONNECT): "connect", int(mujoco.mjtEq.mjEQ_WELD): "weld"}
        for n in range(self.mj.neq):
            if int(self.mj.eq_type[n]) in kinds:
                assert int(self.mj.eq_objtype[n]) == mujoco.mjtObj.mjOBJ_SITE, "not between sites"
                ends = [self._site(int(i[n])) for i in (self.mj.eq_obj1id, self.mj.eq_obj2id)]
                found.append(Loop(kinds[int(self.mj.eq_type[n])], (ends[0], ends[1])))
        return found

    def _site(self, site: int) -> tuple[str, Library]:
        w, x, y, z = self.mj.site_quat[site]
        turn = pinocchio.Quaternion(w, x, y, z).normalized().toRotationMatrix()
        body = self.mj.body(int(self.mj.site_bodyid[site])).name
        return body, pinocchio.SE3(turn, np.array(self.mj.site_pos[site]))

    def by_kind(self) -> dict[str, list[Loop]]:
        """The loops by the kind of their constraint."""
        kinds = sorted({loop.kind for loop in self.loops})
        return {kind: [loop for loop in self.loops if loop.kind == kind] for kind in kinds}

    # --- pinocchio --------------------------------------------------------------------------------

    def _place(self, q: Array) -> Array:
        """The positions in pinocchio's coordinates, with its kinematics and Jacobians there."""
        full = pinocchio.neutral(self.pin)
        for joint, value in zip(self.pin_joints, q, strict=True):
            both = (np.cos(value), np.sin(value)) if joint.nq == 2 else (value,)
            full[joint.idx_q : joint.idx_q + joint.nq] = both
        pinocchio.computeJointJacobians(self.pin, self.pin_data, full)
        return np.asarray(full)

    def _gap(self, q: Array) -> tuple[Array, Array]:
        """What is open, m and rad, and its Jacobian in the leaders' coordinates."""
        self._place(q)
        gaps, rows = [], []
        for loop in self.loops:
            placed, moved = [], []
            for body, inside in loop.ends:
                frame = self.pin.frames[self.pin.getFrameId(body, pinocchio.FrameType.BODY)]
                place = frame.placement * inside
                placed.append(self.pin_data.oMi[frame.parentJoint] * place)
                args = (self.pin, self.pin_data, frame.parentJoint, place)
                moved.append(pinocchio.getFrameJacobian(*args, pinocchio.ReferenceFrame.LOCAL))
            between = placed[0].inverse() * placed[1]
            turn, arm = between.rotation, between.translation
            # Seen from frame a, whose own turn carries b's point along.
            carried = np.cross(moved[0][3:], arm, axisa=0, axisb=0, axisc=0)
            gaps.append(arm)
            rows.append(turn @ moved[1][:3] - moved[0][:3] - carried)
            if loop.kind == "weld":
                gaps.append(pinocchio.log3(turn))
                rows.append(turn @ moved[1][3:] - moved[0][3:])
        order = [*range(self.base), *self.pin_columns]
        return np.concatenate(gaps), self._folded(np.vstack(rows)[:, order].T).T

    def _folded(self, rows: Array) -> Array:
        """Rows of the base and of all joints -> rows of the base and of the leaders."""
        return np.vstack([rows[: self.base], self.gains.T @ rows[self.base :]])

    # --- both -------------------------------------------------------------------------------------

    def closed_poses(self) -> list[Array]:
        """The first keyframe and others around it, closed by Newton's method."""
        start = np.array(self.mj.key_qpos[0] if self.mj.nkey else self.mj.qpos0)[self.at]
        leaders = np.linalg.lstsq(self.gains, start - self.offset, rcond=None)[0]
        random, found = np.random.default_rng(5), []
        for number in range(10 * POSES):
            u = leaders + (STEP * random.normal(size=len(leaders)) if number else 0.0)
            for _ in range(100):
                gap, jacobian = self._gap(self.gains @ u + self.offset)
                if np.abs(gap).max() < CLOSED:
                    found.append(self.gains @ u + self.offset)
                    break
                u = u - np.linalg.lstsq(jacobian[:, self.base :], gap, rcond=RANK)[0]
            if len(found) == POSES:
                break
        return found

    def error(self, q: Array) -> tuple[float, int]:
        """The relative error in one pose, and in how many coordinates the robot moves there."""
        full = self._place(q)
        order = [*range(self.base), *self.pin_columns]
        upper = np.triu(pinocchio.crba(self.pin, self.pin_data, full))
        mass = (upper + np.triu(upper, 1).T)[np.ix_(order, order)]
        theirs = self._reduced(self._folded(self._folded(mass).T), self._gap(q)[1], None)
        ours = self._reduced(*self._in_mujoco(q), theirs[1])
        root = np.sqrt(np.diag(theirs[0]))
        return float((np.abs(ours[0] - theirs[0]) / np.outer(root, root)).max()), len(root)

    def _in_mujoco(self, q: Array) -> tuple[Array, Array]:
        data, nv = self.data, self.mj.nv
        mujoco.mj_resetData(self.mj, data)
        if self.base:
            data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        data.qpos[self.at] = q
        mujoco.mj_forward(self.mj, data)
        mass, jacobian = np.zeros((nv, nv)), np.zeros((data.nefc, nv))
        mujoco.mj_fullM(self.mj, data, mass)
        if mujoco.mj_isSparse(self.mj):
            sparse = (data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
            mujoco.mju_sparse2dense(jacobian, *sparse)
        else:
            jacobian[:] = np.reshape(data.efc_J, (-1, nv))[: len(jacobian)]
        equality = np.asarray(data.efc_type) == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        rows = np.flatnonzero(equality)
        rows = rows[self.mj.eq_type[np.asarray(data.efc_id)[rows]] <= int(mujoco.mjtEq.mjEQ_WELD)]
        order = [*range(self.base), *self.columns]
        mass = self._folded(self._folded(mass[np.ix_(order, order)]).T)
        return mass, self._folded(jacobian[np.ix_(rows, order)].T).T

    def _reduced(
        self, mass: Array, jacobian: Array, chosen: list[int] | None
    ) -> tuple[Array, list[int]]:
        """N^T M N with N the identity in the chosen coordinates; None: choose them."""
        _, sizes, rows = np.linalg.svd(jacobian, full_matrices=True)
        basis = rows[int((sizes > RANK * sizes.max()).sum()) :].T
        if chosen is None:
            chosen, left = [], basis.copy()
            for _ in range(basis.shape[1]):  # the largest row first: well conditioned
                chosen.append(int(np.linalg.norm(left, axis=1).argmax()))
                way = left[chosen[-1]] / np.linalg.norm(left[chosen[-1]])
                left -= np.outer(left @ way, way)
        moved = basis @ np.linalg.inv(basis[chosen])
        return moved.T @ mass @ moved, chosen


def _with_limits(urdf: Path) -> str:
    """The URDF with 0 for efforts and velocities that it does not state: urdfdom asks for them."""
    root = ElementTree.fromstring(urdf.read_text())  # noqa: S314 # our own bundle
    for limit in root.iterfind("joint/limit"):
        for key in ("effort", "velocity"):
            limit.set(key, limit.get(key, "0"))
    return ElementTree.tostring(root, "unicode")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
