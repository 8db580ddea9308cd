"""`urdf/<robot>.urdf`: the links of the source, before fixed joints are merged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

from assetbuild.engine.digest import digest_bytes
from assetbuild.errors import UsageError, Where
from assetbuild.facts.reader import Lost, Reader
from assetbuild.facts.reference import Reference, geometry_facts, mimic_facts, robot_table
from assetbuild.facts.surface import Surface, measure, pixel_digest
from assetbuild.facts.table import Table, Value
from assetbuild.mesh.obj import read_triangles
from assetbuild.robot.inertia import rotate_tensor
from assetbuild.robot.model import MOVING, Control, Joint
from assetbuild.robot.pose import Pose, quat_of_rpy, vec3
from assetbuild.robot.shapes import Capsule, Cylinder, Shape, Sphere
from assetbuild.robot.tree import held_by_world
from assetbuild.xml_text import NotXml, read_tree

if TYPE_CHECKING:
    from lxml.etree import _Element

_CONTACT = Lost("URDF has no contact parameters")
_DRIVE = Lost("URDF has no drives: a joint has limits, damping and friction alone")
_SPRING = "URDF has no springs; the finding `mjcf.spring` says so"
LACKS: Mapping[str, str] = {
    "robot base": "URDF does not say whether the root is free",
    "robot base pose": "a fixed joint to a link `world` holds a root away from the origin",
    "robot articulation root": "the root is the link without a joint above it",
    "robot self-collision": _CONTACT,
    "robot up axis": "z, always",
    "robot metres per unit": "1, always",
    "robot kilograms per unit": "1, always",
    "frame": "a merged link is a link of its own, as in the source",
    "joint anchor": "the child's frame is the joint's: the axis runs through its origin",
    "joint armature": _DRIVE,
    "joint stiffness": _SPRING,
    "joint spring reference": _SPRING,
    **dict.fromkeys(
        ("joint model", "joint kp", "joint kd", "joint gear", "joint stall", "joint command range",
         "joint drive parameters", "joint drive name", "joint delay", "joint start",
         "joint drive target"), _DRIVE,
    ),
    **dict.fromkeys(
        ("shape friction", "shape condim", "shape priority", "shape solref", "shape solimp",
         "shape margin", "shape gap", "shape contype", "shape conaffinity", "shape collides",
         "shape restitution"), _CONTACT,
    ),
    "loop": "URDF has trees alone; the finding `urdf.loop` says so",
    "pair": Lost("URDF has no list of pairs; SRDF has"),
    "sensor": Lost("URDF has no sensors"),
    "camera": Lost("URDF has no cameras"),
    "keyframe": Lost("URDF has no poses of the whole robot; SRDF has"),
    "simulation": Lost("URDF describes a robot, not a simulation"),
    "floor": "URDF describes a robot, not a scene",
    "robot start pose": "URDF has no initial pose",
    "robot soft limits": "URDF has hard limits alone",
}  # fmt: skip


class UrdfFacts(Reader):
    """`urdf/<robot>.urdf` with its meshes and pictures says what the robot is.

    Its bodies are the source's links, before fixed joints are merged.
    """

    shares = True
    needs: ClassVar = ("urdf",)
    reads: ClassVar = ("links.json", "tree.json", "shapes.json", "ratings.json", "assets.json")
    format_id: ClassVar[str] = "urdf"
    display_name: ClassVar[str] = "the URDF"
    folder: ClassVar[str] = "urdf"
    file_globs: ClassVar[tuple[str, ...]] = ("urdf/{robot}.urdf", "urdf/*")
    suffixes: ClassVar[tuple[str, ...]] = (".urdf",)
    lacks: ClassVar[Mapping[str, str]] = LACKS
    simulated: ClassVar[bool] = False

    def read(self, path: Path) -> Table:
        """Links, joints and their meshes; UsageError where it is no URDF."""
        return UrdfFile(path).read()

    def found(self, path: Path, reference: Reference) -> Table:
        """A copy of one of the robot's own meshes is not read again."""
        return UrdfFile(path, reference.assets.known).read().only(self.holds)

    def expected(self, reference: Reference) -> Table:
        """The links with their ratings; a capsule, which URDF lacks, in three pieces."""
        links = held_by_world(reference.links)
        reference = replace(reference, links=links)
        stated, table = robot_table(reference, merged=False).only(self.holds), Table()
        follows = {each.joint: each.mimic for each in reference.control.loop_mimics}
        for joint in links.joints:
            table.put("joint", joint.name, dict(_ratings(joint, reference.control)))
            if joint.name in follows:
                table.put("joint", joint.name, mimic_facts(follows[joint.name]))
        capsules = set()
        for shape in reference.shapes.shapes:
            if isinstance(shape.geometry, Capsule):
                capsules.add(shape.name)
                for name, facts in _pieces(shape, shape.geometry):
                    table.put("shape", name, stated.of("shape", shape.name) | facts)
        whole = stated.only(lambda key: key.kind != "shape" or key.name not in capsules)
        return whole | table


