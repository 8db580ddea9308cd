"""The robot's own files of `mjcf/`: the full one, the mjx model and the bare one, compiled."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from assetbuild.engine.digest import digest_file
from assetbuild.errors import UsageError
from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf_expected import mjcf_table, solver_facts
from assetbuild.facts.mjcf_model import MESHES, compiled_facts
from assetbuild.facts.mjcf_parts import pose_of
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.surface import Surface
from assetbuild.facts.table import Key, Table, Value, pair_name
from assetbuild.recipe_types import Positive
from assetbuild.robot.model import Actuator, Contact, Control, MjcfOnly, Place, Sensor
from assetbuild.simulators.mujoco import body_names, caught_warnings, leave_out_meshes, mj

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

OWNERS = {"joint": "joint", "shape": "shape", "frame": "frame", "camera": "camera",
          "body": "body", "root": "body", "drive": "joint", "mimic": "joint",
          "option": "simulation"}  # fmt: skip
"""Place of `MjcfOnly` whose attributes belong on an element of the robot -> its kind."""
KINDS = {"geom": "shape", "site": "frame", "pair": "contact pair", "camera": "camera"}
"""Tag of an element of its own -> kind of subject, where its section does not say it."""
SECTIONS = frozenset({"contact", "equality", "tendon", "actuator", "sensor"})
AS_IN_FILE = {"scale": (1.0, 1.0, 1.0), "refpos": (0.0, 0.0, 0.0), "refquat": (1.0, 0.0, 0.0, 0.0)}
"""What an MJCF says of a mesh whose corners are those of its file."""
NOTHING: Mapping[str, Surface] = {}
UNNAMED = re.compile(r"(geom|site|camera|pair|equality|tendon|actuator|sensor) \d+")
MEANS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("ctrlrange", "inheritrange", "ctrllimited"), ("command range",)),
    "polycoef": ("mimic multiplier", "mimic offset"), "frictionloss": ("friction",),
    "stiffness": ("stiffness", "spring reference"), "springref": ("spring reference",),
    "range": ("lower", "upper"), "group": ("role",), "mode": ("tracking",), "pos": ("pose",),
    "quat": ("pose",), "gear": ("gear", "kp", "kd", "effort"),
    "ls_iterations": ("line search iterations",),
}  # fmt: skip
"""Attribute that only MJCF says -> quantities of its owner, where they are not called as it is."""


@dataclass
class Opaque:
    """What only the source's MJCF says of a robot, which the check `mjcf_source` proves.

    subjects: elements of its own; owners: of the robot's, those with such attributes.
    touched: quantities that these attributes change.
    """

    subjects: set[tuple[str, str]] = field(default_factory=set)
    owners: set[tuple[str, str]] = field(default_factory=set)
    touched: set[Key] = field(default_factory=set)

    def says(self, key: Key) -> bool:
        """Whether the source's MJCF says this rather than the robot."""
        subject = (key.kind, key.name)
        unnamed = bool(self.subjects) and UNNAMED.fullmatch(key.name) is not None
        owned = key.is_foreign and subject in self.owners
        return unnamed or owned or subject in self.subjects or key in self.touched


def opaque_of(reference: Reference) -> Opaque:
    """What `MjcfOnly` of the robot says."""
    from defusedxml.ElementTree import fromstring

    opaque, control, names = Opaque(), reference.control, body_names(reference.tree)
    for item in control.mjcf_only:
        element = fromstring(item.element)
        if item.place in SECTIONS or (item.place == "body" and element.tag != "body"):
            opaque.subjects.add(_subject(item, element, names))
        elif item.place == "keyframe":
            poses = (f"{item.owner}/{row.joint}" for row in control.actuators)
            opaque.touched |= {Key("keyframe", pose, "target") for pose in poses}
        elif item.place == "freejoint":
            opaque.owners.add(("joint", element.get("name", "floating_base_joint")))
        elif kind := OWNERS.get(item.place):
            name = names.get(item.owner, item.owner) if kind == "body" else item.owner
            opaque.owners |= {(kind, name), ("equality", element.get("name", name))}
            if item.place == "mimic":
                opaque.owners.add(("equality", name))
            for word in element.attrib:
                opaque.touched |= {Key(kind, name, q) for q in MEANS.get(word, (word,))}
    return opaque


