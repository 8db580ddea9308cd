"""Is the compiled MJCF the robot: every mass, tensor, pose, axis, limit, gain and shape?"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from assetbuild.checks.mjcf_equal import senses
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.quantities import Positive
from assetbuild.robot.chains import axis_in_body, find_chains
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import MOVING, Actuator, Control, Inertial, Joint, Keyframe, Tree
from assetbuild.robot.pose import IDENTITY, Array, Pose, normalised_quat, vec3
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Shape, Shapes, Sphere
from assetbuild.simulators import mujoco

ROUNDING = 1e-14
"""Absolute, in SI units: where the expected value is zero."""

DIFFERS = Rule(
    "equal.mjcf.*",
    "error",
    "the compiled model differs from the robot",
    "report it with both numbers: this is a bug",
)
LOAD = Rule("equal.mjcf.load", "error", "MuJoCo refuses the MJCF", "see `mjcf.load`")


class MjcfEqual(Check):
    """Findings `equal.mjcf.<what>`; all are errors and carry both values."""

    version = "5"
    isolated = True
    preload = ("mujoco",)
    tools = ("mujoco",)
    needs = ("mjcf",)
    reads = ("tree.json", "shapes.json", "control.json")

    robot: str
    section = "validate"

    equality: Positive = Field(
        1e-9,
        le=1e-6,
        description="relative: any number of the MJCF, read back, against the robot's, error",
    )

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and `mjcf/<robot>.xml`."""
        robot = RobotFiles(files.inputs)
        try:
            model = mujoco.load(files.inputs / "mjcf" / f"{self.robot}.xml").model
        except StepError as error:
            write_figures(files, {"skipped": "the MJCF does not load"})
            yield LOAD("robot", f"nothing to compare: {error.message}")
            return
        comparison = _Comparison(model, robot.tree, robot.shapes, robot.control, self.equality)
        yield from comparison.findings()
        write_figures(files, comparison.figures())


def _opens(joint: Joint) -> bool:
    lower, upper = joint.limits.lower, joint.limits.upper
    return lower is not None and (upper is None or lower < upper)


def _is_locked(joint: Joint) -> bool:
    lower, upper = joint.limits.lower, joint.limits.upper
    return joint.kind in ("revolute", "prismatic") and lower is not None and lower == upper


@dataclass
class _Worst:
    """Largest relative error seen, by what was compared."""

    values: dict[str, float]

    def note(self, what: str, error: float) -> None:
        self.values[what] = max(error, self.values.get(what, 0.0))


