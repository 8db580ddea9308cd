"""Our MJCF in MuJoCo against the untouched source URDF in pinocchio: the same robot?

Conventions. Pinocchio's free flyer is the source's root link; MuJoCo's is the root body, whose
frame may be another (`Tree.placement`). Positions: pinocchio xyz + xyzw, MuJoCo xyz + wxyz.
Velocities: pinocchio linear and angular in the link, MuJoCo linear in the world, angular in the
body, so v_pin = X v_mj, M_mj = Xᵀ M_pin X, g_mj = Xᵀ g_pin.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.chains import find_chains
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, Pose, normalised_quat, vec3
from assetbuild.robot.tree import sample_positions
from assetbuild.simulators.mujoco import body_names, load


class Oracle(Check):
    """Kinematics, mass matrix and gravity at random poses within the limits, by two libraries.

    Errors are relative. Kinematics: entries of 4 x 4 poses against max(1, largest |entry|), metres
    and direction cosines, of every source link (merged ones through the robot's frames, and the
    MJCF's site of that name). Mass matrix: |difference| / sqrt(M_ii M_jj), so that a light finger
    counts as much as the trunk. Gravity: against max(1, largest |entry|), N m and N.
    Joint friction, damping, drives and contacts take no part; armature is subtracted.
    """

    version: ClassVar = "4"
    tools: ClassVar = ("mujoco", "pin")
    isolated: ClassVar = True
    # With the other checks of MuJoCo in one process; pinocchio alone is not worth a second one.
    preload: ClassVar = ("mujoco",)
    needs: ClassVar = ("mjcf", "source")
    reads: ClassVar = ("links.json", "tree.json")
    requires: ClassVar = {"pinocchio": "oracle"}

    robot: str
    poses: int = 50
    tolerance: float = 1e-9

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes figures.json even when the two cannot be compared."""
        links = decode(Tree, (files.inputs / "links.json").read_bytes())
        tree = decode(Tree, (files.inputs / "tree.json").read_bytes())
        figures: dict[str, object] = {"poses": self.poses}
        findings: list[Finding] = []
        odd = [j for j in links.joints if j.kind in ("floating", "planar")]
        if odd:
            findings.append(_unsupported(odd[0].name, odd[0].kind))
        else:
            findings += self._compare(files, links, tree, figures)
        write_figures(files, figures)
        yield from findings

    def _compare(
        self, files: Files, links: Tree, tree: Tree, figures: dict[str, object]
    ) -> Iterator[Finding]:
        source = (files.inputs / "source.urdf").read_bytes().decode("utf-8", "replace")
        try:
            pin = _PinocchioSide(source, links, tree)
        except (ValueError, RuntimeError) as error:
            yield _unreadable(str(error))
            return
        try:
            mj = _MujocoSide(files.inputs / "mjcf" / f"{self.robot}.xml", tree)
        except StepError as error:
            yield Finding("oracle.load", "error", "robot", f"nothing to compare: {error.message}")
            return
        unlike = mj.unlike(pin)
        if unlike:
            yield _wrong("structure", "robot", unlike)
            return
        figures |= {"nv": mj.nv, "mass_mjcf_kg": mj.mass, "mass_source_kg": pin.mass}
        worst = _Worst()
        for positions, X_world_body in _poses(tree, self.poses):
            _compare_pose(pin, mj, positions, X_world_body, worst)
        figures |= {f"{kind}_error": value for kind, (value, _) in worst.of.items()}
        for kind, (value, subject) in worst.of.items():
            if not value <= self.tolerance:
                words = kind.replace("_", " ")
                message = (
                    f"{words} of MJCF and source differ by {value:.3g} relative "
                    f"(at most {self.tolerance:g}) over {self.poses} poses"
                )
                yield _wrong(kind, subject, message, error=value)


def _poses(tree: Tree, count: int) -> Iterator[tuple[dict[str, float], Pose]]:
    """Joint positions and X_world_body of the root body, seeded; a fixed base never moves."""
    random = np.random.default_rng(1)
    for positions in sample_positions(tree, count, seed=0):
        w, x, y, z = random.normal(size=4)
        quat = normalised_quat((float(w), float(x), float(y), float(z)))
        yield positions, Pose(vec3(random.uniform(-1.0, 1.0, size=3)), quat)


class _Worst:
    """The largest error of each kind, and what it is about."""

    def __init__(self) -> None:
        self.of: dict[str, tuple[float, str]] = dict.fromkeys(
            ("kinematics", "mass_matrix", "gravity"), (0.0, "robot")
        )

    def see(self, kind: str, value: float, subject: str) -> None:
        if not value <= self.of[kind][0]:  # NaN wins
            self.of[kind] = (value, subject)


def _compare_pose(
    pin: _PinocchioSide,
    mj: _MujocoSide,
    positions: Mapping[str, float],
    X_world_body: Pose,
    worst: _Worst,
) -> None:
    floating = pin.tree.base == "floating"
    X_world_root_link = X_world_body @ pin.X_body_root if floating else Pose()
    pin.move(positions, X_world_root_link)
    mj.move(positions, X_world_body if floating else None)
    for name, theirs in pin.link_poses():
        scale = max(1.0, float(np.abs(theirs).max()))
        for ours in mj.link_poses(name):
            error = float(np.abs(ours - theirs).max()) / scale
            worst.see("kinematics", error, f"link {name}")
    to_pin = _velocity_map(pin, mj, X_world_body)
    matrix, wanted = mj.mass_matrix(), to_pin.T @ pin.mass_matrix() @ to_pin
    if mj.nv:
        root = np.sqrt(np.diag(wanted))
        errors = np.abs(matrix - wanted) / np.outer(root, root)
        at = int(np.unravel_index(int(np.argmax(errors)), errors.shape)[0])
        worst.see("mass_matrix", float(errors.max()), mj.dof_subject(at))
        gravity, pulled = mj.gravity(), to_pin.T @ pin.gravity()
        differences = np.abs(gravity - pulled) / max(1.0, float(np.abs(pulled).max()))
        at = int(np.argmax(differences))
        worst.see("gravity", float(differences.max()), mj.dof_subject(at))


def _velocity_map(pin: _PinocchioSide, mj: _MujocoSide, X_world_body: Pose) -> Array:
    """X (nv, nv) with v_pin = X v_mj.

    Free base: v_pin = R_root_world (v_mj + (R_world_body w) x p), w_pin = R_root_body w, with p
    the way from the body's to the root link's origin in world axes.
    """
    out = np.zeros((mj.nv, mj.nv))
    for name, index in mj.dof.items():
        out[pin.dof[name], index] = 1.0
    if pin.tree.base == "floating":
        R_world_body = X_world_body.rotation
        R_body_root = pin.X_body_root.rotation
        R_root_world = (R_world_body @ R_body_root).T
        x, y, z = R_world_body @ np.asarray(pin.X_body_root.xyz)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        out[:3, :3] = R_root_world
        out[:3, 3:6] = -R_root_world @ cross @ R_world_body
        out[3:6, 3:6] = R_body_root.T
    return out


class _PinocchioSide:
    """The source URDF in pinocchio. dof: velocity index by joint name."""

    def __init__(self, urdf: str, links: Tree, tree: Tree) -> None:
        import pinocchio

        self.tree = tree
        self._pin: Any = pinocchio  # Any: pinocchio has no types
        free = (pinocchio.JointModelFreeFlyer(),) if tree.base == "floating" else ()
        self._model = pinocchio.buildModelFromXML(urdf, *free)
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
        self._links = [body.name for body in links.bodies]
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

    def gravity(self) -> Array:
        """(nv,) generalised gravity at the placed pose."""
        g: Array = self._pin.computeGeneralizedGravity(self._model, self._data, self._q).copy()
        return g

    def set_gravity(self, gravity: Array) -> None:
        """Pull it as the MJCF does."""
        self._model.gravity.linear = gravity


class _MujocoSide:
    """Our MJCF in MuJoCo. dof: velocity index by joint name."""

    def __init__(self, path: Path, tree: Tree) -> None:
        import mujoco

        self._mj: Any = mujoco  # Any: mujoco's bindings have no complete types
        self._model = load(path, visuals=False).model
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._data = mujoco.MjData(self._model)
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

    def unlike(self, pin: _PinocchioSide) -> str:
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
        """X_world_link (4, 4) through the robot's frames, and by the site of that name."""
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
        return out - np.diag(self._model.dof_armature)

    def gravity(self) -> Array:
        """(nv,): at rest the bias force is gravity alone."""
        bias: Array = self._data.qfrc_bias.copy()
        return bias

    def dof_subject(self, index: int) -> str:
        """`joint NAME` of a velocity index, `link ROOT` of the free base."""
        names = {at: f"joint {name}" for name, at in self.dof.items()}
        return names.get(index, f"link {self.tree.root}")


def _matrix(position: Array, rotation: Array) -> Array:
    out = np.eye(4)
    out[:3, :3] = np.reshape(rotation, (3, 3))
    out[:3, 3] = position
    return out


def _wrong(kind: str, subject: str, message: str, **data: float) -> Finding:
    hint = "the MJCF is not the source's robot: please report it with the recipe"
    return Finding(f"oracle.{kind}", "error", subject, message, hint, data=data)


def _unreadable(message: str) -> Finding:
    text = f"pinocchio cannot read the source, nothing was compared: {message}"
    hint = "the other checks still compare mass, axes and limits"
    return Finding("oracle.unreadable", "warning", "robot", text, hint)


def _unsupported(joint: str, kind: str) -> Finding:
    text = f"a {kind} joint is not compared with pinocchio, so nothing was"
    hint = "the other checks still compare mass, axes and limits"
    return Finding("oracle.unsupported", "info", f"joint {joint}", text, hint)
