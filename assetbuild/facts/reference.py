"""The robot of a build as a table of facts: what every format is compared with."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import regular_bytes
from assetbuild.errors import UsageError
from assetbuild.facts.derived import SOLIMP, SOLREF, springs_of
from assetbuild.facts.surface import Surface
from assetbuild.facts.table import Table, Value, pair_name
from assetbuild.grouping import grouped
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import (
    MOVING,
    Actuator,
    Camera,
    Contact,
    Control,
    Inertial,
    Joint,
    Loop,
    Mimic,
    Sensor,
    Tree,
)
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.shapes import Mesh, Shape, Shapes, sizes_of

DRIVE = ("model", "kp", "kd", "damping", "friction", "armature", "effort", "velocity")
"""Quantities that a row of the actuator table has by the same names."""
TYPES = {"revolute": "rotary", "continuous": "rotary", "prismatic": "linear"}


@dataclass(frozen=True)
class Assets:
    """What the mesh and picture files of the robot hold, measured once.

    surfaces: (name of the mesh, its surface in its own frame); pixels: (file, digest of the
    picture's pixels). files: (name of the mesh, digest of its file's bytes), which only a build
    states: a bundle's files are to be read as they lie.
    """

    surfaces: tuple[tuple[str, Surface], ...] = ()
    pixels: tuple[tuple[str, str], ...] = ()
    files: tuple[tuple[str, str], ...] = ()

    @property
    def known(self) -> Mapping[str, Surface]:
        """The surface in a mesh file by the digest of its bytes: a copy needs no second reading."""
        surfaces = dict(self.surfaces)
        return {digest: surfaces[name] for name, digest in self.files if name in surfaces}


PARTS: Mapping[str, type] = {
    "links": Tree, "tree": Tree, "shapes": Shapes, "control": Control, "assets": Assets,
}  # fmt: skip
"""Parts of `report/robot.json` beside the options of the recipe."""


@dataclass(frozen=True)
class Reference:
    """The robot that all formats must be.

    links: the source's links; tree: the bodies after merging. options: sections of the recipe, by
    name, that say how a format is written.
    """

    links: Tree
    tree: Tree
    shapes: Shapes = field(default_factory=Shapes)
    control: Control = field(default_factory=Control)
    assets: Assets = field(default_factory=Assets)
    options: Mapping[str, Any] = field(default_factory=dict)  # Any: plain JSON

    @classmethod
    def of_ports(cls, folder: Path, options: Mapping[str, Any]) -> Reference:  # Any: as above
        """Read the ports of a step; `ratings.json` stands for the control where it has no other."""
        files = RobotFiles(folder)
        assets = decode(Assets, (folder / "assets.json").read_bytes())
        if not (folder / "control.json").is_file():
            control = files.ratings
        elif (folder / "ratings.json").is_file():
            control = replace(files.control, loop_mimics=files.ratings.loop_mimics)
        else:
            control = files.control
        return cls(files.links, files.tree, files.shapes, control, assets, options)

    def to_json(self) -> str:
        """`report/robot.json`."""
        kept = replace(self, assets=replace(self.assets, files=()))
        plain = {name: json.loads(encode(getattr(kept, name))) for name in PARTS}
        plain["options"] = self.options
        # Not sorted: where a section maps patterns to ranges, the first that matches wins.
        return json.dumps(plain, separators=(",", ":")) + "\n"

    @classmethod
    def of_bundle(cls, bundle: Path) -> Reference:
        """Read `report/robot.json`; UsageError where it is missing or not readable."""
        file = bundle / "report" / "robot.json"
        try:
            raw = json.loads(regular_bytes(file), object_hook=_with_new_keys)
            parts: dict[str, Any] = {  # Any: of these kinds
                name: decode(kind, json.dumps(raw[name]).encode()) for name, kind in PARTS.items()
            }
            read = cls(**parts, options=dict(raw["options"]))
            read.look_up_names()
            return read
        except (FileNotFoundError, NotADirectoryError):
            if not bundle.is_dir():
                raise UsageError(
                    f"there is no folder `{bundle}`", hint="give a folder that `build` wrote"
                ) from None
            raise UsageError(
                f"`{bundle}` is no bundle of this version: it has no report/robot.json",
                hint="build it again, or give the MJCF, URDF or USD in it",
            ) from None
        except (
            OSError,
            ValueError,
            LookupError,
            TypeError,
            AttributeError,
            RecursionError,
        ) as error:
            why = f"nothing in it is called {error}" if isinstance(error, KeyError) else error
            raise UsageError(f"`{file}` is not the robot of a bundle: {why}") from None

    def look_up_names(self) -> None:
        """KeyError for a name that nothing in the robot has."""
        for merged in (True, False):
            robot_table(self, merged=merged)
        for row in self.control.actuators:
            self.tree.by_joint[row.joint]
        for loop in self.control.loops:
            for end in loop.ends:
                self.tree.by_body[end.body]


def robot_named(bundle: Path, otherwise: str) -> str:
    """The robot's name, as the bundle's manifest has it."""
    try:
        return str(json.loads(regular_bytes(bundle / "manifest.json"))["robot"])
    except (OSError, ValueError, KeyError, TypeError):
        return otherwise


def _with_new_keys(plain: dict[str, Any]) -> dict[str, Any]:
    """The surfaces in a bundle of version 0.1, which had other names for two keys of MuJoCo's."""
    if "condim" not in plain or "mask" not in plain:
        return plain
    names = {"mask": "contype", "partners": "conaffinity"}
    return {names.get(key, key): value for key, value in plain.items()}


