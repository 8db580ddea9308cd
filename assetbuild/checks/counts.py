"""Is the whole source still there: every link, joint, number, shape and texture?

The readers of facts prove that our files are the robot; this check holds the robot against the
description itself, read by another parser than the build's, so that nothing can be lost before.
"""

from __future__ import annotations

import posixpath
import re
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

from assetbuild.engine.step import Files
from assetbuild.facts.compare import Precision, differences, equality_findings
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.reference import Assets, Reference, robot_table
from assetbuild.facts.table import Key, Table, Value, Writer
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Capsule, Role, Shapes

VISUAL = Rule(
    "count.visual",
    "error",
    "a link has fewer visual shapes than the source states",
    "report it: this is a bug",
)
COLLISION = Rule(
    "count.collision",
    "error",
    "a link has no collision shape though its rule asks for one",
    "report it: this is a bug",
)
EXCHANGED = Rule(
    "texture.exchanged",
    "warning",
    "a shape wears another picture than its link's materials name in the source",
    "look at the materials in the source",
)


class Counts(Check):
    """Findings `equal.source_urdf.*`, `count.visual`, `count.collision`: errors.

    Links and joints of a source that no edit changed are the robot's, number by number. A mesh of
    several materials becomes several shapes, and a collision method several pieces or
    one: so no link may have fewer visual shapes than the source states, or none where its rule
    asks for collision. A picture is compared by its name, which the robot's file names keep:
    `texture.exchanged`.
    """

    isolated: ClassVar = True
    needs: ClassVar = ("source",)
    reads: ClassVar = ("links.json", "shapes.json")

    robot: str
    rules: tuple[tuple[str, str, str], ...] = ()
    """(pattern of links, method, from) of the recipe's collision rules, the default last."""
    written: bool = False
    """The source is a URDF that we wrote: a capsule, which URDF lacks, is three elements of it."""
    absent: tuple[str, ...] = ()
    """Visual meshes that the source lacks, below its root."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any]:  # Any: values of its fields
        """Knows which links shall have no collision."""
        links, default = (recipe.value(f"collision.{key}") for key in ("links", "default"))
        rules = [*links.items(), (".*", default)]
        return {
            "robot": recipe.value("robot"),
            "rules": tuple((pattern, rule.method, rule.from_) for pattern, rule in rules),
            "absent": tuple(recipe.value("source.missing.visuals")),
            "written": any(recipe.value(key) for key in ("source.mjcf", "edits", "compose")),
        }

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `source.urdf`, `links.json` and `shapes.json`."""
        robot = RobotFiles(files.inputs)
        shapes, root = robot.shapes, _root(files.inputs / "source.urdf")
        source = UrdfFacts(robot=self.robot).read(files.inputs / "source.urdf")
        compared = 0
        if not self.written:
            compared = yield from _equal(source, robot.links)
        stated = {role: _stated(source, role) for role in ("visual", "collision")}
        if not self.written:
            stated["visual"] -= _absent(root, self.absent)
        built = {
            role: Counter(shape.link for shape in shapes.of(role))
            for role in ("visual", "collision")
        }
        drawn = built["visual"].copy()
        if self.written:
            capsules = (s.link for s in shapes.of("visual") if isinstance(s.geometry, Capsule))
            drawn.update({link: 2 * count for link, count in Counter(capsules).items()})
        yield from _visuals(stated["visual"], drawn)
        yield from self._collisions(stated, built["collision"])
        yield from _exchanged(shapes, root)
        write_figures(
            files,
            {
                "facts": compared,
                **{f"{role}_source": stated[role].total() for role in stated},
                **{f"{role}_built": built[role].total() for role in built},
            },
        )

    def _collisions(
        self, stated: Mapping[str, Counter[str]], built: Counter[str]
    ) -> Iterator[Finding]:
        for link in dict.fromkeys([*stated["visual"], *stated["collision"]]):
            method, from_ = next(
                ((m, f) for pattern, m, f in self.rules if re.fullmatch(pattern, link)),
                ("auto", "auto"),
            )
            roles = ("collision", "visual") if from_ == "auto" else (from_,)
            expected = next((n for role in roles if (n := stated[role][link])), 0)
            if method != "none" and expected and not built[link]:
                yield COLLISION(
                    f"link {link}",
                    f"the source states {expected} shapes for collision, and none was built",
                    _BUG,
                    data={"source": expected, "built": 0},
                )


_BUG = "a bug: report it with the source"


def _root(path: Path) -> Element:
    from defusedxml.ElementTree import fromstring

    root: Element = fromstring(path.read_bytes())
    return root