def _subject(item: MjcfOnly, element: Element, names: Mapping[str, str]) -> tuple[str, str]:
    """(kind, name) of an element of its own."""
    if element.tag == "exclude":
        ends = (element.get(side, "") for side in ("body1", "body2"))
        return "pair", pair_name(*(names.get(end, end) for end in ends))
    return KINDS.get(element.tag, item.place), element.get("name", "")


LACKS: Mapping[str, str] = {
    "robot articulation root": "MJCF has a tree of bodies, which needs no such mark",
    "robot self-collision": "the masks of the shapes and excluded pairs say it",
    "robot up axis": "MJCF has gravity alone",
    "robot metres per unit": "MJCF has no units",
    "robot kilograms per unit": "as above",
    "robot start pose": "keyframes say it",
    "robot soft limits": "they belong to the trainer",
    "joint velocity": "MJCF has no limit of velocity",
    "joint stall": "the motor's law acts outside of the simulator",
    "joint delay": "as above",
    "joint start": "keyframes say it",
    "joint drive target": "keyframes say it",
    "shape material": "materials that look alike share the first one's name",
    "shape collides": "the masks say it",
    "shape restitution": "MuJoCo's contacts have softness instead",
    "simulation decimation": "it belongs to the trainer",
    "floor": "the scene has one",
}
UNSEEN: Mapping[str, str] = {
    **LACKS,
    **dict.fromkeys(("shape rgba", "shape texture"), "one writer draws all forms"),
}
"""Facts that the mjx and bare files are not asked for: their visual shapes are not read."""


class MjcfReader(Reader):
    """Reads the compiled model: what moves, weighs, touches, drives and senses."""

    shares = True
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    precision: ClassVar[Precision] = MESHES
    folder: ClassVar[str] = "mjcf"
    lacks: ClassVar[Mapping[str, str]] = UNSEEN
    solver: ClassVar[str] = ""
    """Section of the recipe that states the solver; none where the file has no options."""
    visuals: ClassVar[bool] = False
    """Whether shapes that touch nothing are read: one writer draws them in all forms."""

    def robot_of(self, reference: Reference) -> Reference:
        """The robot that this form holds."""
        return reference

    def read(self, path: Path) -> Table:
        """Read any MJCF; UsageError where MuJoCo refuses it."""
        return self._read(path, Opaque(), visuals=True)

    def _read(
        self, path: Path, opaque: Opaque, *, visuals: bool, seen: Mapping[str, Surface] = NOTHING
    ) -> Table:
        """seen: digest of a mesh file -> what MuJoCo reads in it, where that was found before."""
        with caught_warnings():
            try:
                spec = mj.MjSpec.from_file(str(path))
                spec.compiler.discardvisual |= not visuals
                drawn = _leave_out_seen(spec, path, seen) if seen else {}
                table = compiled_facts(spec.compile(), opaque.subjects)
            except ValueError as error:
                text = " ".join(str(error).replace(f"{path.parent}/", "").split())
                raise UsageError(f"MuJoCo refuses `{path}`: {text}") from None
        for shape, surface in drawn.items():
            pose = np.asarray(table.facts[Key("shape", shape, "pose")], dtype=np.float64)
            placed = surface.moved(pose_of(pose[:3], pose[3:]))
            table.drop("shape", shape, "size", "pose")
            table.put("shape", shape, {"geometry": "mesh"} | placed.facts())
        return table

    def expected(self, reference: Reference) -> Table:
        """The robot that this form holds, and its solver."""
        here = self.robot_of(reference)
        table = mjcf_table(here)
        if self.solver:
            table.put("simulation", "", solver_facts(here, self.solver))
        return self._compared(table, here)

    def found(self, path: Path, reference: Reference) -> Table:
        """All facts of a file of this robot."""
        here = self.robot_of(reference)
        seen = reference.assets.known if self.visuals else NOTHING
        read = self._read(path, opaque_of(here), visuals=self.visuals, seen=seen)
        return self._compared(read, here)

    def _compared(self, table: Table, reference: Reference) -> Table:
        """Leave out what MJCF does not hold, and what the source's own MJCF already states."""
        opaque, unseen = opaque_of(reference), set[str]()
        for name in () if self.visuals else table.names("shape"):
            masks = (Key("shape", name, mask) for mask in ("contype", "conaffinity"))
            if not any(map(table.facts.get, masks)):
                unseen.add(name)
        return table.only(
            lambda key: (
                self.holds(key)
                and not opaque.says(key)
                and not (key.kind == "shape" and key.name in unseen)
            )
        )


