"""Is the MJCF that we write the MJCF that we read: moving alike, pulling alike, sensing alike?

Both are compiled and held together by name. Poses of bodies, shapes, sites and joints, the mass
matrix, the forces of drives, springs and dampers, and all sensors are compared in several
positions; what does not move is compared as it is. The reader of the source is not asked.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from assetbuild.checks.mjcf_source.compare import ROUGH
from assetbuild.checks.mjcf_source.constants import Constants
from assetbuild.checks.mjcf_source.motion import Motion
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import mujoco

SHOWN = 12
"""Most findings of one rule."""

LOAD = Rule(
    "equal.source.load", "error", "MuJoCo refuses our MJCF or the source's", "see `mjcf.load`"
)


class MjcfSource(Check):
    """Findings `equal.source.<what>`; all are errors and carry both values.

    What the recipe itself says (`stated`) is not compared.
    """

    version = "7"
    isolated = True
    preload = ("mujoco",)
    tools = ("mujoco",)
    needs = ("mjcf", "source_mjcf")
    reads = ("tree.json",)

    robot: str
    stated: tuple[str, ...] = ()
    """Of actuators, base, collision, contact, decimated, merge, and names of options."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """None for a robot that comes from no MJCF."""
        if recipe.value("source.mjcf") is None:
            return None
        links, default = (recipe.value(f"collision.{key}") for key in ("links", "default"))
        said = {
            "actuators": bool(recipe.value("actuators")),
            "base": recipe.states("base"),
            "collision": any(
                rule.method != "keep" or rule.from_ == "visual"
                for rule in (default, *links.values())
            ),
            "contact": bool(recipe.stated("contact")),
            "decimated": recipe.value("visual.max_faces") is not None,
            "merge": "merge" in recipe.stated("fixed_joints"),
        }
        stated = {key for key, value in said.items() if value}
        stated |= {*recipe.stated("simulation"), *recipe.stated("mjcf")}
        return {"robot": recipe.value("robot"), "stated": tuple(sorted(stated))}

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `source.xml`, `files/` and `mjcf/<robot>.xml`."""
        tree = RobotFiles(files.inputs).tree
        try:
            flat = ElementTree.fromstring((files.inputs / "source.xml").read_bytes())  # noqa: S314 # `flatten_mjcf` wrote it
            if tree.root != "world":
                _clear_scenery(flat)
            source = compile_flat(flat, files.inputs / "files")
            ours = mujoco.load(files.inputs / "mjcf" / f"{self.robot}.xml").model
        except StepError as error:
            write_figures(files, {"skipped": error.message})
            message = f"nothing to compare: {error.message}"
            yield LOAD("robot", message)
            return
        comparison = _Whole(source, ours, tree, frozenset(self.stated))
        if is_rough(flat):
            comparison.tolerance = ROUGH
        yield from comparison.findings()
        write_figures(files, comparison.figures())


def is_rough(root: ElementTree.Element) -> bool:
    """Whether MuJoCo itself reads the source to six digits only: before 4.0 it diagonalised a
    `fullinertia` to a relative 3e-6 (measured in 3.11); we take the source's own numbers.
    """
    import mujoco as mj

    old = int(mj.__version__.split(".")[0]) < 4
    return old and any(inertial.get("fullinertia") for inertial in root.iter("inertial"))


def _clear_scenery(root: ElementTree.Element) -> None:
    """Take away the shapes of the world: rangefinders see them, and the robot lies on them."""
    keys = ("geom", "geom1", "geom2", "objname", "refname")
    named = {element.get(key) for element in root.iter() for key in keys}
    world = root.find("worldbody")
    for geom in list(world.iterfind("geom")) if world is not None else ():
        if world is not None and geom.get("name") not in named:
            world.remove(geom)


def compile_flat(root: ElementTree.Element, folder: Path) -> mujoco.Model:
    """The source without its pictures; StepError when MuJoCo refuses it."""
    import mujoco as mj

    for parent in list(root.iter()):
        for child in list(parent):
            hfield = child.tag == "geom" and child.get("type") == "hfield"
            if child.tag in ("texture", "layer", "hfield") or hfield:
                parent.remove(child)
        if parent.tag in ("material", "light"):
            parent.attrib.pop("texture", None)
        if parent.tag == "compiler":
            parent.attrib.pop("discardvisual", None)
            parent.attrib.pop("fusestatic", None)
    meshes = [str(mesh.get("file")) for mesh in root.iterfind("asset/mesh")]
    assets = {name: (folder / name).read_bytes() for name in meshes}
    with mujoco.caught_warnings():
        try:
            return mj.MjModel.from_xml_string(ElementTree.tostring(root, "unicode"), assets)
        except ValueError as error:
            raise StepError(f"the source does not compile: {error}") from None


class _Whole(Constants, Motion):
    def findings(self) -> Iterator[Finding]:
        """Counts and constants first, then motion."""
        for found in (*self.constants(), *self.motion()):
            self.shown[found.rule] = self.shown.get(found.rule, 0) + 1
            if self.shown[found.rule] <= SHOWN:
                yield found
