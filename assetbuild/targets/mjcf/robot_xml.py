"""`<robot>.xml`, section by section in Menagerie's order."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from assetbuild.errors import StepError
from assetbuild.robot.model import (
    Body,
    Control,
    Joint,
    Keyframe,
    Material,
    Shapes,
    Tree,
)
from assetbuild.robot.pose import Pose, quat_between, rotation_of, vec3
from assetbuild.simulators.mujoco import body_names
from assetbuild.targets.mjcf.chains import Seats
from assetbuild.targets.mjcf.classes import Defaults, Names, Use, find_defaults, uses
from assetbuild.targets.mjcf.drives import Row, actuator_names, locked_at, row_of
from assetbuild.targets.mjcf.geoms import Geoms
from assetbuild.targets.mjcf.inertia import principal_inertia
from assetbuild.targets.mjcf.sensors import Names as SensorNames
from assetbuild.targets.mjcf.sensors import (
    cameras_by_body,
    extra_sites,
    refuse_hidden,
    sensor_section,
    site_elements,
)
from assetbuild.targets.mjcf.xml import (
    Element,
    direction,
    element,
    number,
    numbers,
    pose_attributes,
)

SITE_GROUP = "4"
NAME = re.compile(r"""\bname="([^"]*)\"""")
DEFAULT_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Solver:
    """What `<option>` says beyond the timestep and gravity."""

    integrator: str
    cone: str
    impratio: float
    solver: str = "Newton"
    iterations: int | None = None
    ls_iterations: int | None = None


class RobotXml:
    """The sections of `<robot>.xml`, in Menagerie's order."""

    def __init__(
        self,
        robot: str,
        solver: Solver | None,
        tree: Tree,
        shapes: Shapes,
        control: Control,
        *,
        hull_limits: Mapping[str, int] | None = None,
        sites: Collection[str] = (),
    ) -> None:
        """solver: None = no `<option>`; hull_limits: most corners of a mesh's hull, by name;
        sites: bodies that have a site in their origin."""
        self.robot, self.solver, self.hull_limits = robot, solver, hull_limits or {}
        self.body_sites = tuple(dict.fromkeys((*extra_sites(tree, control), *sites)))
        self.tree, self.shapes, self.control = tree, shapes, control
        self.order = depth_first(tree)
        self.body_names = body_names(tree)
        above = tree.joint_above
        self.joints = tuple(above[body] for body in self.order if body in above)
        self.seats = Seats(tree, shapes)
        self.rows = tuple(
            row_of(self.seats.seated(joint), control.by_joint.get(joint.name))
            for joint in self.joints
            if joint in tree.moving_joints
        )
        names = Names()
        self.robot_class = names.take(robot)
        roles = {role: names.take(role) for role in ("visual", "collision")}
        self.defaults: Defaults = find_defaults(self.robot_class, self.rows, names)
        self.uses: dict[str, Use] = uses(self.defaults)
        self.placed = {shape.name: tree.shape_placement(shape) for shape in shapes.shapes}
        poses = {name: pose for name, (_, pose) in self.placed.items()}
        self.geoms = Geoms(shapes, control, roles, names, poses)
        self.cameras = cameras_by_body(tree, control)
        refuse_hidden(control, self.seats.hidden)

    def element(self, *, bare: bool = False) -> Element:
        """The root element; empty sections are left out, and keyframes when it is bare."""
        sections = [
            self.compiler(),
            self.option(),
            self.default(),
            self.asset(),
            self.worldbody(),
            self.contact(),
            self.equality(),
            self.actuator(),
            self.sensor(),
            *([] if bare else [self.keyframe()]),
        ]
        kept = [section for section in sections if section.attributes or section.children]
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
        written = [body for body in self.tree.bodies if body.name not in self.seats.hidden]
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
        """What the recipe says of the simulation; values of MuJoCo's own are left out."""
        simulation, solver = self.control.simulation, self.solver
        if solver is None:
            return element("option")
        gravity = simulation.gravity
        return element(
            "option",
            {
                "timestep": number(simulation.timestep),
                "gravity": numbers(gravity) if gravity != DEFAULT_GRAVITY else None,
                "integrator": solver.integrator,
                "cone": solver.cone if solver.cone != "pyramidal" else None,
                "solver": solver.solver if solver.solver != "Newton" else None,
                "iterations": str(solver.iterations) if solver.iterations else None,
                "ls_iterations": str(solver.ls_iterations) if solver.ls_iterations else None,
                "impratio": number(solver.impratio) if solver.impratio != 1.0 else None,
            },
            gap=True,
        )

    def default(self) -> Element:
        """The tree of classes, see `classes`."""
        first: list[Element] = []
        if self.shapes.meshes:
            # Mass never comes from a mesh; `shell` lets flat and open ones compile.
            first.append(element("mesh", {"inertia": "shell"}))
        if self.tree.frames or self.body_sites:
            first.append(element("site", {"group": SITE_GROUP}))
        first += self.geoms.classes()
        return element("default", None, [self.defaults.element(tuple(first))], gap=True)

    def asset(self) -> Element:
        """Pictures, materials in use, and all meshes."""
        used = {shape.material for shape in self.shapes.of("visual")}
        materials = [m for m in self.shapes.materials if m.name in used]
        textures = sorted({m.texture for m in materials if m.texture})
        names = {file: f"texture{index}" for index, file in enumerate(textures)}
        return element(
            "asset",
            None,
            [
                *(
                    element("texture", {"name": names[file], "type": "2d", "file": file})
                    for file in textures
                ),
                *(_material(m, names) for m in materials),
                *(
                    element(
                        "mesh",
                        {
                            "name": asset.name if asset.file != f"{asset.name}.obj" else None,
                            "class": self.robot_class,
                            "file": asset.file,
                            "maxhullvert": self._hull_limit(asset.name),
                        },
                    )
                    for asset in self.shapes.meshes
                ),
            ],
            gap=True,
        )

    def _hull_limit(self, mesh: str) -> str | None:
        return str(self.hull_limits[mesh]) if mesh in self.hull_limits else None

    # --- bodies -----------------------------------------------------------------------------

    def worldbody(self) -> Element:
        """Children are made before their parents: no recursion, however long the chain."""
        made: dict[str, list[Element]] = {}
        shapes, sites = self._shapes_by_body(), self._sites_by_body()
        root: Element | None = None
        for name in reversed(self.order):
            if name in self.seats.hidden:
                continue
            content = [
                *self._inertial(self.tree.by_body[name]),
                *self._joint_elements(name),
                *self.cameras.get(name, []),
                *shapes.get(name, []),
                *sites.get(name, []),
                *reversed(made.pop(name, [])),
            ]
            root = element("body", self._body_attributes(name), content)
            parent = self.seats.parent(name)
            if parent is not None:
                made.setdefault(parent, []).append(root)
        return element(
            "worldbody", None, [*self.cameras.get(None, []), *([root] if root else [])], gap=True
        )

    def _body_attributes(self, name: str) -> dict[str, str | None]:
        is_root = name == self.tree.root
        X_parent_body = self.resting_pose() if is_root else self.seats.pose_in_parent(name)
        child_class = self.robot_class if is_root else None
        return {
            "name": self.body_names[name],
            "childclass": child_class,
            **pose_attributes(X_parent_body),
        }

    def resting_pose(self) -> Pose:
        """Of the root before any keyframe: a fixed one where it is held, a floating one at the
        height of `home`, else of the first keyframe, else 0."""
        if self.tree.base == "fixed" or not self.control.keyframes:
            return self.tree.X_world_root
        by_name = {key.name: key for key in self.control.keyframes}
        base = by_name.get("home", self.control.keyframes[0]).base
        return Pose((0.0, 0.0, base.xyz[2])) if base else Pose()

    def _inertial(self, body: Body) -> list[Element]:
        if body.inertial is None:
            return []
        moments, quat = principal_inertia(body.inertial.inertia_com_kg_m2)
        attributes = {
            "pos": numbers(body.inertial.com_m),
            "quat": numbers(quat) if quat != (1.0, 0.0, 0.0, 0.0) else None,
            "mass": number(body.inertial.mass_kg),
            "diaginertia": numbers(moments),
        }
        return [element("inertial", attributes)]

    def _joint_elements(self, body: str) -> list[Element]:
        if body == self.tree.root:
            floating = self.tree.base == "floating"
            return [element("freejoint", {"name": "floating_base_joint"})] if floating else []
        return [made for joint in self.seats.joints(body) for made in self._elements_of(joint)]

    def _elements_of(self, joint: Joint) -> list[Element]:
        X_body_joint = self.seats.joint_pose(joint)
        if joint.kind == "fixed":
            return []
        if joint.kind == "planar":
            return _planar_elements(joint, X_body_joint)
        if joint.kind == "floating":
            raise StepError(
                f"joint {joint.name}: MJCF allows a floating joint on the root body only",
                hint="build the two parts as two robots, or choose another joint type",
            )
        use = self.uses[joint.name]
        class_name = use.class_name if use.class_name != self.robot_class else None
        head = {"name": joint.name, "class": class_name, "pos": _position(X_body_joint)}
        return [element("joint", {**head, **use.joint})]

    def _shapes_by_body(self) -> dict[str, list[Element]]:
        found: dict[str, list[Element]] = {}
        for role in ("visual", "collision"):
            for shape in self.shapes.shapes:
                if shape.role == role:
                    body, _ = self.placed[shape.name]
                    found.setdefault(body, []).append(self.geoms.geom(shape))
        return found

    def _sites_by_body(self) -> dict[str, list[Element]]:
        found: dict[str, list[Element]] = {}
        for body, site in site_elements(self.tree, self.body_sites, self.body_names):
            found.setdefault(body, []).append(site)
        return found

    # --- tail -------------------------------------------------------------------------------

    def contact(self) -> Element:
        """The pairs of the recipe that MuJoCo does not filter itself."""
        pairs = [
            element("exclude", {"body1": self.body_names[a], "body2": self.body_names[b]})
            for a, b in self.control.excludes
            if not {a, b} & self.seats.hidden  # without shapes, they touch nothing
            and not (self._filtered(a, b) or self._filtered(b, a))
        ]
        return element("contact", None, pairs, gap=True)

    def _filtered(self, parent: str, child: str) -> bool:
        """MuJoCo lets parent and child pass through each other, unless the parent is part of the
        world or the filter is switched off (which only an MJCF source says)."""
        unfiltered = any("filterparent" in item.element for item in self.control.mjcf_only)
        return self.seats.parent(child) == parent and not unfiltered and not self._stands(parent)

    def _stands(self, body: str) -> bool:
        """Whether fixed joints alone hold the body to a fixed base."""
        above = self.tree.joint_above.get(body)
        while above is not None and above.kind == "fixed":
            above = self.tree.joint_above.get(above.parent)
        return above is None and self.tree.base == "fixed"

    def equality(self) -> Element:
        """Mimic joints: q = offset + multiplier * q(leader). Locked ones: q = a constant."""
        held: list[Element] = []
        for joint in self.joints:
            leader, line = None, (locked_at(joint), 0.0)
            if joint.mimic:
                leader, line = joint.mimic.joint, (joint.mimic.offset, joint.mimic.multiplier)
            offset, multiplier = line
            if offset is not None:
                attributes = {
                    "name": joint.name,
                    "joint1": joint.name,
                    "joint2": leader,
                    "polycoef": numbers((offset, multiplier, 0.0, 0.0, 0.0)),
                }
                held.append(element("joint", attributes))
        return element("equality", None, held, gap=True)

    def driven(self) -> list[tuple[Row, Use]]:
        """Joints with an actuator element, in MuJoCo's order of joints."""
        return [(row, self.uses[row.joint.name]) for row in self.rows if row.drive]

    def actuator(self) -> Element:
        """One drive per driven joint, in the order of the joints."""
        names = actuator_names(tuple(row for row, _ in self.driven()))
        made = []
        for row, use in self.driven():
            assert row.drive and use.drive  # noqa: S101 # `driven` keeps only such rows
            attributes = {
                "name": names[row.joint.name],
                "class": use.class_name,
                "joint": row.joint.name,
                **use.drive.attributes,
            }
            made.append(element(row.drive.tag, attributes))
        return element("actuator", None, made, gap=True)

    def sensor(self) -> Element:
        """The sensors of the recipe, on their sites, joints, drives and geoms."""
        drives = actuator_names(tuple(row for row, _ in self.driven()))
        names = SensorNames(self.body_names, drives)
        return sensor_section(self.control, names)

    def keyframe(self) -> Element:
        """Every keyframe with its targets."""
        keys = [
            element(
                "key",
                {
                    "name": key.name,
                    "qpos": numbers(self._qpos(key)) or None,
                    "ctrl": numbers(self._ctrl(key)) or None,
                },
            )
            for key in self.control.keyframes
        ]
        return element("keyframe", None, keys, gap=True)

    def _qpos(self, key: Keyframe) -> list[float]:
        base = key.base or self.resting_pose()
        qpos = [*base.xyz, *base.quat] if self.tree.base == "floating" else []
        values = dict(key.joints)
        for joint in self.joints:
            if joint.kind == "planar":
                qpos += [0.0, 0.0, 0.0]
            elif joint.kind != "fixed":
                qpos.append(values.get(joint.name, 0.0))
        return qpos

    def _ctrl(self, key: Keyframe) -> list[float]:
        """Position drives aim at the pose, all others at rest."""
        values = dict(key.joints)
        return [
            values.get(row.joint.name, 0.0) if row.drive and row.drive.tag == "position" else 0.0
            for row, _ in self.driven()
        ]


def depth_first(tree: Tree) -> tuple[str, ...]:
    """Body names in the order in which MuJoCo numbers them."""
    children: dict[str, list[str]] = {}
    for body in tree.bodies:
        if body.name in tree.joint_above:
            children.setdefault(tree.joint_above[body.name].parent, []).append(body.name)
    order, waiting = [], [tree.root]
    while waiting:
        name = waiting.pop()
        order.append(name)
        waiting += reversed(children.get(name, []))
    return tuple(order)


def _position(pose: Pose) -> str | None:
    return pose_attributes(pose)["pos"]


def _material(material: Material, textures: Mapping[str, str]) -> Element:
    return element(
        "material",
        {
            "name": material.name,
            "texture": textures[material.texture] if material.texture else None,
            "rgba": numbers(material.rgba),
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
                "pos": _position(X_body_joint),
                "axis": direction(vec3(turn[:, column])),
            },
        )
        for column, suffix in enumerate(("x", "y", "yaw"))
    ]
