"""What the readers of the MJCF's forms share: full, mjx and bare."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from assetbuild.errors import UsageError
from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf_expected import mjcf_table, solver_facts
from assetbuild.facts.mjcf_fields import Bodies, fields
from assetbuild.facts.mjcf_model import read_model
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Table, pair_name
from assetbuild.robot.model import MjcfOnly
from assetbuild.simulators.mujoco import Model, body_names, caught_warnings, mj

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

OWNERS = {"joint": "joint", "shape": "shape", "frame": "frame", "camera": "camera",
          "body": "body", "root": "body", "drive": "joint", "mimic": "joint",
          "option": "simulation"}  # fmt: skip
"""Place of `MjcfOnly` whose attributes belong on an element of the robot -> its kind."""
KINDS = {"geom": "shape", "site": "frame", "pair": "contact pair", "camera": "camera"}
"""Tag of an element of its own -> kind of subject, where its section does not say it."""
SECTIONS = frozenset({"contact", "equality", "tendon", "actuator", "sensor"})
UNNAMED = re.compile(r"(geom|site|camera|pair|equality|tendon|actuator|sensor) \d+")
MEANS: Mapping[str, tuple[str, ...]] = {
    "ctrlrange": ("command range",), "inheritrange": ("command range",),
    "ctrllimited": ("command range",), "resolution": ("resolution",),
    "polycoef": ("mimic multiplier", "mimic offset"),
    "stiffness": ("stiffness", "spring reference"), "springref": ("spring reference",),
    "damping": ("damping",), "frictionloss": ("friction",), "armature": ("armature",),
    "range": ("lower", "upper"), "group": ("role",), "rgba": ("rgba",), "mode": ("tracking",),
    "gear": ("gear", "kp", "kd", "effort"), "pos": ("pose",), "quat": ("pose",),
    "ls_iterations": ("line search iterations",),
}  # fmt: skip
"""Attribute that only MJCF says -> quantities of its owner, where they are not called as it is."""


@dataclass(frozen=True)
class Opaque:
    """What only the source's MJCF says of a robot, which the check `mjcf_source` proves.

    subjects: elements of its own; owners: of the robot's, those with such attributes.
    touched: quantities that these attributes change.
    """

    subjects: frozenset[tuple[str, str]] = frozenset()
    owners: frozenset[tuple[str, str]] = frozenset()
    touched: frozenset[Key] = frozenset()

    def says(self, key: Key) -> bool:
        """Whether the source's MJCF says this rather than the robot."""
        subject = (key.kind, key.name)
        unnamed = bool(self.subjects) and UNNAMED.fullmatch(key.name) is not None
        owned = key.is_foreign and subject in self.owners
        return unnamed or owned or subject in self.subjects or key in self.touched


def opaque_of(reference: Reference) -> Opaque:
    """What `MjcfOnly` of the robot says."""
    from defusedxml.ElementTree import fromstring

    subjects, owners, touched = set[tuple[str, str]](), set[tuple[str, str]](), set[Key]()
    control, names = reference.control, body_names(reference.tree)
    for item in control.mjcf_only:
        element = fromstring(item.element)
        if item.place in SECTIONS or (item.place == "body" and element.tag != "body"):
            subjects.add(_subject(item, element, names))
        elif item.place == "keyframe":
            touched |= {
                Key("keyframe", f"{item.owner}/{row.joint}", "target") for row in control.actuators
            }
        elif item.place == "freejoint":
            owners.add(("joint", element.get("name", "floating_base_joint")))
        elif kind := OWNERS.get(item.place):
            name = names.get(item.owner, item.owner) if kind == "body" else item.owner
            owners |= {(kind, name)} | ({("equality", name)} if item.place == "mimic" else set())
            owners.add(("equality", element.get("name", name)))
            for word in element.attrib:
                touched |= {Key(kind, name, q) for q in MEANS.get(word, (word,))}
    return Opaque(frozenset(subjects), frozenset(owners), frozenset(touched))


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
MESHES = Precision(
    {**EXACT, "length": 1e-6}, {("shape", "texture corners"): 1e-6, ("shape", "rgba"): 1e-6}
)
"""MuJoCo keeps vertices, texture coordinates and colours as float32."""


def compiled_facts(
    model: Model,
    opaque: Opaque | None = None,
    *,
    by_area: bool = False,
    bodies: Bodies | None = None,
) -> Table:
    """A compiled model as facts. by_area: see `measure`; bodies: in whose frames."""
    table, known = Table(), opaque.subjects if opaque else ()
    elements = read_model(model, table, known, by_area=by_area, bodies=bodies)
    return Table({**table.facts, **fields(model, elements)})


class MjcfReader(Reader):
    """Reads the compiled model: what moves, weighs, touches, drives and senses."""

    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    precision: ClassVar[Precision] = MESHES
    folder: ClassVar[str] = "mjcf"
    lacks: ClassVar[Mapping[str, str]] = UNSEEN
    written: ClassVar[str] = "{robot}.xml"
    solver: ClassVar[str] = ""
    """Section of the recipe that states the solver; none where the file has no options."""
    visuals: ClassVar[bool] = False
    """Whether shapes that touch nothing are read: one writer draws them in all forms."""

    def robot_of(self, reference: Reference) -> Reference:
        """The robot that this form holds."""
        return reference

    def read(self, path: Path) -> Table:
        """Read any MJCF; UsageError where MuJoCo refuses it."""
        return self._read(path, None, visuals=True)

    def _read(self, path: Path, opaque: Opaque | None, *, visuals: bool) -> Table:
        with caught_warnings():
            try:
                spec = mj.MjSpec.from_file(str(path))
                spec.compiler.discardvisual |= not visuals
                return compiled_facts(spec.compile(), opaque)
            except ValueError as error:
                text = " ".join(str(error).replace(f"{path.parent}/", "").split())
                raise UsageError(f"MuJoCo refuses `{path}`: {text}") from None

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
        return self._compared(self._read(path, opaque_of(here), visuals=self.visuals), here)

    def _compared(self, table: Table, reference: Reference) -> Table:
        """As far as MJCF holds it and the source's MJCF does not say it itself."""
        opaque, unseen = opaque_of(reference), set[str]()
        for name in () if self.visuals else table.names("shape"):
            shape = table.of("shape", name)
            if not shape.get("contype") and not shape.get("conaffinity"):
                unseen.add(name)
        return table.only(
            lambda key: (
                self.holds(key)
                and not opaque.says(key)
                and not (key.kind == "shape" and key.name in unseen)
            )
        )
