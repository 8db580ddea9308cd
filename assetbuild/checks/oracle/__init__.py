"""Our MJCF in MuJoCo against the source URDF in pinocchio: the same robot?

Conventions. Pinocchio's free flyer is the source's root link; MuJoCo's is the root body, whose
frame may be another (`Tree.placement`). Positions: pinocchio xyz + xyzw, MuJoCo xyz + wxyz.
Velocities: pinocchio linear and angular in the link, MuJoCo linear in the world, angular in the
body, so v_pin = X v_mj, M_mj = Xᵀ M_pin X, g_mj = Xᵀ g_pin.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np

from assetbuild.checks.oracle.constrained import closed_poses, constrained_error
from assetbuild.checks.oracle.sides import MujocoSide, PinocchioSide
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.model import Inertial, Loop, Tree
from assetbuild.robot.pose import Array, Pose, normalised_quat, vec3
from assetbuild.robot.tree import sample_positions

LOAD = Rule("oracle.load", "error", "MuJoCo refuses the MJCF", "see `mjcf.load`")
DIFFERS = Rule(
    "oracle.*",
    "error",
    "inertia, kinematics, mass matrix or gravity differ from what pinocchio computes on the source",
    "report it: this is a bug",
)
UNREADABLE = Rule(
    "oracle.unreadable",
    "warning",
    "pinocchio refuses the source",
    "nothing; the other checks still run",
)
UNSUPPORTED = Rule(
    "oracle.unsupported",
    "info",
    "planar or floating joints are not compared",
    "nothing; the other checks still run",
)


CLOSED_POSES, CLOSED_TOLERANCE = 10, 1e-8
CLOSED_KIND = "constrained_mass_matrix"
"""The null space of a Jacobian costs digits."""
KINDS = ("inertia", "kinematics", "mass_matrix", "gravity", CLOSED_KIND)


class Oracle(Check):
    """Inertia, and at random poses kinematics, mass matrix and gravity, by two libraries.

    Errors are relative. Kinematics: entries of 4 x 4 poses against max(1, largest |entry|), metres
    and direction cosines, of every source link (merged ones through the robot's frames, and the
    MJCF's site of that name). Mass matrix: |difference| / sqrt(M_ii M_jj), so that a light finger
    counts as much as the trunk. Gravity: against max(1, largest |entry|), N m and N.
    Inertia, of all that moves with a body: mass and tensor relative to the largest entry, the
    centre of mass relative to its distance or to the radius of gyration. Constrained mass matrix:
    as the mass matrix, of the free motions of a robot with loops, in poses that close them.
    Joint friction, damping, drives and contacts take no part; armature is taken away.
    """

    usual_s = 0.4
    isolated: ClassVar = True
    # With the other checks of MuJoCo in one process; pinocchio alone is not worth a second one.
    preload: ClassVar = ("mujoco",)
    needs: ClassVar = ("mjcf", "source")
    reads: ClassVar = ("links.json", "tree.json", "ratings.json")
    requires: ClassVar = {"pinocchio": "oracle"}

    robot: str
    poses: int = 50
    tolerance: float = 1e-9

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes figures.json even when the two cannot be compared."""
        robot = RobotFiles(files.inputs)
        figures: dict[str, object] = {"poses": self.poses}
        findings: list[Finding] = []
        odd = [j for j in robot.links.joints if j.kind in ("floating", "planar", "ball")]
        if odd:
            findings.append(_unsupported(odd[0].name, odd[0].kind))
        else:
            findings += self._compare(files, robot.links, robot.tree, robot.ratings.loops, figures)
        write_figures(files, figures, {f"{kind}_error": self._most(kind) for kind in KINDS})
        yield from findings

    def _most(self, kind: str) -> float:
        return CLOSED_TOLERANCE if kind == CLOSED_KIND else self.tolerance

    def _closed(
        self,
        pin: PinocchioSide,
        mj: MujocoSide,
        loops: Sequence[Loop],
        worst: _Worst,
        figures: dict[str, object],
    ) -> None:
        """The mass matrix that is left where the loops are closed; mimics follow their leaders."""
        if not loops:
            return
        count = 0
        for positions in closed_poses(pin.tree, loops, CLOSED_POSES):
            pin.move(positions, pin.X_body_root)
            mj.move(positions, Pose() if pin.tree.base == "floating" else None)
            error = constrained_error(pin, mj, loops, positions)
            worst.see(CLOSED_KIND, error, "robot")
            count += 1
        figures["closed_poses"] = count

    def _compare(
        self,
        files: Files,
        links: Tree,
        tree: Tree,
        loops: Sequence[Loop],
        figures: dict[str, object],
    ) -> Iterator[Finding]:
        source = (files.inputs / "source.urdf").read_bytes().decode("utf-8", "replace")
        try:
            pin = PinocchioSide(source, links, tree)
        except (ValueError, RuntimeError) as error:
            yield _unreadable(str(error))
            return
        try:
            mj = MujocoSide(files.inputs / "mjcf" / f"{self.robot}.xml", tree)
        except StepError as error:
            yield LOAD("robot", f"nothing to compare: {error.message}")
            return
        unlike = mj.unlike(pin)
        if unlike:
            yield _wrong("structure", "robot", unlike)
            return
        figures |= {"nv": mj.nv, "mass_mjcf_kg": mj.mass, "mass_source_kg": pin.mass}
        worst = _Worst()
        for link, expected in pin.inertias():
            found = mj.inertia(link)
            if found is not None or expected.mass_kg:
                worst.see("inertia", inertia_error(expected, found), f"link {link}")
        for positions, X_world_body in _poses(tree, self.poses):
            _compare_pose(pin, mj, positions, X_world_body, worst)
        self._closed(pin, mj, loops, worst, figures)
        figures |= {f"{kind}_error": value for kind, (value, _) in worst.of.items()}
        for kind, (value, subject) in worst.of.items():
            if not value <= self._most(kind):
                words = kind.replace("_", " ")
                over = "" if kind == "inertia" else f" over {self.poses} poses"
                message = (
                    f"{words} of MJCF and source differ by {value:.3g} relative "
                    f"(at most {self._most(kind):g}){over}"
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
        self.of: dict[str, tuple[float, str]] = dict.fromkeys(KINDS, (0.0, "robot"))

    def see(self, kind: str, value: float, subject: str) -> None:
        if not value <= self.of[kind][0]:  # NaN wins
            self.of[kind] = (value, subject)


def _compare_pose(
    pin: PinocchioSide,
    mj: MujocoSide,
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


def _velocity_map(pin: PinocchioSide, mj: MujocoSide, X_world_body: Pose) -> Array:
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


def inertia_error(expected: Inertial, found: Inertial | None) -> float:
    """Largest relative error of mass, centre of mass and tensor; inf where there is nothing."""
    if found is None:
        return float("inf")
    a, b = matrix_of(expected.inertia_com_kg_m2), matrix_of(found.inertia_com_kg_m2)
    gyration = float(np.sqrt(np.trace(a) / expected.mass_kg)) if expected.mass_kg else 0.0
    size = max(gyration, float(np.linalg.norm(expected.com_m)))
    centre = float(np.linalg.norm(np.subtract(found.com_m, expected.com_m)))
    pairs = (
        (abs(found.mass_kg - expected.mass_kg), expected.mass_kg),
        (centre, size),
        (float(np.abs(b - a).max()), float(np.abs(a).max())),
    )
    return max(error / scale if scale else error for error, scale in pairs)


def _wrong(kind: str, subject: str, message: str, **data: float) -> Finding:
    hint = "the MJCF is not the source's robot: please report it with the recipe"
    return DIFFERS.named(kind)(subject, message, hint, data=data)


def _unreadable(message: str) -> Finding:
    text = f"pinocchio cannot read the source, nothing was compared: {message}"
    hint = "the other checks still compare mass, axes and limits"
    return UNREADABLE("robot", text, hint)


def _unsupported(joint: str, kind: str) -> Finding:
    text = f"a {kind} joint is not compared with pinocchio, so nothing was"
    hint = "the other checks still compare mass, axes and limits"
    return UNSUPPORTED(f"joint {joint}", text, hint)