def _ratings(joint: Joint, control: Control) -> Iterator[tuple[str, Value]]:
    """Effort and velocity are the drive's where it limits them, else the source's, where not 0."""
    yield "urdf:type", joint.kind
    row = control.by_joint.get(joint.name)
    for name in ("effort", "velocity") if joint.kind in MOVING else ():
        driven = getattr(row, name) if row else None
        yield name, (getattr(joint.limits, name) or None) if driven is None else driven


def _pieces(shape: Shape, capsule: Capsule) -> Iterator[tuple[str, dict[str, Value]]]:
    """A cylinder and the two balls at its ends; one ball where it has no length."""
    radius, half = capsule.radius, capsule.length / 2
    pose = shape.X_link_shape
    if half == 0.0:
        yield shape.name, geometry_facts(replace(shape, geometry=Sphere(radius)), pose, {})
        return
    middle = replace(shape, geometry=Cylinder(radius, capsule.length))
    yield shape.name, geometry_facts(middle, pose, {})
    for end, z in (("top", half), ("bottom", -half)):
        ball = replace(shape, geometry=Sphere(radius))
        yield f"{shape.name}_{end}", geometry_facts(ball, pose @ Pose((0.0, 0.0, z)), {})


# --- what the file says --------------------------------------------------------------------------


TYPES = {"revolute": "rotary", "continuous": "rotary", "prismatic": "linear"}
BOUNDED = ("revolute", "prismatic")
UNLIMITED = 1e9
"""From here on a limit limits nothing: URDF has no word for that, and one left out means 0."""
SIZES: Mapping[str, tuple[str, ...]] = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
}
"""Attributes of a primitive, in the order of the vocabulary's `size`."""


def read_root(path: Path) -> _Element:
    """The element `robot`; UsageError for what is no URDF."""
    try:
        root, _ = read_tree(path.read_bytes())
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
    except NotXml as error:
        what = error.message if error.doctype else f"not readable as XML: {error.message}"
        raise UsageError(what, where=Where(path.name, error.line)) from None
    if root.tag != "robot":
        message = f"the root element is <{root.tag}>, not <robot>"
        raise UsageError(message, where=Where(path.name, cast(int, root.sourceline or 0)))
    return root


class UrdfFile:
    """Puts all links and joints of one file into a table. known: surfaces by digest of their bytes.

    Anybody's URDF is read by `source.urdf`; this one is written by us, and read without that code.
    UsageError where it is no URDF.
    """

    def __init__(self, path: Path, known: Mapping[str, Surface] | None = None) -> None:
        self._path, self._root, self._known = path, read_root(path), known or {}
        self._book = Table()
        self._looks: dict[str, dict[str, Value]] = {}
        self._surfaces: dict[str, Surface] = {}
        self._named: set[tuple[str, str]] = set()

    def read(self) -> Table:
        """A look is known to the whole file by its name, wherever it is defined."""
        for element in self._root.iter("material"):
            name, look = element.get("name", ""), self._look(element)
            if look:
                self._looks.setdefault(name, look)
        for link in self._root.iterchildren("link"):
            self._link(link)
        for joint in self._root.iterchildren("joint"):
            self._joint(joint)
        return self._book

    def _unique(self, kind: str, name: str, element: _Element) -> str:
        """The name; of a second subject of that name another one, which no robot has."""
        while (kind, name) in self._named:
            name += " (again)"
        self._named.add((kind, name))
        self._book.place(kind, name, f"{self._path.name}:{element.sourceline}")
        return name

    # --- links

    def _link(self, link: _Element) -> None:
        name = self._unique("body", link.get("name", ""), link)
        self._book.put("body", name, {"parent": "", **_inertial(link)})
        for role in ("visual", "collision"):
            for index, element in enumerate(link.iterchildren(role)):
                default_name = f"{name}_{role}" + (f"_{index}" if index else "")
                shape = self._unique("shape", element.get("name", default_name), element)
                self._book.put("shape", shape, {"role": role, "body": name})
                self._book.put("shape", shape, self._shape(element))

    def _shape(self, element: _Element) -> dict[str, Value]:
        pose, facts = origin_of(element), dict[str, Value]()
        geometry = element.find("geometry")
        for child in () if geometry is None else geometry.iterchildren("*"):
            tag = str(child.tag)
            if tag in SIZES:
                size = [number for name in SIZES[tag] for number in _numbers(child, name) or ()]
                place = (*pose.xyz, *pose.quat)
                facts |= {"geometry": tag, "size": tuple(size), "pose": place}
            elif tag == "mesh":
                facts |= {"geometry": "mesh", **self._mesh(child, pose)}
        worn = element.find("material")
        if worn is not None:
            name = worn.get("name", "")
            facts |= {"material": name, **(self._look(worn) or self._looks.get(name, {}))}
        return facts

    def _mesh(self, element: _Element, pose: Pose) -> dict[str, Value]:
        """The surface at its place in the link."""
        name = element.get("filename", "")
        facts: dict[str, Value] = {}
        scale = _numbers(element, "scale")
        if scale not in (None, (1.0, 1.0, 1.0)):
            facts["urdf:scale"] = scale
        if (self._path.parent / name).is_file():
            return facts | self._surface(name).moved(pose).facts()
        return facts | {"urdf:missing mesh": name}

    def _surface(self, name: str) -> Surface:
        """Its surface, in the frame of the file, whose lines about looks precede the mesh."""
        if name not in self._surfaces:
            data = (self._path.parent / name).read_bytes()
            while data.startswith((b"mtllib ", b"usemtl ")):
                data = data.partition(b"\n")[2]
            known = self._known.get(digest_bytes(data)) if self._known else None
            if known is None:
                mesh = read_triangles(data, name)
                known = measure(mesh.corners, mesh.uv)
            self._surfaces[name] = known
        return self._surfaces[name]

    def _look(self, element: _Element) -> dict[str, Value]:
        """A texture alone is shown as it is."""
        colour, texture = element.find("color"), element.find("texture")
        facts: dict[str, Value] = {}
        if texture is not None:
            digest = pixel_digest(self._path.parent / texture.get("filename", ""))
            facts = {"rgba": (1.0, 1.0, 1.0, 1.0), "texture": digest or None}
        if colour is not None:
            facts["rgba"] = _numbers(colour, "rgba")
        return facts

    # --- joints

    def _joint(self, element: _Element) -> None:
        name, kind = (
            self._unique("joint", element.get("name", ""), element),
            element.get("type", ""),
        )
        parent, child = (_word(element.find(end), "link") for end in ("parent", "child"))
        pose = origin_of(element)
        self._book.put("body", child, {"parent": parent, "pose": (*pose.xyz, *pose.quat)})
        facts: dict[str, Value] = {
            "type": TYPES.get(kind, kind), "urdf:type": kind, "body": child, "parent": parent,
        }  # fmt: skip
        facts |= dict(_motion(element, kind)) | dict(_mimic(element.find("mimic")))
        self._book.put("joint", name, facts)


