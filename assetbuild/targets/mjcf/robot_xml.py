"""`<robot>.xml`, section by section in Menagerie's order."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Annotated, Literal
from xml.etree.ElementTree import Element

from pydantic import AfterValidator, Field

from assetbuild.errors import StepError
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.chains import axis_in_body, joint_rows
from assetbuild.robot.loops import site_names
from assetbuild.robot.model import Control, Inertial, Joint, Keyframe, Tree
from assetbuild.robot.pose import IDENTITY, Pose, quat_between, rotation_of, vec3
from assetbuild.robot.shapes import Mesh, Shapes
from assetbuild.robot.tree import depth_first
from assetbuild.simulators.mujoco import body_names
from assetbuild.targets.mjcf.classes import ClassNames
from assetbuild.targets.mjcf.drives import actuator_names, joint_classes, row_of
from assetbuild.targets.mjcf.geoms import geom_classes, geom_element
from assetbuild.targets.mjcf.inertia import principal_inertia, rounded_up
from assetbuild.targets.mjcf.sections import (
    camera_elements,
    contact_section,
    equality_section,
    extra_sites,
    refuse_hidden,
    sensor_section,
    site_elements,
)
from assetbuild.targets.mjcf.xml import direction, element, exact, number, numbers, pose_attributes

SITE_GROUP = "4"
NAME = re.compile(r"""\bname="([^"]*)\"""")
USUAL = {
    "gravity": "0 0 -9.81",
    "cone": "pyramidal",
    "solver": "Newton",
    "impratio": "1",
    "tolerance": "1e-08",
}
"""MuJoCo's own options."""


Integrator = Literal["Euler", "RK4", "implicit", "implicitfast"]
Cone = Literal["pyramidal", "elliptic"]
GRAMMARS = (3.11, 4.0)


def _known(value: float) -> float:
    if value not in GRAMMARS:
        raise ValueError("the grammars are those of MuJoCo 3.11 and 4.0")
    return value


class MjcfOptions(Model):
    """Solver options of the MJCF: the `<option>` of `<robot>.xml`, and the words it may have."""

    grammar: Annotated[float, AfterValidator(_known)] = Field(
        3.11,
        json_schema_extra={"enum": list(GRAMMARS)},
        description="version of MuJoCo whose words a source's MJCF may have; 4.0 keeps words that "
        "3.11 and mjlab do not know, which are refused without it",
    )
    integrator: Integrator = Field(
        "implicitfast", description="implicitfast integrates gains and damping implicitly"
    )
    cone: Cone | None = Field(
        None, description="of friction; without it elliptic, with which feet and fingers slip less"
    )
    impratio: Positive | None = Field(
        None, description="frictional to normal impedance; without it 50 with an elliptic cone"
    )
    solver: Literal["Newton", "CG", "PGS"] = Field("Newton", description="of the constraints")
    iterations: int | None = Field(None, ge=1, le=10_000, description="of the solver, at most")
    ls_iterations: int | None = Field(None, ge=1, le=10_000, description="of its line search")
    tolerance: Positive = Field(
        1e-12,
        description="improvement of a step, relative to the robot's mean inertia, at which the "
        "solver stops; with MuJoCo's default of 1e-8, light fingers of a heavy robot let go",
    )