def _leave_out_seen(spec: Any, path: Path, seen: Mapping[str, Surface]) -> dict[str, Surface]:
    """Leave out meshes that are only seen and are known: geom -> surface in the frame of the geom.

    Any: MuJoCo's MjSpec. The check `mjcf_meshes` has read these files.
    """
    known = dict[str, Surface]()
    for mesh in spec.meshes:
        file = path.parent / spec.meshdir / mesh.file
        as_it_is = all(np.array_equal(getattr(mesh, n), value) for n, value in AS_IN_FILE.items())
        if as_it_is and file.is_file() and (surface := seen.get(digest_file(file))) is not None:
            known[mesh.name] = surface
    surfaces = {
        geom.name: known[geom.meshname]
        for geom in spec.geoms
        if geom.name and geom.meshname in known and geom.type == mj.mjtGeom.mjGEOM_MESH
        and not geom.contype and not geom.conaffinity
    }  # fmt: skip
    leave_out_meshes(spec, lambda geom: geom.name in surfaces)
    return surfaces


class MjcfFacts(MjcfReader):
    """Every fact of the robot, in `<robot>.xml`."""

    own_name = "mjcf"
    needs = ("mjcf",)
    format_id = "mjcf"
    display_name = "the MJCF"
    file_globs = ("mjcf/{robot}.xml", "mjcf/assets/*")
    suffixes = (".xml", ".mjcf")
    recipe_sections = ("mjcf",)
    lacks = LACKS
    solver = "mjcf"
    visuals = True

    section = "validate"
    equality: Positive = Field(
        1e-9,
        le=1e-6,
        description="relative: any number of the MJCF, read back, against the robot's, error",
    )

    @property
    def exactness(self) -> Precision:
        """The tolerances that the recipe asks for."""
        return Precision(
            {**dict.fromkeys(EXACT, self.equality), "length": 1e-6}, self.precision.by_quantity
        )


# --- the mjx model ---


DEFAULTS = {"iterations": 20, "ls_iterations": 50, "cone": "elliptic", "tolerance": 1e-8}
"""Defaults of the recipe's `mjx`, for a bundle that does not state them."""


class MjxFacts(MjcfReader):
    """Every fact of the robot, but for contacts and solver, which the recipe's `mjx` decides."""

    own_name = "mjx"
    needs = ("mjx",)
    format_id = "mjx"
    display_name = "the mjx model"
    file_globs = ("mjcf/{robot}_mjx.xml", "mjcf/assets/*")
    recipe_sections = ("mjx",)
    solver = "mjx"

    def robot_of(self, reference: Reference) -> Reference:
        """Let only the links of `touching` collide; without self-collision only with the world."""
        settings = {**DEFAULTS, **(reference.options.get("mjx") or {})}
        options = {**reference.options, "mjx": settings}
        touching, most = settings.get("touching", ".*"), settings.get("condim")
        meets = bool(settings.get("self_collision", False))
        shapes, control = reference.shapes, reference.control
        gone = {s.name for s in shapes.of("collision") if not re.fullmatch(touching, s.link)}
        kept = tuple(shape for shape in shapes.shapes if shape.name not in gone)

        def cheap(contact: Contact) -> Contact:
            changed = {"condim": min(contact.condim, most or contact.condim)}
            return contact.model_copy(update=changed if meets else changed | {"contype": 0})

        sensors = tuple(s for s in control.sensors if s.at.kind != "shape" or s.at.name not in gone)
        only = tuple(
            item for item in control.mjcf_only
            if item.place != "option" and not (item.place == "shape" and item.owner in gone)
        )  # fmt: skip
        control = replace(
            control,
            contact=cheap(control.contact),
            contacts=tuple((n, cheap(c)) for n, c in control.contacts if n not in gone),
            excludes=control.excludes if meets else (),
            sensors=sensors,
            mjcf_only=only,
        )
        shapes = replace(shapes, shapes=kept)
        return replace(reference, shapes=shapes, control=control, options=options)