def _inertial(link: _Element) -> dict[str, Value]:
    inertial = link.find("inertial")
    if inertial is None:
        return {"mass": 0.0}
    pose, tensor = origin_of(inertial), inertial.find("inertia")
    mass = _number(inertial.find("mass"), "value") or 0.0
    facts: dict[str, Value] = {"mass": mass, "centre of mass": pose.xyz}
    if tensor is not None:
        xx, yy, zz, xy, xz, yz = (
            _number(tensor, f"i{axes}") or 0.0 for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
        facts["inertia"] = rotate_tensor((xx, yy, zz, xy, xz, yz), pose.quat)
    return facts


def _motion(joint: _Element, kind: str) -> Iterator[tuple[str, Value]]:
    """Axis, limits and losses, of joints that have them."""
    if kind not in TYPES and kind != "planar":
        return
    axis = np.array(_numbers(joint.find("axis"), "xyz") or (1.0, 0.0, 0.0))
    yield "axis", tuple((axis / (np.linalg.norm(axis) or 1.0)).tolist())
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    if kind in BOUNDED and limit is not None:
        for side in ("lower", "upper"):
            yield side, _bound(_number(limit, side) or 0.0)
    for element, names in ((limit, ("effort", "velocity")), (dynamics, ("damping", "friction"))):
        for name in names if kind in TYPES else ():
            value = _number(element, name)
            if value is not None:
                yield name, _bound(value) if element is limit else value


def _bound(value: float) -> float | None:
    return None if abs(value) >= UNLIMITED else value


def _mimic(element: _Element | None) -> Iterator[tuple[str, Value]]:
    if element is not None:
        multiplier = _number(element, "multiplier")
        yield "mimics", element.get("joint", "")
        yield "mimic multiplier", 1.0 if multiplier is None else multiplier
        yield "mimic offset", _number(element, "offset") or 0.0


def origin_of(parent: _Element) -> Pose:
    """The pose of `<origin>`: m, and roll, pitch, yaw in rad about fixed axes."""
    origin = parent.find("origin")
    roll, pitch, yaw = _numbers(origin, "rpy") or (0.0, 0.0, 0.0)
    return Pose(vec3(_numbers(origin, "xyz") or (0.0, 0.0, 0.0)), quat_of_rpy(roll, pitch, yaw))


def _numbers(element: _Element | None, attribute: str) -> tuple[float, ...] | None:
    """The numbers of an attribute; None where it is not stated."""
    text = None if element is None else element.get(attribute)
    return None if text is None else tuple(map(float, text.split()))


def _number(element: _Element | None, attribute: str) -> float | None:
    numbers = _numbers(element, attribute)
    return numbers[0] if numbers else None


def _word(element: _Element | None, attribute: str) -> str:
    return "" if element is None else element.get(attribute, "")