def robot_table(reference: Reference, *, merged: bool = True) -> Table:
    """Every fact of the robot. merged: of the bodies that are simulated, else of the links."""
    table = Table()
    tree = reference.tree if merged else reference.links
    table.put("robot", "", {"base": tree.base, "base pose": pose_value(tree.X_world_root)})
    above = tree.joint_above
    for body in tree.bodies:
        joint = above.get(body.name)
        pose = {"pose": pose_value(joint.X_parent_joint)} if joint else {}
        parent: dict[str, Value] = {"parent": joint.parent if joint else ""}
        table.put("body", body.name, parent | pose | inertial_facts(body.inertial))
    for frame in tree.frames:
        table.put("frame", frame.name, {"body": frame.body, "pose": pose_value(frame.X_body_frame)})
    for joint in tree.joints:
        table.put("joint", joint.name, joint_facts(joint))
        if joint.kind in MOVING:
            table.put("joint", joint.name, drive_facts(joint, reference.control))
    for name, (stiffness, rest) in springs_of(reference.control).items():
        table.put("joint", name, {"stiffness": stiffness, "spring reference": rest})
    for loop in reference.control.loops:
        table.put("loop", loop.name, loop_facts(loop))
    _shapes(tree, reference, table)
    for first, second in filtered_pairs(tree, reference.shapes, reference.control):
        table.put("pair", pair_name(first, second), {"filtered": True})
    for sensor in reference.control.sensors:
        table.put("sensor", sensor.name, sensor_facts(sensor))
    for camera in reference.control.cameras:
        table.put("camera", camera.name, camera_facts(camera, tree))
    for key in reference.control.keyframes:
        if key.base is not None and tree.base == "floating":
            table.put("keyframe", key.name, {"base pose": pose_value(key.base)})
        for name, position in key.joints:
            table.put("keyframe", f"{key.name}/{name}", {"position": position})
    table.put("simulation", "", simulation_values(reference.control))
    return table


def simulation_values(control: Control) -> dict[str, Value]:
    """What every simulation of the robot steps with, by the keys of the recipe's section."""
    section = dict(control.simulation)
    return {key: v if isinstance(v, tuple) else float(v) for key, v in section.items()}


def pose_value(pose: Pose) -> tuple[float, ...]:
    """(x, y, z, w, x, y, z)."""
    return (*pose.xyz, *pose.quat)


def inertial_facts(inertial: Inertial | None) -> dict[str, Value]:
    """Mass properties; a body without mass says nothing of a centre."""
    if inertial is None:
        return {"mass": 0.0}
    return {
        "mass": inertial.mass_kg,
        "centre of mass": tuple(inertial.com_m),
        "inertia": tuple(inertial.inertia_com_kg_m2),
    }


def joint_facts(joint: Joint) -> dict[str, Value]:
    """Return the facts of a joint in the frame of its child body, the joint's own at q = 0."""
    facts: dict[str, Value] = {
        "type": TYPES.get(joint.kind, joint.kind),
        "body": joint.child,
        "parent": joint.parent,
    }
    if joint.kind in MOVING:
        limited = joint.kind != "continuous"
        facts |= {
            "axis": tuple(joint.axis),
            "lower": joint.limits.lower if limited else None,
            "upper": joint.limits.upper if limited else None,
        }
    elif joint.kind == "planar":
        facts["axis"] = tuple(joint.axis)
    return facts | (mimic_facts(joint.mimic) if joint.mimic is not None else {})


def mimic_facts(mimic: Mimic) -> dict[str, Value]:
    """What a joint follows, and how; rad or m."""
    return {
        "mimics": mimic.joint,
        "mimic multiplier": mimic.multiplier,
        "mimic offset": mimic.offset,
    }


def loop_facts(loop: Loop) -> dict[str, Value]:
    """What a loop holds together; the axes at the ends of a `connect` mean nothing."""
    facts: dict[str, Value] = {"type": loop.kind}
    for side, end in zip("ab", loop.ends, strict=True):
        X = end.X_body_end
        facts[f"body {side}"] = end.body
        facts[f"end {side}"] = pose_value(X if loop.kind == "weld" else Pose(X.xyz))
    return facts | ({"torque scale": loop.torque_scale} if loop.kind == "weld" else {})


