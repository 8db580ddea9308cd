"""The same robot in two libraries: the source in pinocchio, our MJCF in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from assetbuild.robot.chains import find_chains
from assetbuild.robot.inertia import combine, move_inertial, tensor_of
from assetbuild.robot.model import Inertial, Loop, Tree
from assetbuild.robot.pose import Array, Pose, normalised_quat, vec3
from assetbuild.simulators.mujoco import body_names, inertia_of, load


class PinocchioSide:
    """The source URDF in pinocchio. dof: velocity index by joint name."""

    def __init__(self, urdf: str, links: Tree, tree: Tree) -> None:
        import pinocchio

        self.tree = tree
        self._pin: Any = pinocchio  # Any: pinocchio has no types
        free = (pinocchio.JointModelFreeFlyer(),) if tree.base == "floating" else ()
        self._model = pinocchio.buildModelFromXML(_with_limits(urdf), *free)
        self._data = self._model.createData()
        self.X_body_root = tree.placement(links.root)[1]
        self.nv = int(self._model.nv)
        self.mass = float(pinocchio.computeTotalMass(self._model))
        names = [joint.name for joint in tree.moving_joints]
        missing = [name for name in names if not self._model.existJointName(name)]
        if missing:
            raise ValueError(f"pinocchio finds no moving joint `{missing[0]}`")
        self._joint = {n: self._model.joints[self._model.getJointId(n)] for n in names}
        self.dof = {name: int(joint.idx_v) for name, joint in self._joint.items()}
        self._moving = {joint.name: joint for joint in tree.moving_joints}
        self._links = [body.name for body in links.bodies]
        self._root = int(self._model.getFrameId(links.root, pinocchio.FrameType.BODY))
        self._q = pinocchio.neutral(self._model)

    def move(self, positions: Mapping[str, float], X_world_root_link: Pose) -> None:
        """Place it; positions in rad or m by joint name."""
        q = self._q
        if self.tree.base == "floating":
            w, x, y, z = X_world_root_link.quat
            q[:7] = [*X_world_root_link.xyz, x, y, z, w]
        for name, joint in self._joint.items():
            value = positions[name]
            if joint.nq == 2:  # continuous: (cos, sin)
                q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                q[joint.idx_q] = value
        self._pin.forwardKinematics(self._model, self._data, q)
        self._pin.updateFramePlacements(self._model, self._data)

    def link_poses(self) -> Iterator[tuple[str, Array]]:
        """(name, X_world_link (4, 4)) of every link of the source."""
        body = self._pin.FrameType.BODY  # joints and links share names
        for name in self._links:
            if self._model.existFrame(name, body):
                yield name, self._data.oMf[self._model.getFrameId(name, body)].homogeneous

    def mass_matrix(self) -> Array:
        """(nv, nv), symmetric: crba fills the upper triangle only."""
        upper = np.triu(self._pin.crba(self._model, self._data, self._q))
        symmetric: Array = upper + np.triu(upper, 1).T
        return symmetric

    def constraint_jacobian(self, loops: Sequence[Loop]) -> Array:
        """(rows, nv) at the placed pose: how end b moves in end a, by Jacobians of frames."""
        pin, model, data = self._pin, self._model, self._data
        pin.computeJointJacobians(model, data, self._q)
        rows = []
        for loop in loops:
            placed, moved = [], []
            for end in loop.ends:
                is_root = end.body == self.tree.root  # whose frame may not be the source's
                at = self._root if is_root else model.getFrameId(end.body, pin.FrameType.BODY)
                X = self.X_body_root.inverse() @ end.X_body_end if is_root else end.X_body_end
                frame = model.frames[at]
                joint, inside = frame.parentJoint, frame.placement * pin.SE3(X.matrix())
                placed.append(data.oMi[joint] * inside)
                moved.append(
                    pin.getFrameJacobian(model, data, joint, inside, pin.ReferenceFrame.LOCAL)
                )
            turn = placed[0].rotation.T @ placed[1].rotation
            rows.append(turn @ moved[1][:3] - moved[0][:3])
            if loop.kind == "weld":
                rows.append(turn @ moved[1][3:] - moved[0][3:])
        jacobian: Array = np.vstack(rows)
        return jacobian

    def gravity(self) -> Array:
        """(nv,) generalised gravity at the placed pose."""
        g: Array = self._pin.computeGeneralizedGravity(self._model, self._data, self._q).copy()
        return g

    def inertias(self) -> Iterator[tuple[str, Inertial]]:
        """(link, everything that moves with it) in the frame of the link, merged by pinocchio.

        The links below the moving joints, and the root link of a floating base.
        """
        below = {joint.child: int(self._joint[n].id) for n, joint in self._moving.items()}
        if self.tree.base == "floating":
            below = {self.tree.root: 1, **below}
        for link, index in below.items():
            told = self._model.inertias[index]
            tensor = tensor_of(told.inertia)
            merged = Inertial(float(told.mass), vec3(told.lever), tensor)
            is_root = link == self.tree.root
            yield link, move_inertial(merged, self.X_body_root) if is_root else merged

    def set_gravity(self, gravity: Array) -> None:
        """Pull it as the MJCF does. gravity: (3,) in the world, m/s²."""
        self._model.gravity.linear = gravity


def _with_limits(urdf: str) -> str:
    """The URDF with 0 for each `effort` and `velocity` that a joint does not state.

    urdfdom refuses a file for one that is missing; nothing that is compared depends on them.
    """
    try:
        root = ElementTree.fromstring(urdf.encode())  # noqa: S314 # `read_urdf` has read it
    except (ElementTree.ParseError, ValueError):
        return urdf
    for joint in root.iterfind("joint"):
        limit = joint.find("limit")
        if limit is None and joint.get("type") in ("revolute", "prismatic"):
            limit = ElementTree.SubElement(joint, "limit")
        for key in ("effort", "velocity") if limit is not None else ():
            if limit is not None and key not in limit.attrib:
                limit.set(key, "0")
    return ElementTree.tostring(root, "unicode")


class MujocoSide:
    """Our MJCF in MuJoCo. dof: velocity index by joint name."""

    def __init__(self, path: Path, tree: Tree) -> None:
        import mujoco

        self._mj: Any = mujoco  # Any: mujoco's bindings have no complete types
        self._model = load(path, visuals=False).model
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        # Taken away before, not subtracted after: of a body of 1e-9 kg nothing would be left.
        self._model.dof_armature[:] = 0.0
        self._data = mujoco.MjData(self._model)
        mujoco.mj_setConst(self._model, self._data)  # MuJoCo keeps the masses of plain slides
        # MuJoCo takes a frame that is turned by less than 2e-6 rad for its body's frame.
        for same_frame in ("body_sameframe", "site_sameframe"):
            getattr(self._model, same_frame)[:] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
        self.nv = int(self._model.nv)
        self.mass = float(self._model.body_mass.sum())
        self.tree = tree
        self.dof: dict[str, int] = {}
        self._qpos: dict[str, int] = {}
        for joint in tree.moving_joints:
            at = self._id("JOINT", joint.name)
            if at >= 0:
                self.dof[joint.name] = int(self._model.jnt_dofadr[at])
                self._qpos[joint.name] = int(self._model.jnt_qposadr[at])
        self._written = body_names(tree)
        # Massless links between joints need not be there; `equal.mjcf` knows which must.
        self._between = {link for chain in find_chains(tree) for link in chain.between}
        self._links = {body.name: (body.name, Pose()) for body in tree.bodies}
        self._links |= {f.name: (f.body, f.X_body_frame) for f in tree.frames}

    def _id(self, kind: str, name: str) -> int:
        objects = self._mj.mjtObj
        return int(self._mj.mj_name2id(self._model, getattr(objects, f"mjOBJ_{kind}"), name))

    def unlike(self, pin: PinocchioSide) -> str:
        """What keeps the two from being compared, or ""; makes gravity alike."""
        for joint in self.tree.moving_joints:
            if joint.name not in self.dof:
                return f"the MJCF has no joint `{joint.name}`"
        for body in self.tree.bodies:
            if body.name not in self._between and self._id("BODY", self._written[body.name]) < 0:
                return f"the MJCF has no body `{self._written[body.name]}`"
        free = self._mj.mjtJoint.mjJNT_FREE
        if self.tree.base == "floating" and not (
            self._model.njnt and self._model.jnt_type[0] == free
        ):
            return "the base floats, but the first joint of the MJCF is no free joint"
        if self.nv != pin.nv:
            return f"the MJCF has {self.nv} degrees of freedom, the source {pin.nv}"
        pin.set_gravity(self._model.opt.gravity)
        return ""

    def move(self, positions: Mapping[str, float], X_world_body: Pose | None) -> None:
        """Place it at rest; None = the base is where the MJCF fixes it."""
        if X_world_body is not None:
            self._data.qpos[:7] = [*X_world_body.xyz, *X_world_body.quat]
        for name, index in self._qpos.items():
            self._data.qpos[index] = positions[name]
        self._data.qvel[:] = 0.0
        self._mj.mj_forward(self._model, self._data)

    def link_poses(self, name: str) -> Iterator[Array]:
        """Poses (4, 4) of a link in the world, through the robot's frames and by its site."""
        body, X_body_link = self._links[name]
        at = self._id("BODY", self._written[body])
        if at < 0:
            return
        X_world_body = _matrix(self._data.xpos[at], self._data.xmat[at])
        yield X_world_body @ X_body_link.matrix()
        site = self._id("SITE", name) if name != body else -1
        if site >= 0:
            yield _matrix(self._data.site_xpos[site], self._data.site_xmat[site])

    def mass_matrix(self) -> Array:
        """(nv, nv) without armature."""
        out = np.zeros((self.nv, self.nv))
        self._mj.mj_fullM(self._model, self._data, out)
        return out

    def constraint_jacobian(self) -> Array:
        """(rows, nv) of the connects and welds of the MJCF at the placed pose."""
        kinds = self._mj.mjtConstraint
        data, nv = self._data, self.nv
        rows = np.flatnonzero(np.asarray(data.efc_type) == kinds.mjCNSTR_EQUALITY)
        held = np.isin(self._model.eq_type[np.asarray(data.efc_id)[rows]], (0, 1))
        dense = np.zeros((int(data.nefc), nv))
        if self._mj.mj_isSparse(self._model):
            self._mj.mju_sparse2dense(
                dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
            )
        else:
            dense[:] = np.reshape(data.efc_J, (-1, nv))[: len(dense)]
        jacobian: Array = dense[rows[held]]
        return jacobian

    def gravity(self) -> Array:
        """(nv,): at rest the bias force is gravity alone."""
        bias: Array = self._data.qfrc_bias.copy()
        return bias

    def inertia(self, link: str) -> Inertial | None:
        """Everything that moves with a body, in its frame; None for one that MuJoCo lacks."""
        top = self._id("BODY", self._written[link])
        if top < 0:
            return None
        X_top = {top: Pose()}
        parts = []
        for body in range(top, self._model.nbody):  # parents come before children
            if self._model.body_weldid[body] != top:
                continue
            if body != top:
                w, x, y, z = (float(v) for v in self._model.body_quat[body])
                place = vec3(self._model.body_pos[body])
                X_parent_body = Pose(place, normalised_quat((w, x, y, z)))
                X_top[body] = X_top[int(self._model.body_parentid[body])] @ X_parent_body
            tensor = tensor_of(inertia_of(self._model, body))
            own = Inertial(
                float(self._model.body_mass[body]), vec3(self._model.body_ipos[body]), tensor
            )
            parts.append(move_inertial(own, X_top[body]))
        return combine(parts)

    def dof_subject(self, index: int) -> str:
        """`joint NAME` of a velocity index, `link ROOT` of the free base."""
        names = {at: f"joint {name}" for name, at in self.dof.items()}
        return names.get(index, f"link {self.tree.root}")


def _matrix(position: Array, rotation: Array) -> Array:
    out = np.eye(4)
    out[:3, :3] = np.reshape(rotation, (3, 3))
    out[:3, 3] = position
    return out
