"""What pinocchio is asked: our MJCF in MuJoCo against the source URDF, and the URDF that we write.

For the first both stand in one world: pinocchio holds the source's root link where it stands,
MuJoCo a floating base such that the same link lies there. What the joints move shows in the mass
matrix and in gravity, and what the base weighs in the whole robot's inertia.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, Pose, quat_of, vec3
from assetbuild.robot.tree import sample_positions
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Model, floats, mj

LOAD = Rule("oracle.load", "error", "MuJoCo refuses the MJCF", "see `mjcf.load`")
DIFFERS = Rule(
    "oracle.*",
    "error",
    "kinematics, mass matrix or gravity differ from what pinocchio computes on the source",
    "the MJCF is not the source's robot: please report it with the recipe",
)
UNREADABLE = Rule(
    "oracle.unreadable",
    "warning",
    "pinocchio refuses the source",
    "the other checks still compare mass, axes and limits",
)
UNSUPPORTED = Rule(
    "oracle.unsupported",
    "info",
    "planar or floating joints are not compared",
    "the other checks still compare mass, axes and limits",
)
KINDS = ("kinematics", "mass_matrix", "gravity")
Matter = tuple[float, Array, Array]
"""Mass, centre of mass, and (3, 3) inertia about it along the world's axes."""
BASE = 6
"""Degrees of freedom of a free base, the first of both libraries."""