# --- the bare MJCF ---


TASK_SENSORS = {
    "imu_ang_vel": "gyro", "imu_lin_vel": "velocimeter", "imu_lin_acc": "accelerometer",
    "imu_upvector": "framezaxis", "root_angmom": "subtreeangmom",
}  # fmt: skip
"""What mjlab's velocity task reads, by name, and its kind."""
RENAMED = re.compile(r"(.*)_collision\d*")
BROUGHT = ("actuator", "option", "size", "keyframe", "drive")
"""Sections of a source's MJCF that mjlab's configuration brings itself."""


class BareFacts(MjcfReader):
    """Bodies, joints without drives, shapes, sites and the sensors of mjlab's tasks."""

    own_name = "bare"
    needs = ("mjlab",)
    format_id = "bare"
    display_name = "the bare MJCF"
    folder = ""
    file_globs = ("mjcf/{robot}_bare.xml", "mjcf/assets/*")
    recipe_sections = ("feet", "imu")
    lacks: ClassVar[Mapping[str, str]] = {
        **UNSEEN,
        "keyframe": "mjlab's configuration has the initial state",
        "simulation": "mjlab's configuration has the options",
    }

    def robot_of(self, reference: Reference) -> Reference:
        """The robot without what mjlab's configuration says."""
        control = reference.control
        drives = tuple(
            row if row.model == "passive" else Actuator(row.joint, "passive")
            for row in control.actuators
        )
        only = tuple(item for item in control.mjcf_only if item.place not in BROUGHT)
        sensors = tuple(_sensors(reference, control))
        bare = replace(control, actuators=drives, sensors=sensors, mjcf_only=only)
        return replace(reference, control=bare)

    def found(self, path: Path, reference: Reference) -> Table:
        """Rename collision geoms as the robot calls them: `FR_foot_collision2` is `FR_foot`.

        That mjlab finds every geom is the check `mjlab_contract`.
        """
        known = {shape.name for shape in reference.shapes.shapes}

        def robot_name(name: str) -> str:
            match = RENAMED.fullmatch(name)
            return match[1] if match and name not in known else name

        facts: dict[Key, Value] = {}
        for key, value in super().found(path, reference).facts.items():
            if key.kind == "shape":
                key = key._replace(name=robot_name(key.name))
            if key.kind == "sensor" and isinstance(value, str) and value.startswith("shape "):
                value = f"shape {robot_name(value.removeprefix('shape '))}"
            facts[key] = value
        return Table(facts)


def _sensors(reference: Reference, control: Control) -> Iterator[Sensor]:
    """The robot's own but for those that mjlab makes itself; those of its tasks."""
    sensors = [
        sensor
        for sensor in control.sensors
        if sensor.kind != "contact" and sensor.at.kind not in ("actuator", "tendon")
    ]
    yield from sensors
    there = {sensor.name for sensor in sensors}
    root = reference.tree.root
    at = Place("frame", str((reference.options.get("imu") or {}).get("link") or root))
    for name, kind in TASK_SENSORS.items():
        if reference.tree.base == "floating" and name not in there:
            yield Sensor(name, kind, Place("body", root) if kind.startswith("subtree") else at)