def _equal(source: Table, links: Tree) -> Generator[Finding, None, int]:
    """Bodies and joints of the source against the robot's links; how many facts there are."""

    def told(key: Key) -> bool:
        return key.kind in ("body", "joint") and UrdfFacts.holds(key) and not key.is_foreign

    robot = robot_table(Reference(links, links, Shapes(), Control(), Assets(), {}), merged=False)
    expected, found = robot.only(told), _with_locked(source).only(told)
    different = differences(expected, found, Precision())
    yield from equality_findings(different, "source_urdf", "the source", source.places)
    return len({*expected.facts, *found.facts})


def _with_locked(source: Table) -> Table:
    """The source as it moves: a joint that mimics a fixed one stays where that puts it, and
    so does one that follows by a multiplier of 0.
    """
    joints = {name: source.of("joint", name) for name in source.names("joint")}
    book = Writer()

    def position(name: str, above: tuple[str, ...] = ()) -> float | None:
        """rad or m; None = it moves."""
        facts = joints.get(name, {})
        leader = facts.get("mimics")
        if facts.get("type") == "fixed":
            return 0.0
        slope, offset = facts.get("mimic multiplier"), facts.get("mimic offset")
        led = bool(leader) and name not in above
        at = 0.0 if slope == 0.0 else position(str(leader), (*above, name)) if led else None
        if at is None or not isinstance(slope, float) or not isinstance(offset, float):
            return None
        return offset + slope * at

    for name, facts in joints.items():
        at = position(name)
        if at is not None and facts.get("type") != "fixed":
            free: dict[str, Value] = {"mimics": "", "mimic multiplier": None, "mimic offset": None}
            book.put("joint", name, free | {"lower": at, "upper": at})
    return source | book.table()


def _stated(source: Table, role: Role) -> Counter[str]:
    """Shapes of one role by link, as the description states them."""
    shapes: dict[str, dict[str, Value]] = {}
    for key, value in source.facts.items():
        if key.kind == "shape":
            shapes.setdefault(key.name, {})[key.quantity] = value
    return Counter(
        str(facts["body"])
        for facts in shapes.values()
        if facts["role"] == role and "geometry" in facts  # `read_urdf` reports the others
    )


def _absent(source: Element, meshes: Sequence[str]) -> Counter[str]:
    """Visuals by link whose mesh has the name of one that the recipe states as missing."""
    names = {posixpath.basename(mesh) for mesh in meshes}
    return Counter(
        link.get("name", "")
        for link in source.iter("link")
        for mesh in link.iterfind("visual/geometry/mesh")
        if posixpath.basename(mesh.get("filename", "").strip()) in names
    )


def _visuals(stated: Counter[str], built: Counter[str]) -> Iterator[Finding]:
    for link, expected in stated.items():
        if built[link] < expected:
            yield VISUAL(
                f"link {link}",
                f"the source states {expected} visual shapes, {built[link]} were built",
                _BUG,
                data={"source": expected, "built": built[link]},
            )


def _exchanged(shapes: Shapes, source: Element) -> Iterator[Finding]:
    """Pictures that the description's own materials name, link by link."""
    stated = _pictures(source)
    known = {stem for stems in stated.values() for stem in stems}
    textures = {m.name: m.texture for m in shapes.materials if m.texture}
    told: set[tuple[str, str]] = set()
    for shape in shapes.of("visual"):
        texture = textures.get(shape.material or "")
        stems = stated.get(shape.link)
        if texture is None or not stems or _names_of(texture) & stems:
            continue
        if _names_of(texture) & known and (shape.link, texture) not in told:
            told.add((shape.link, texture))
            yield EXCHANGED(
                f"material {shape.material}",
                f"`{shape.link}` shows `{texture}`, but its materials in the source name "
                f"{', '.join(f'`{stem}`' for stem in sorted(stems))}",
                hint="are two textures exchanged?",
                data={"link": shape.link},
            )


def _pictures(root: Element) -> dict[str, set[str]]:
    """Names of pictures, without folder and ending, by link."""
    named = {m.get("name"): m.find("texture") for m in root.findall("material")}
    found: dict[str, set[str]] = {}
    for link in root.findall("link"):
        for material in link.findall("visual/material"):
            texture = material.find("texture")
            texture = named.get(material.get("name")) if texture is None else texture
            file = texture.get("filename") if texture is not None else None
            if file:
                stem = _plain(PurePosixPath(file).stem)
                found.setdefault(str(link.get("name")), set()).add(stem)
    return found


def _names_of(texture: str) -> set[str]:
    """What a picture may be called in a source: `skin-3f2a91c0` is `skin` there, or itself."""
    stem = PurePosixPath(texture).stem
    return {_plain(stem), _plain(stem.rpartition("-")[0] or stem)}


def _plain(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]+", "_", stem)