class Oracle(mujoco.WithMujoco):
    """Kinematics, mass matrix and gravity at random poses, by two libraries.

    Errors are relative. Kinematics: entries of 4 x 4 poses against max(1, largest |entry|), metres
    and direction cosines, of every source link (merged ones through the robot's frames, and the
    MJCF's site of that name). Mass matrix: |difference| / sqrt(M_ii M_jj), so that a light finger
    counts as much as the trunk; the whole robot's mass, centre and inertia count as the base's.
    Gravity: against max(1, largest |entry|), N m and N.
    Joint friction, damping, drives and contacts take no part; armature is taken away. What loops
    hold together is compared by the readers of the formats.
    """

    own_name = "oracle"
    usual_s = 0.4
    needs: ClassVar = ("mjcf", "source")
    drives: ClassVar = False
    reads: ClassVar = ("links.json", "tree.json")
    requires: ClassVar = {"pinocchio": "oracle"}
    imports: ClassVar = ("pinocchio",)

    robot: str
    poses: int = 50
    tolerance: float = 1e-9

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes figures.json even when the two cannot be compared."""
        robot = RobotFiles(files.inputs)
        figures: dict[str, object] = {"poses": self.poses}
        odd = [j for j in robot.links.joints if j.kind in ("floating", "planar", "ball")]
        if odd:
            text = f"a {odd[0].kind} joint is not compared with pinocchio, so nothing was"
            findings = [UNSUPPORTED(f"joint {odd[0].name}", text)]
        else:
            findings = list(self._compare(files, robot.links, robot.tree, figures))
        write_figures(files, figures, {f"{kind}_error": self.tolerance for kind in KINDS})
        yield from findings

    def _compare(
        self, files: Files, links: Tree, tree: Tree, figures: dict[str, object]
    ) -> Iterator[Finding]:
        source = (files.inputs / "source.urdf").read_bytes().decode("utf-8", "replace")
        try:
            pin = _Pinocchio(source, links, tree)
        except (ValueError, RuntimeError) as error:
            text = f"pinocchio cannot read the source, nothing was compared: {error}"
            yield UNREADABLE("robot", text)
            return
        try:
            path = files.inputs / "mjcf" / f"{self.robot}.xml"
            ours = _Mujoco(mujoco.load(path, visuals=False).model, tree)
        except StepError as error:
            yield LOAD("robot", f"nothing to compare: {error.message}")
            return
        except LookupError as missing:  # `Invalid name 'knee'. Valid names: ...` of MuJoCo
            text = str(missing.args[0]).partition(". Valid")[0]
            yield DIFFERS.named("structure")("robot", f"in the MJCF: {text}")
            return
        figures |= {"nv": ours.model.nv, "mass_mjcf_kg": float(ours.model.body_mass.sum())}
        figures |= {"mass_source_kg": pin.mass}
        X_world_body = pin.X_world_root @ tree.placement(links.root)[1].inverse()
        worst = dict.fromkeys(KINDS, (0.0, "robot"))
        for positions in sample_positions(tree, self.poses, seed=0):
            pin.move(positions)
            ours.move(positions, X_world_body)
            for kind, value, subject in _errors(pin, ours):
                if not value <= worst[kind][0]:  # NaN wins
                    worst[kind] = (value, subject)
        figures |= {f"{kind}_error": value for kind, (value, _) in worst.items()}
        for kind, (value, subject) in worst.items():
            if not value <= self.tolerance:
                text = (
                    f"{kind.replace('_', ' ')} of MJCF and source differ by {value:.3g} relative "
                    f"(at most {self.tolerance:g}) over {self.poses} poses"
                )
                yield DIFFERS.named(kind)(subject, text, data={"error": value})


def _errors(pin: _Pinocchio, ours: _Mujoco) -> Iterator[tuple[str, float, str]]:
    """(kind, relative error, subject) in one pose."""
    for name, theirs in pin.link_poses():
        for placed in ours.link_poses(name):
            yield "kinematics", _apart(placed, theirs), f"link {name}"
    yield "mass_matrix", _matter_apart(ours.matter(), pin.matter()), f"link {ours.root}"
    joints = list(ours.dof)
    if not joints:
        return
    here, there = ([side.dof[name] for name in joints] for side in (ours, pin))
    matrix = mujoco.mass_matrix(ours.model, ours.data)[np.ix_(here, here)]
    wanted = pin.mass_matrix()[np.ix_(there, there)]
    root = np.sqrt(np.maximum(np.diag(wanted), np.diag(matrix)))  # pinocchio may lose an inertia
    errors = np.abs(matrix - wanted) / np.outer(root, root)
    row = int(np.unravel_index(int(np.argmax(errors)), errors.shape)[0])
    yield "mass_matrix", float(errors.max()), f"joint {joints[row]}"
    pulled = pin.gravity(ours.model.opt.gravity)[there]
    # At rest the bias force is gravity alone.
    held = ours.data.qfrc_bias[here]
    worst = int(np.argmax(np.abs(held - pulled)))
    yield "gravity", _apart(held, pulled), f"joint {joints[worst]}"


def _apart(ours: Array, theirs: Array) -> float:
    """The largest difference relative to max(1, largest |entry|)."""
    return float(np.abs(ours - theirs).max()) / max(1.0, float(np.abs(theirs).max()))


def _matter_apart(ours: Matter, theirs: Matter) -> float:
    """The largest difference of mass, centre and inertia, relative to the robot's mass and extent.

    Its extent is the radius of gyration about the world's origin.
    """
    (mass, centre, inertia), (mass_there, centre_there, inertia_there) = ours, theirs
    if not mass_there:
        return abs(mass)
    reach = float(centre_there @ centre_there + np.trace(inertia_there) / mass_there)
    apart = (
        abs(mass - mass_there) / mass_there,
        float(np.linalg.norm(centre - centre_there)) / (np.sqrt(reach) or 1.0),
        float(np.abs(inertia - inertia_there).max()) / (mass_there * reach or 1.0),
    )
    return float(np.max(apart))


class _Pinocchio:
    """The source URDF with a free base, held where it stands. dof: velocity index by joint name."""

    def __init__(self, urdf: str, links: Tree, tree: Tree) -> None:
        import pinocchio

        self._pin: Any = pinocchio  # Any: pinocchio has no types
        base = pinocchio.JointModelFreeFlyer()
        self._model = pinocchio.buildModelFromXML(_with_limits(urdf), base)
        self.mass = float(pinocchio.computeTotalMass(self._model))
        self._data, self._q = self._model.createData(), pinocchio.neutral(self._model)
        names = [joint.name for joint in tree.moving_joints]
        missing = [name for name in names if not self._model.existJointName(name)]
        if missing:
            raise ValueError(f"pinocchio finds no moving joint `{missing[0]}`")
        self._joint = {n: self._model.joints[self._model.getJointId(n)] for n in names}
        self.dof = {name: int(joint.idx_v) for name, joint in self._joint.items()}
        self._links = [body.name for body in links.bodies]
        # Above the robot's root link there may be one for the world.
        pinocchio.framesForwardKinematics(self._model, self._data, self._q)
        placed = self._data.oMf[self._model.getFrameId(links.root, pinocchio.FrameType.BODY)]
        self.X_world_root = Pose(vec3(placed.translation), quat_of(placed.rotation))

    def move(self, positions: Mapping[str, float]) -> None:
        """Place it; positions in rad or m by joint name."""
        for name, joint in self._joint.items():
            value = positions[name]
            if joint.nq == 2:  # continuous: (cos, sin)
                self._q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                self._q[joint.idx_q] = value
        self._pin.framesForwardKinematics(self._model, self._data, self._q)

    def link_poses(self) -> Iterator[tuple[str, Array]]:
        """(name, X_world_link (4, 4)) of every link of the source."""
        body = self._pin.FrameType.BODY  # joints and links share names
        for name in self._links:
            if self._model.existFrame(name, body):
                yield name, self._data.oMf[self._model.getFrameId(name, body)].homogeneous

    def matter(self) -> Matter:
        """Mass (kg), centre of mass (m, world) and inertia about it (kg m2) of the whole robot."""
        self._pin.ccrba(self._model, self._data, self._q, np.zeros(self._model.nv))
        whole = self._data.Ig
        return float(whole.mass), np.array(self._data.com[0]), np.array(whole.inertia)

    def mass_matrix(self) -> Array:
        """(nv, nv), symmetric: crba fills the upper triangle only."""
        upper = np.triu(self._pin.crba(self._model, self._data, self._q))
        symmetric: Array = upper + np.triu(upper, 1).T
        return symmetric

    def gravity(self, gravity: Array) -> Array:
        """(nv,) generalised gravity at the placed pose. gravity: (3,) in the world, m/s²."""
        self._model.gravity.linear = gravity
        g: Array = self._pin.computeGeneralizedGravity(self._model, self._data, self._q).copy()
        return g


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


class _Mujoco:
    """Our MJCF without contacts and armature. dof: velocity index by joint.

    LookupError where it is not built as the robot.
    """

    def __init__(self, model: Model, tree: Tree) -> None:
        model = mujoco.without(model, "CONTACT")
        # Taken away before, not subtracted after: of a body of 1e-9 kg nothing would be left.
        model.dof_armature[:] = 0.0
        self.model, self.data, self.root = model, mj.MjData(model), tree.root
        mj.mj_setConst(model, self.data)  # MuJoCo keeps the masses of plain slides
        # MuJoCo takes a frame that is turned by less than 2e-6 rad for its body's frame.
        for same_frame in ("body_sameframe", "site_sameframe"):
            getattr(model, same_frame)[:] = int(mj.mjtSameFrame.mjSAMEFRAME_NONE)
        if (tree.base == "floating") != floats(model):
            raise LookupError(f"the base is {tree.base}, but the first joint says otherwise")
        joints = {joint.name: model.joint(joint.name) for joint in tree.moving_joints}
        self.dof = {name: int(joint.dofadr[0]) for name, joint in joints.items()}
        self._qpos = {name: int(joint.qposadr[0]) for name, joint in joints.items()}
        self._written = mujoco.body_names(tree)
        self._sites = {str(model.site(index).name) for index in range(model.nsite)}
        self._bodies = {str(model.body(index).name) for index in range(model.nbody)}
        for body in tree.bodies:
            if not body.is_massless:
                model.body(self._written[body.name])
        if more := int(model.nv) - len(self.dof) - BASE * floats(model):
            raise LookupError(f"{more} degrees of freedom more than the robot has")
        self._links = {body.name: (body.name, Pose().matrix()) for body in tree.bodies}
        self._links |= {f.name: (f.body, f.X_body_frame.matrix()) for f in tree.frames}

    def move(self, positions: Mapping[str, float], X_world_body: Pose) -> None:
        """Place it at rest. X_world_body: of a floating base."""
        if floats(self.model):
            self.data.qpos[:7] = [*X_world_body.xyz, *X_world_body.quat]
        for name, index in self._qpos.items():
            self.data.qpos[index] = positions[name]
        self.data.qvel[:] = 0.0
        mj.mj_forward(self.model, self.data)

    def link_poses(self, name: str) -> Iterator[Array]:
        """Poses (4, 4) of a link in the world, through the robot's frames and by its site.

        Massless links between joints need not be there; `equal.mjcf` knows which must.
        """
        body, X_body_link = self._links[name]
        if self._written[body] in self._bodies:
            yield _matrix(self.data.body(self._written[body])) @ X_body_link
            if name != body and name in self._sites:
                yield _matrix(self.data.site(name))

    def matter(self) -> Matter:
        """Mass, centre of mass and inertia of MuJoCo's composite of all bodies."""
        xx, yy, zz, xy, xz, yz = self.data.crb[1][:6]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        total = float(self.model.body_subtreemass[0])
        return total, np.array(self.data.subtree_com[0]), inertia


