"""Is the MJCF that we write the MJCF that we read: moving alike, pulling alike, sensing alike?

Both are compiled and become tables of facts, read alike. What the build changes by rule, and what
the recipe states, is not compared (`reasons`). Then both move: mass matrix, the forces of drives,
springs and dampers, tendons and all sensors in several positions.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from assetbuild.checks.mjcf_source.at_rest import read_side
from assetbuild.checks.mjcf_source.motion import Motion
from assetbuild.checks.mjcf_source.reasons import compare, tables
from assetbuild.engine.step import Files
from assetbuild.facts.compare import equality_findings
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco

LOAD = Rule(
    "equal.source.load", "error", "MuJoCo refuses our MJCF or the source's", "see `mjcf.load`"
)


class MjcfSource(Check):
    """Findings `equal.source.<what>`; all are errors and carry both values.

    What the recipe itself says (`stated`) is not compared here; the readers of
    facts compare it with the robot.
    """

    isolated = True
    preload = ("mujoco",)
    needs = ("mjcf", "source_mjcf")
    reads = ("tree.json",)

    robot: str
    stated: tuple[str, ...] = ()
    """What the recipe states itself: actuators, base, collision, contact, decimated, exclude,
    loops, merge, senses, `keyframe <name>`, and names of options."""

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
            "exclude": bool(recipe.stated("collision.exclude")),
            "impratio": "cone" in recipe.stated("mjcf"),  # another cone brings its own
            "loops": bool(recipe.value("loops")),
            "merge": "merge" in recipe.stated("fixed_joints"),
            "senses": any(map(recipe.states, ("feet", "imu", "sensors", "cameras"))),
        }
        stated = {key for key, value in said.items() if value}
        stated |= {f"keyframe {name}" for name in recipe.value("keyframes")}
        stated |= {*recipe.stated("simulation"), *recipe.stated("mjcf")}
        return {"robot": recipe.value("robot"), "stated": tuple(sorted(stated))}

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `source.xml`, `files/` and `mjcf/<robot>.xml`."""
        import mujoco as mj

        tree, stated = RobotFiles(files.inputs).tree, frozenset(self.stated)
        flat = ElementTree.fromstring((files.inputs / "source.xml").read_bytes())  # noqa: S314 # `flatten_mjcf` wrote it
        rough = is_rough(flat)
        # Without `ctrl` the source says 0; our drives hold the pose of the keyframe.
        silent = [key for key in flat.iterfind("keyframe/key") if not key.get("ctrl")]
        stated |= {f"commands {key.get('name')}" for key in silent}
        if tree.root != "world":
            _clear_scenery(flat)
        try:
            with mujoco.caught_warnings():
                source = read_side(source_spec(flat, files.inputs / "files", tree))
                path = files.inputs / "mjcf" / f"{self.robot}.xml"
                ours = read_side(mj.MjSpec.from_file(str(path)))
        except ValueError as error:
            write_figures(files, {"skipped": str(error)})
            yield LOAD("robot", f"nothing to compare: {error}")
            return
        before, after = tables(source, ours, stated)
        motion = Motion(source, ours, stated, rough=rough)
        different = compare(before, after, rough=rough)
        yield from equality_findings(different, "source", "our MJCF", {}, "the source")
        yield from motion.findings()
        counts = {
            kind: [len(before.names(kind)), len({*before.names(kind)} & {*after.names(kind)})]
            for kind in dict.fromkeys(key.kind for key in before.facts)
        }
        figures = {
            "facts": len({*before.facts, *after.facts}),
            "compared": counts,
            "not_compared": sorted(stated),
            "worst_relative_error": motion.worst,
        }
        write_figures(files, figures)


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


def source_spec(root: ElementTree.Element, folder: Path, tree: Tree) -> Any:  # Any: MjSpec
    """The source without its pictures and skins; ValueError when MuJoCo refuses it.

    A world that is the robot's root is a body of our MJCF, so its contents become one here too.
    """
    import mujoco as mj

    for parent in list(root.iter()):
        for child in list(parent):
            hfield = child.tag == "geom" and child.get("type") == "hfield"
            if child.tag in ("texture", "layer", "hfield", "skin") or hfield:
                parent.remove(child)
        if parent.tag in ("material", "light"):
            parent.attrib.pop("texture", None)
        if parent.tag == "compiler":
            parent.attrib.pop("discardvisual", None)
            parent.attrib.pop("fusestatic", None)
    world = root.find("worldbody")
    if tree.root == "world" and world is not None:
        whole = ElementTree.Element("body", {"name": mujoco.body_names(tree)["world"]})
        whole[:], world[:] = list(world), [whole]
    assets = {}  # numbered: to MuJoCo, files of one name in two folders are one
    for number, mesh in enumerate(root.iterfind("asset/mesh")):
        path = folder / str(mesh.get("file"))
        mesh.set("file", f"{number}{path.suffix}")
        assets[f"{number}{path.suffix}"] = path.read_bytes()
    return mj.MjSpec.from_string(ElementTree.tostring(root, "unicode"), assets=assets)