class _Comparison:
    def __init__(
        self,
        model: mujoco.Model,
        tree: Tree,
        shapes: Shapes,
        control: Control,
        tolerance: float,
    ) -> None:
        self.equality = tolerance
        self.model, self.tree, self.shapes, self.control = model, tree, shapes, control
        self.names = mujoco.body_names(tree)
        chains = find_chains(tree, {shape.link for shape in shapes.shapes})
        self.chains = {chain.body: chain for chain in chains}
        # Massless links between joints are no bodies here: their joints stand on the last body.
        self.absent = {link for chain in chains for link in chain.between}
        self.seats = {
            joint.name: (chain.body, X_body_joint)
            for chain in chains
            for joint, X_body_joint in zip(chain.joints, chain.joint_poses, strict=True)
        }
        self.worst = _Worst({})
        self.contacts = dict(control.contacts)
        self.index = {
            kind: {mujoco.name_of(model, kind, i): i for i in range(count)}
            for kind, count in (
                ("body", model.nbody),
                ("joint", model.njnt),
                ("geom", model.ngeom),
                ("site", model.nsite),
                ("key", model.nkey),
            )
        }

    def findings(self) -> Iterator[Finding]:
        yield from self.counts()
        yield from self.bodies()
        for joint in self.tree.joints:
            if joint.kind in MOVING:
                yield from self.joint(joint)
        yield from self.frames()
        for shape in self.shapes.shapes:
            yield from self.shape(shape)
        for key in self.control.keyframes:
            yield from self.keyframe(key)
        yield from self.simulation()
        yield from self.pairs(senses.sensors(self.model, self.control))
        yield from self.pairs(senses.cameras(self.model, self.tree, self.control))

    def figures(self) -> dict[str, object]:
        masses = [body.inertial.mass_kg for body in self.tree.bodies if body.inertial]
        return {
            "total_mass_kg": float(np.sum(self.model.body_mass)),
            "total_mass_expected_kg": math.fsum(masses),
            "tolerance": self.equality,
            "worst_relative_error": dict(self.worst.values),
        }

    # --- the parts ----------------------------------------------------------------------------

    def counts(self) -> Iterator[Finding]:
        model, tree, control = self.model, self.tree, self.control
        dofs = {"floating": 6, "planar": 3, "fixed": 0}
        nv = sum(dofs.get(joint.kind, 1) for joint in tree.joints)
        nv += 6 if tree.base == "floating" else 0
        driven = [a for a in control.actuators if a.model != "passive"]
        held = sum(joint.mimic is not None or _is_locked(joint) for joint in tree.joints)
        for what, expected, found in (
            ("bodies", len(tree.bodies) - len(self.absent), model.nbody - 1),
            ("degrees of freedom", nv, model.nv),
            ("actuators", len(driven) + self.opaque("actuator"), model.nu),
            ("keyframes", len(control.keyframes), model.nkey),
            ("equalities", held + self.opaque("equality"), model.neq),
            ("shapes", len(self.shapes.shapes) + self.opaque("body", "<geom"), model.ngeom),
        ):
            if expected != found:
                yield _differs("count", "robot", f"number of {what}", expected, found)
        yield from self.excludes()
        masses = [body.inertial.mass_kg for body in tree.bodies if body.inertial]
        total, found_total = math.fsum(masses), math.fsum(model.body_mass)
        yield from self.compare("total_mass", "robot", "total mass (kg)", [total], [found_total])

    def excludes(self) -> Iterator[Finding]:
        """Every pair of the recipe is left out, by an element or by MuJoCo's own rule; no other."""
        model = self.model
        said = {(int(pair) >> 16, int(pair) & 0xFFFF) for pair in model.exclude_signature}
        wanted = set()
        for pair in self.control.excludes:
            found = sorted(self.index["body"].get(self.names[name], 0) for name in pair)
            if not self.absent & {*pair} and found[0]:  # a body that is lost has its own finding
                wanted.add((found[0], found[1]))
        left_out = {pair for pair in wanted if pair in said or mujoco.passes(model, *pair)}
        if missing := len(wanted - left_out):
            yield _differs("count", "robot", "number of excluded pairs not there", 0, missing)
        if more := len(said - wanted) - self.opaque("contact", "<exclude"):
            yield _differs("count", "robot", "number of excluded pairs too many", 0, more)

    def opaque(self, place: str, start: str = "<") -> int:
        """How many elements of a section only MJCF has."""
        return sum(
            item.place == place and item.element.startswith(start)
            for item in self.control.mjcf_only
        )

    def bodies(self) -> Iterator[Finding]:
        for body in self.tree.bodies:
            if body.name in self.absent:
                continue
            subject = f"link {body.name}"
            index = self.index["body"].get(self.names[body.name])
            if index is None:
                yield _differs("body", subject, "the body", "there", "missing")
                continue
            yield from self.inertial(subject, body.inertial, index)
            joint, chain = self.tree.joint_above.get(body.name), self.chains.get(body.name)
            above = chain.parent if chain else joint.parent if joint else ""
            parent = self.names[above] if above else "world"
            found = mujoco.name_of(self.model, "body", int(self.model.body_parentid[index]))
            if found != parent:
                yield _differs("parent", subject, "parent", parent, found)
            # Where a floating base rests at qpos0 is free; keyframes place it.
            if joint or self.tree.base == "fixed":
                pose = _pose(self.model.body_pos[index], self.model.body_quat[index])
                X_parent_body = joint.X_parent_joint if joint else self.tree.X_world_root
                X_parent_body = chain.pose_in_parent if chain else X_parent_body
                yield from self.compare_pose(subject, X_parent_body, pose)

    def inertial(self, subject: str, inertial: Inertial | None, index: int) -> Iterator[Finding]:
        model = self.model
        mass = inertial.mass_kg if inertial else 0.0
        yield from self.compare("mass", subject, "mass (kg)", [mass], [model.body_mass[index]])
        if inertial is None:
            return
        com = model.body_ipos[index]
        yield from self.compare("com", subject, "centre of mass (m)", inertial.com_m, com)
        xx, yy, zz, xy, xz, yz = inertial.inertia_com_kg_m2
        expected = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        found = mujoco.inertia_of(model, index)
        yield from self.compare("inertia", subject, "inertia (kg m2)", expected, found)

    def joint(self, joint: Joint) -> Iterator[Finding]:
        model, subject = self.model, f"joint {joint.name}"
        index = self.index["joint"].get(joint.name)
        if index is None:
            yield _differs("joint", subject, "the joint", "there", "missing")
            return
        kind = 2 if joint.kind == "prismatic" else 3  # mjJNT_SLIDE, mjJNT_HINGE
        if int(model.jnt_type[index]) != kind:
            yield _differs("joint", subject, "type", kind, int(model.jnt_type[index]))
        body = mujoco.name_of(model, "body", int(model.jnt_bodyid[index]))
        carrier, X_body_joint = self.seats.get(joint.name, (joint.child, IDENTITY))
        if body != self.names[carrier]:
            yield _differs("joint", subject, "body", carrier, body)
        axis = axis_in_body(joint, X_body_joint)
        yield from self.compare("axis", subject, "axis", axis, model.jnt_axis[index])
        yield from self.compare(
            "anchor", subject, "anchor (m)", X_body_joint.xyz, model.jnt_pos[index]
        )
        yield from self.limits(joint, index)
        yield from self.drive(joint, index)

    def limits(self, joint: Joint, index: int) -> Iterator[Finding]:
        subject, limits = f"joint {joint.name}", joint.limits
        # A range of width 0 is an equality in MJCF; a crossed one is no range at all.
        limited = joint.kind != "continuous" and _opens(joint)
        if limited != bool(self.model.jnt_limited[index]):
            yield _differs("limits", subject, "limited", limited, not limited)
        elif limited and limits.lower is not None and limits.upper is not None:
            expected = (limits.lower, limits.upper)
            found = self.model.jnt_range[index]
            yield from self.compare("limits", subject, "range (rad or m)", expected, found)

        if joint.mimic is None and _is_locked(joint):
            yield from self.held(joint, index)

    def held(self, joint: Joint, index: int) -> Iterator[Finding]:
        """The equality that stands for equal limits."""
        model, subject = self.model, f"joint {joint.name}"
        mine = [i for i in range(model.neq) if int(model.eq_obj1id[i]) == index]
        if len(mine) != 1 or int(model.eq_obj2id[mine[0]]) >= 0:
            yield _differs("limits", subject, "equalities that lock it", 1, len(mine))
            return
        expected, found = [joint.limits.lower or 0.0, 0.0], model.eq_data[mine[0]][:2]
        yield from self.compare("limits", subject, "locked at (rad or m)", expected, found)

    def drive(self, joint: Joint, index: int) -> Iterator[Finding]:
        model, subject = self.model, f"actuator {joint.name}"
        row = self.control.by_joint.get(joint.name)
        passive = Actuator(
            joint.name, "passive", damping=joint.damping or 0.0, friction=joint.friction or 0.0
        )
        actuator, dof = row or passive, int(model.jnt_dofadr[index])
        for what, expected, found in (
            ("armature", actuator.armature, model.dof_armature[dof]),
            ("damping", actuator.damping, model.dof_damping[dof]),
            ("friction", actuator.friction, model.dof_frictionloss[dof]),
        ):
            yield from self.compare(what, subject, what, [expected], [found])
        mine = [i for i in range(model.nu) if self.drives(i, index)]
        if len(mine) != (actuator.model != "passive"):
            wanted = int(actuator.model != "passive")
            yield _differs("actuator", subject, "number of actuators", wanted, len(mine))
        elif mine:
            yield from self.actuator(actuator, mine[0])

    def drives(self, actuator: int, joint: int) -> bool:
        """Whether an actuator of the model is the Robot's own drive of a joint."""
        name = mujoco.name_of(self.model, "actuator", actuator)
        foreign = any(
            item.place == "actuator" and f'name="{name}"' in item.element
            for item in self.control.mjcf_only
        )
        on_joint = int(self.model.actuator_trntype[actuator]) == 0  # mjTRN_JOINT
        return on_joint and not foreign and int(self.model.actuator_trnid[actuator, 0]) == joint

    def actuator(self, actuator: Actuator, index: int) -> Iterator[Finding]:
        model, subject = self.model, f"actuator {actuator.joint}"
        gain, bias, effort_range, limited = 1.0, (0.0, 0.0, 0.0), "ctrl", model.actuator_ctrllimited
        if actuator.model == "pd":
            gain, bias = actuator.kp, (0.0, -actuator.kp, -actuator.kd)
        elif actuator.model == "velocity":
            gain, bias = actuator.kd, (0.0, 0.0, -actuator.kd)
        if actuator.model in ("pd", "velocity", "general"):
            effort_range, limited = "force", model.actuator_forcelimited
        if actuator.ctrl is not None:
            found = model.actuator_ctrlrange[index]
            yield from self.compare("ctrl", subject, "range of the command", actuator.ctrl, found)
            if effort_range == "ctrl":
                return
        if actuator.model == "general":
            yield from self.pairs(senses.general(model, index, actuator))
            return
        found = [model.actuator_gainprm[index][0], *model.actuator_biasprm[index][:3]]
        yield from self.compare("gains", subject, "gain and bias", [gain, *bias], found)
        yield from self.compare("gear", subject, "gear", [1.0], model.actuator_gear[index][:1])
        if bool(limited[index]) != (actuator.effort is not None):
            yield _differs(
                "effort",
                subject,
                "effort limited",
                actuator.effort is not None,
                bool(limited[index]),
            )
        elif actuator.effort is not None:
            ranges = getattr(model, f"actuator_{effort_range}range")[index]
            expected = (-actuator.effort, actuator.effort)
            yield from self.compare("effort", subject, "effort (N m or N)", expected, ranges)

    def frames(self) -> Iterator[Finding]:
        for frame in self.tree.frames:
            subject = f"link {frame.name}"
            index = self.index["site"].get(frame.name)
            if index is None:
                yield _differs("frame", subject, "the site", "there", "missing")
                continue
            body = mujoco.name_of(self.model, "body", int(self.model.site_bodyid[index]))
            if body != self.names[frame.body]:
                yield _differs("frame", subject, "body of the site", frame.body, body)
            pose = _pose(self.model.site_pos[index], self.model.site_quat[index])
            yield from self.compare_pose(subject, frame.X_body_frame, pose)

    def shape(self, shape: Shape) -> Iterator[Finding]:
        """Role, body, and of a primitive its size and pose; MuJoCo turns meshes to their axes."""
        model, subject = self.model, f"shape {shape.name}"
        index = self.index["geom"].get(shape.name)
        if index is None:
            yield _differs("shape", subject, "the geom", "there", "missing")
            return
        body, X_body_link = self.tree.placement(shape.link)
        found = mujoco.name_of(model, "body", int(model.geom_bodyid[index]))
        if found != self.names[body]:
            yield _differs("shape", subject, "body", body, found)
        collides = bool(model.geom_contype[index] or model.geom_conaffinity[index])
        if collides and shape.role == "visual":
            yield _differs("shape", subject, "collides", False, collides)
        if shape.role == "collision":
            contact = self.contacts.get(shape.name, self.control.contact)
            yield from self.pairs(senses.surface(model, index, subject, contact))
        size = _half_sizes(shape)
        if size:
            found_size = model.geom_size[index][: len(size)]
            yield from self.compare("shape", subject, "half sizes (m)", size, found_size)
            pose = _pose(model.geom_pos[index], model.geom_quat[index])
            yield from self.compare_pose(subject, X_body_link @ shape.X_link_shape, pose)

    def keyframe(self, key: Keyframe) -> Iterator[Finding]:
        model, subject = self.model, f"recipe keyframes.{key.name}"
        index = self.index["key"].get(key.name)
        if index is None:
            yield _differs("keyframe", subject, "the keyframe", "there", "missing")
            return
        qpos, ctrl = model.key_qpos[index], model.key_ctrl[index]
        if key.base is not None and self.tree.base == "floating":
            found = _pose(qpos[:3], qpos[3:7])
            yield from self.compare_pose(subject, key.base, found)
        for name, value in key.joints:
            joint = self.index["joint"].get(name)
            if joint is not None:
                q = [qpos[int(model.jnt_qposadr[joint])]]
                yield from self.compare("keyframe", subject, f"position of {name}", [value], q)
                if not any(i.place == "keyframe" for i in self.control.mjcf_only):
                    yield from self.target(subject, name, value, ctrl)

    def target(self, subject: str, name: str, value: float, ctrl: Array) -> Iterator[Finding]:
        row = self.control.by_joint.get(name)
        for i in range(self.model.nu):
            joint = mujoco.name_of(self.model, "joint", int(self.model.actuator_trnid[i, 0]))
            if row and row.model == "pd" and joint == name:
                yield from self.compare(
                    "keyframe", subject, f"target of {name}", [value], [ctrl[i]]
                )

    def simulation(self) -> Iterator[Finding]:
        wanted, option = self.control.simulation, self.model.opt
        yield from self.compare(
            "option", "robot", "timestep (s)", [wanted.timestep], [option.timestep]
        )
        yield from self.compare("option", "robot", "gravity (m/s2)", wanted.gravity, option.gravity)

    # --- comparing --------------------------------------------------------------------------

    def pairs(self, pairs: Iterable[senses.Pair]) -> Iterator[Finding]:
        """A finding for each pair that differs."""
        for pair in pairs:
            if isinstance(pair.expected, str) or isinstance(pair.found, str):
                if pair.expected != pair.found:
                    yield _differs(pair.what, pair.subject, pair.words, pair.expected, pair.found)
            else:
                yield from self.compare(
                    pair.what, pair.subject, pair.words, pair.expected, pair.found
                )

    def compare(
        self, what: str, subject: str, words: str, expected: ArrayLike, found: ArrayLike
    ) -> Iterator[Finding]:
        """A finding when two arrays differ by more than the tolerance, relative to their norm."""
        a, b = np.asarray(expected, dtype=np.float64), np.asarray(found, dtype=np.float64)
        distance, size = float(np.linalg.norm(a - b)), float(np.linalg.norm(a))
        if size > 0.0:
            self.worst.note(what, distance / size)
        if not distance <= self.equality * size + ROUNDING:
            yield _differs(what, subject, words, a.ravel().tolist(), b.ravel().tolist())

    def compare_pose(self, subject: str, expected: Pose, found: Pose) -> Iterator[Finding]:
        yield from self.compare("pose", subject, "position (m)", expected.xyz, found.xyz)
        yield from self.compare("pose", subject, "rotation", expected.rotation, found.rotation)


def _pose(xyz: Array, quat: Array) -> Pose:
    w, x, y, z = (float(v) for v in quat)
    return Pose(vec3(xyz), normalised_quat((w, x, y, z)))


def _half_sizes(shape: Shape) -> tuple[float, ...]:
    match shape.geometry:
        case Box(size):
            return tuple(edge / 2 for edge in size)
        case Sphere(radius):
            return (radius,)
        case Cylinder(radius, length) | Capsule(radius, length):
            return (radius, length / 2)
    return ()


def _differs(what: str, subject: str, words: str, expected: object, found: object) -> Finding:
    return DIFFERS.named(what)(
        subject,
        f"{words}: the robot has {_shown(expected)}, the MJCF {_shown(found)}",
        hint="the target did not write what the robot says: please report it",
        data={"expected": _data(expected), "found": _data(found)},
    )


def _shown(value: object) -> str:
    if isinstance(value, list):
        return " ".join(f"{v:.9g}" for v in value)
    return str(value)


def _data(value: object) -> float | int | str | bool | tuple[float, ...]:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(float(v) for v in value)
    return value if isinstance(value, float | int | str | bool) else str(value)