def _matrix(placed: Any) -> Array:  # Any: a body or a site of MjData
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = np.reshape(placed.xmat, (3, 3)), placed.xpos
    return out


REFUSED = Rule(
    "urdf.refused",
    "error",
    "urdfdom refuses the written URDF, and with it ROS, MoveIt and pinocchio",
    "this is a fault of assetbuild: please report it with the recipe",
)


class UrdfLoads(Check):
    """pinocchio reads the file through urdfdom, which is stricter than yourdfpy.

    Figure: the joints that pinocchio finds.
    """

    own_name = "urdf_loads"
    isolated: ClassVar = True
    # With the other checks of MuJoCo in one process; pinocchio alone is not worth a second one.
    preload: ClassVar = ("mujoco",)
    needs: ClassVar = ("urdf",)
    reads: ClassVar = ()
    requires: ClassVar = {"pinocchio": "oracle"}
    imports: ClassVar = ("pinocchio",)

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """One finding with urdfdom's own words."""
        joints, message = loaded(files.inputs / "urdf" / f"{self.robot}.urdf")
        write_figures(files, {"joints": joints})
        if joints is None:
            yield REFUSED("robot", f"urdfdom does not read the URDF: {message}")


def loaded(path: Path) -> tuple[int | None, str]:
    """The joints that move, or None and what urdfdom says, which it writes to stderr."""
    import pinocchio

    with tempfile.TemporaryFile() as log:
        stderr = os.dup(2)
        os.dup2(log.fileno(), 2)
        try:
            return int(pinocchio.buildModelFromUrdf(str(path)).njoints) - 1, ""
        except (ValueError, RuntimeError) as error:
            log.seek(0)
            lines = log.read().decode("utf-8", "replace").splitlines()
            words = [line.removeprefix("Error:").strip() for line in lines if "Error:" in line]
            return None, "; ".join(words) or str(error)
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