def drive_facts(joint: Joint, control: Control) -> dict[str, Value]:
    """Return what drives, brakes and limits a joint."""
    row = control.by_joint.get(joint.name) or Actuator(
        joint.name, "passive", damping=joint.damping or 0.0, friction=joint.friction or 0.0,
        effort=joint.limits.effort, velocity=joint.limits.velocity,
    )  # fmt: skip
    facts: dict[str, Value] = {word: getattr(row, word) for word in DRIVE}
    facts["command range"] = row.ctrl
    if row.model == "dc_motor":
        facts["stall"] = row.saturation
    if row.gear != 1.0:
        facts["gear"] = row.gear
    if row.name:
        facts["drive name"] = row.name
    if row.general is not None:
        facts["drive parameters"] = json.dumps(row.general.model_dump(), sort_keys=True)
    return facts


# --- shapes ---------------------------------------------------------------------------------


def _shapes(tree: Tree, reference: Reference, table: Table) -> None:
    materials = {material.name: material for material in reference.shapes.materials}
    surfaces, pixels = dict(reference.assets.surfaces), dict(reference.assets.pixels)
    contacts = dict(reference.control.contacts)
    for shape in reference.shapes.shapes:
        body, pose = tree.shape_placement(shape)
        facts: dict[str, Value] = {"role": shape.role, "body": body}
        facts |= geometry_facts(shape, pose, surfaces)
        if shape.role == "visual":
            material = materials.get(shape.material or "")
            if material is not None:
                facts["material"], facts["rgba"] = material.name, tuple(material.rgba)
                facts["texture"] = pixels.get(material.texture or "")
        else:
            facts |= surface_facts(contacts.get(shape.name, reference.control.contact))
        table.put("shape", shape.name, facts)


def geometry_facts(shape: Shape, pose: Pose, surfaces: Mapping[str, Surface]) -> dict[str, Value]:
    """Kind, size and place of a shape at `pose` in its body."""
    geometry = shape.geometry
    if isinstance(geometry, Mesh):
        surface = surfaces[geometry.mesh].moved(pose)
        return {"geometry": "mesh"} | surface.facts()
    kind = type(geometry).__name__.lower()
    return {"geometry": kind, "size": sizes_of(geometry), "pose": pose_value(pose)}


def surface_facts(contact: Contact) -> dict[str, Value]:
    """Return the facts of a surface that may touch something."""
    return {
        "friction": tuple(contact.friction),
        "condim": float(contact.condim),
        "priority": float(contact.priority),
        "solref": tuple(contact.solref or SOLREF),
        "solimp": tuple(contact.solimp or SOLIMP),
        "margin": contact.margin,
        "gap": contact.gap,
        "contype": float(contact.contype),
        "conaffinity": float(contact.conaffinity),
    }


def filtered_pairs(tree: Tree, shapes: Shapes, control: Control) -> Iterator[tuple[str, str]]:
    """Pairs of bodies (sorted) that both may touch something, and never each other.

    They are excluded by the recipe, or by MuJoCo's own rule, which every format must follow, or
    their masks never meet. `robot.contact_filter` defines that rule for readers and writers; the
    proof that it is MuJoCo's is the compiled model, which the reader of MJCF asks.
    """
    solid = grouped(shapes.of("collision"), lambda shape: tree.placement(shape.link)[0])
    rule, contacts = ContactFilter.of(tree, shapes, control), dict(control.contacts)
    excluded = {frozenset(pair) for pair in control.excludes}
    for first, second in itertools.combinations(sorted(solid), 2):
        surfaces = ([contacts.get(shape.name, control.contact) for shape in solid[body]]
                    for body in (first, second))  # fmt: skip
        meets = any(itertools.starmap(masks_meet, itertools.product(*surfaces)))
        is_excluded = frozenset((first, second)) in excluded
        if is_excluded or rule.passes(first, second) or not meets:
            yield first, second


def masks_meet(one: Contact, other: Contact) -> bool:
    """Whether MuJoCo's masks let two surfaces touch."""
    return bool(one.contype & other.conaffinity or other.contype & one.conaffinity)


# --- sensors and cameras ----------------------------------------------------------------


def sensor_facts(sensor: Sensor) -> dict[str, Value]:
    """Kind, object and noise of a sensor."""
    relative = sensor.relative_to
    return {
        "type": sensor.kind,
        "object": f"{sensor.at.kind} {sensor.at.name}".strip(),
        "reference": f"{relative.kind} {relative.name}".strip() if relative else "",
        "cutoff": sensor.cutoff,
        "noise": sensor.noise,
    }


def camera_facts(camera: Camera, tree: Tree) -> dict[str, Value]:
    """Return where a camera is and what it sees; one that no link carries stands in the world."""
    body, pose = tree.placement(camera.link) if camera.link else ("", IDENTITY)
    return {
        "body": body,
        "pose": pose_value(pose @ camera.X_link_camera),
        "field of view": camera.fovy,
        "resolution": tuple(float(n) for n in camera.resolution),
        "tracking": camera.tracking,
    }