class RobotXml:
    """The sections of `<robot>.xml`, in Menagerie's order."""

    def __init__(
        self,
        robot: str,
        options: MjcfOptions | None,
        tree: Tree,
        shapes: Shapes,
        control: Control,
        *,
        max_vertices: int | None = None,
        sites: Collection[str] = (),
    ) -> None:
        """options: None = no `<option>`; max_vertices: of the hull of a mesh that collides;
        sites: bodies that have a site in their origin."""
        self.robot, self.options, self.max_vertices = robot, options, max_vertices
        self.body_sites = tuple(dict.fromkeys((*extra_sites(tree, control), *sites)))
        self.tree, self.shapes, self.control = tree, shapes, control
        self.loop_sites = site_names(tree, control.loops)
        above = tree.joint_above
        carried = [above[body.name] for body in tree.bodies if body.name in above]
        # Bodies and joints in the order in which MuJoCo numbers them.
        self.order, self.joints = depth_first(tree.root, carried)
        self.body_names = body_names(tree)
        # Each body's joints, outermost first, in the order in which MuJoCo applies them.
        self.rows = joint_rows(tree, {shape.link for shape in shapes.shapes})
        self.hidden = frozenset(link for row in self.rows.values() for link in row.between)
        self.joint_poses = {
            joint.name: pose
            for row in self.rows.values()  # that of a chain comes after those of links inside it
            for joint, pose in zip(row.joints, row.joint_poses, strict=True)
        }
        limits = dict(control.soft_limits)
        rows = [
            row_of(
                replace(joint, axis=axis_in_body(joint, self.joint_poses[joint.name])),
                control.drive_of(joint),
                limits.get(joint.name),
            )
            for joint in self.joints
            if joint in tree.moving_joints
        ]
        self.driven = [row for row in rows if row.drive]
        self.drive_names = actuator_names(self.driven)
        names = ClassNames()
        self.robot_class = names.take(robot)
        roles = {role: names.take(role) for role in ("visual", "collision")}
        self.classes = joint_classes(self.robot_class, rows, names)
        self.uses = self.classes.uses()
        self.geom_classes = geom_classes(tree, shapes, control, roles, names)
        self.geom_uses = {k: use for role in self.geom_classes for k, use in role.uses().items()}
        refuse_hidden(control, self.hidden)

    def element(self, *, bare: bool = False) -> Element:
        """The root element; empty sections are left out, and keyframes when it is bare."""
        sections = [
            self.compiler(),
            self.option(),
            self.default(),
            self.asset(),
            self.worldbody(),
            contact_section(self.tree, self.shapes, self.control, self.hidden, self.body_names),
            equality_section(self.joints, self.control, self.loop_sites),
            self.actuator(),
            sensor_section(self.control, self.body_names, self.drive_names),
            *([] if bare else [self.keyframe()]),
        ]
        kept = [section for section in sections if section.attrib or len(section)]
        return element("mujoco", {"model": self.robot}, kept)

    def free_name(self, wanted: str) -> str:
        """`wanted`, with an underscore more while anything of the robot that is drawn has it."""
        taken = {shape.name for shape in self.shapes.shapes}
        taken |= {material.name for material in self.shapes.materials}
        taken |= {name for item in self.control.mjcf_only for name in NAME.findall(item.element)}
        while wanted in taken:
            wanted += "_"
        return wanted

    # --- head -------------------------------------------------------------------------------

    def compiler(self) -> Element:
        """Units, folders, and where mass may not come from."""
        textured = any(material.texture for material in self.shapes.materials)
        written = [body for body in self.tree.bodies if body.name not in self.hidden]
        massless = any(body.inertial is None for body in written)
        return element(
            "compiler",
            {
                "angle": "radian",
                "meshdir": "assets",
                "texturedir": "assets" if textured else None,
                "autolimits": "true",
                # A body without mass must not get one from its shapes.
                "inertiafromgeom": "false" if massless else None,
            },
        )

    def option(self) -> Element:
        """What the recipe says of the simulation; values of MuJoCo's own are left out.

        With an impratio of 50 nothing of ours creeps by 1 mm/s below the angle of friction (with 10
        by 2 mm/s; 100 needs more iterations).
        """
        simulation, solver = self.control.simulation, self.options
        if solver is None:
            return element("option")
        cone = solver.cone or "elliptic"
        stated = {
            "timestep": number(simulation.timestep),
            "gravity": numbers(simulation.gravity),
            "integrator": solver.integrator,
            "cone": cone,
            "solver": solver.solver,
            "iterations": str(solver.iterations or ""),
            "ls_iterations": str(solver.ls_iterations or ""),
            "impratio": number(solver.impratio or (50.0 if cone == "elliptic" else 1.0)),
            "tolerance": number(solver.tolerance),
        }
        return element("option", {k: v for k, v in stated.items() if v not in ("", USUAL.get(k))})

    def default(self) -> Element:
        """The tree of classes, see `classes`."""
        first: list[Element] = []
        if self.shapes.meshes:
            # Mass never comes from a mesh; `shell` lets flat and open ones compile.
            first.append(element("mesh", {"inertia": "shell"}))
        if self.tree.frames or self.body_sites or self.control.loops:
            first.append(element("site", {"group": SITE_GROUP}))
        first += [role.element() for role in self.geom_classes]
        return element("default", None, [self.classes.element(first)])

    def asset(self) -> Element:
        """Pictures, materials in use, and all meshes."""
        used = {shape.material for shape in self.shapes.of("visual")}
        materials = [m for m in self.shapes.materials if m.name in used]
        textures = sorted({m.texture for m in materials if m.texture})
        names = {file: f"texture{index}" for index, file in enumerate(textures)}
        made, capped = element("asset"), self.capped
        for file in textures:
            made.append(element("texture", {"name": names[file], "type": "2d", "file": file}))
        for material in materials:
            texture = names[material.texture] if material.texture else None
            rgba = numbers(material.rgba)
            look = {"name": material.name, "texture": texture, "rgba": rgba}
            made.append(element("material", look))
        for mesh in self.shapes.meshes:
            attributes = {
                "name": mesh.name if mesh.file != f"{mesh.name}.obj" else None,
                "class": self.robot_class,
                "file": mesh.file,
                "maxhullvert": str(self.max_vertices) if mesh.name in capped else None,
            }
            made.append(element("mesh", attributes))
        return made

    @property
    def capped(self) -> tuple[str, ...]:
        """Meshes that collide and have more corners than their hulls may have."""
        collides = {s.geometry for s in self.shapes.of("collision")}
        used = {geometry.mesh for geometry in collides if isinstance(geometry, Mesh)}
        most = self.max_vertices or math.inf
        return tuple(m.name for m in self.shapes.meshes if m.name in used and m.vertices > most)

    # --- bodies -----------------------------------------------------------------------------

    def worldbody(self) -> Element:
        """Bodies one by one from the root: no recursion, however long the chain."""
        content: dict[str | None, list[Element]] = defaultdict(list)
        for owner, part in self._parts():
            content[owner].append(part)
        made: dict[str | None, Element] = {None: element("worldbody", None, content[None])}
        for name in self.order:
            if name not in self.hidden:
                made[name] = element("body", self._body_attributes(name), content[name])
                above = self.rows[name].parent if name in self.rows else None
                made[above].append(made[name])
        return made[None]

    def _parts(self) -> Iterator[tuple[str | None, Element]]:
        """(body, element) of all that bodies carry, in order; None: the world."""
        for body in self.tree.bodies:
            if body.inertial is not None:
                yield body.name, _inertial(body.inertial)
        if self.tree.base == "floating":
            yield self.tree.root, element("freejoint", {"name": "floating_base_joint"})
        for name in self.order:
            for joint in self.rows[name].joints if name in self.rows else ():
                for part in self._elements_of(joint):
                    yield name, part
        yield from camera_elements(self.tree, self.control)
        for role in ("visual", "collision"):
            for shape in self.shapes.of(role):
                carrier, _ = self.tree.placement(shape.link)
                yield carrier, geom_element(shape, self.geom_uses[shape.name])
        yield from site_elements(self.tree, self.body_sites, self.body_names)
        for loop in self.control.loops:
            for site, end in zip(self.loop_sites[loop.name], loop.ends, strict=True):
                place = pose_attributes(end.X_body_end)
                yield end.body, element("site", {"name": site, **place})

    def _body_attributes(self, name: str) -> dict[str, str | None]:
        is_root = name == self.tree.root
        X_parent_body = self.resting_pose() if is_root else self.rows[name].pose_in_parent
        return {
            "name": self.body_names[name],
            "childclass": self.robot_class if is_root else None,
            **pose_attributes(X_parent_body),
        }

    def resting_pose(self) -> Pose:
        """Return the root's pose before any keyframe: a fixed root where it is held, a floating one
        at the height of the initial keyframe, else 0."""
        initial = self.control.initial_keyframe
        if self.tree.base == "fixed" or initial is None:
            return self.tree.X_world_root
        base = initial.base
        return Pose((0.0, 0.0, base.xyz[2])) if base else Pose()

    def _elements_of(self, joint: Joint) -> list[Element]:
        X_body_joint = self.joint_poses[joint.name]
        if joint.kind == "fixed":
            return []
        if joint.kind == "planar":
            return _planar_elements(joint, X_body_joint)
        if joint.kind == "ball":
            attributes = {"name": joint.name, "class": "main", "type": "ball"}
            return [element("joint", {**attributes, "pos": pose_attributes(X_body_joint)["pos"]})]
        if joint.kind == "floating":
            raise StepError(
                f"joint {joint.name}: MJCF allows a floating joint on the root body only",
                hint="build the two parts as two robots, or choose another joint type",
            )
        use = self.uses[joint.name]
        class_name = use.class_name if use.class_name != self.robot_class else None
        pos = pose_attributes(X_body_joint)["pos"]
        head = {"name": joint.name, "class": class_name, "pos": pos}
        return [element("joint", {**head, **use.left["joint"]})]

    # --- tail -------------------------------------------------------------------------------

    def actuator(self) -> Element:
        """One drive per driven joint, in the order of the joints."""
        made = element("actuator")
        for row in self.driven:
            joint, use = row.name, self.uses[row.name]
            head = {"name": self.drive_names[joint], "class": use.class_name, "joint": joint}
            made.append(element(row.drive, {**head, **use.left[row.drive]}))
        return made

    def keyframe(self) -> Element:
        """Every keyframe with its targets."""
        made = element("keyframe")
        for key in self.control.keyframes:
            qpos, ctrl = numbers(self._qpos(key)) or None, numbers(self._ctrl(key)) or None
            made.append(element("key", {"name": key.name, "qpos": qpos, "ctrl": ctrl}))
        return made

    def _qpos(self, key: Keyframe) -> list[float]:
        base = key.base or self.resting_pose()
        qpos = [*base.xyz, *base.quat] if self.tree.base == "floating" else []
        values, turns = dict(key.joints), dict(key.turns)
        for joint in self.joints:
            if joint.kind == "planar":
                qpos += [0.0, 0.0, 0.0]
            elif joint.kind == "ball":
                qpos += turns.get(joint.name, IDENTITY.quat)
            elif joint.kind != "fixed":
                qpos.append(values.get(joint.name, 0.0))
        return qpos

    def _ctrl(self, key: Keyframe) -> list[float]:
        """Position drives aim at the pose, all others at rest."""
        values = dict(key.joints)
        aims = {row.joint: row.gear for row in self.control.actuators if row.model == "pd"}
        names = (row.name for row in self.driven)
        return [values.get(name, 0.0) * aims.get(name, 0.0) for name in names]


def _inertial(inertial: Inertial) -> Element:
    moments, quat = principal_inertia(inertial.inertia_com_kg_m2)
    return element(
        "inertial",
        {
            "pos": numbers(inertial.com_m),
            "quat": numbers(quat) if quat != (1.0, 0.0, 0.0, 0.0) else None,
            "mass": number(inertial.mass_kg),
            "diaginertia": " ".join(map(exact, rounded_up(moments))),
        },
    )


def _planar_elements(joint: Joint, X_body_joint: Pose) -> list[Element]:
    """Two slides across the normal and a hinge about it; class `main`: no motor's armature."""
    turn = X_body_joint.rotation @ rotation_of(quat_between((0.0, 0.0, 1.0), joint.axis))
    return [
        element(
            "joint",
            {
                "name": f"{joint.name}_{suffix}",
                "class": "main",
                "type": "slide" if suffix != "yaw" else None,
                "pos": pose_attributes(X_body_joint)["pos"],
                "axis": direction(vec3(turn[:, column])),
            },
        )
        for column, suffix in enumerate(("x", "y", "yaw"))
    ]
