"""Is every shape of the source still there, and every texture? Counted, not compared.

The MJCF's reader of facts proves that the MJCF has the shapes of the robot; this check counts them
against the description itself, read by another parser, so that nothing can be lost before.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
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
TEXTURE = Rule(
    "count.texture", "error", "the MJCF does not show a texture", "report it: this is a bug"
)


class Counts(Check):
    """Findings `count.visual`, `count.collision`, `count.texture`; all are errors.

    A mesh of several materials becomes several shapes, and a collision method several pieces or
    one: so no link may have fewer visual shapes than the source states, or none where its rule
    asks for collision.
    """

    version = "3"
    tools = ("defusedxml",)
    needs = ("source", "mjcf")
    reads = ("shapes.json",)

    robot: str
    rules: tuple[tuple[str, str, str], ...] = ()
    """(pattern of links, method, from) of the recipe's collision rules, the default last."""
    written: bool = False
    """The source is a URDF that we wrote: a capsule, which URDF lacks, is three elements of it."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any]:  # Any: values of its fields
        """Knows which links shall have no collision."""
        links, default = (recipe.value(f"collision.{key}") for key in ("links", "default"))
        rules = [*links.items(), (".*", default)]
        return {
            "robot": recipe.value("robot"),
            "rules": tuple((pattern, rule.method, rule.from_) for pattern, rule in rules),
            "written": any(recipe.value(key) for key in ("source.mjcf", "edits", "compose")),
        }

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `source.urdf`, `shapes.json` and `mjcf/<robot>.xml`."""
        shapes = RobotFiles(files.inputs).shapes
        source = _root(files.inputs / "source.urdf")
        stated = {role: _stated(source, role) for role in ("visual", "collision")}
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
        mjcf = _root(files.inputs / "mjcf" / f"{self.robot}.xml")
        wanted, shown = _textures(shapes), _shown(mjcf, files.inputs / "mjcf/assets")
        for texture in sorted(wanted - shown):
            message = f"the texture `{texture}` is not shown by the MJCF"
            yield TEXTURE("robot", message, _BUG)
        write_figures(
            files,
            {
                **{f"{role}_source": stated[role].total() for role in stated},
                **{f"{role}_built": built[role].total() for role in built},
                "textures": len(wanted),
                "textures_mjcf": len(shown),
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


def _stated(robot: Element, role: Role) -> Counter[str]:
    """Elements of one role by link, as the description states them."""
    counts: Counter[str] = Counter()
    for link in robot.findall("link"):
        elements = link.findall(role)
        counts[str(link.get("name"))] += sum(not _shows_nothing(element) for element in elements)
    return counts


def _shows_nothing(element: Element) -> bool:
    """A point or a line: `read_urdf` tells it (`urdf.visual.nothing`), or refuses it."""
    shapes = element.findall("geometry/*")
    if len(shapes) != 1 or element.tag != "visual":
        return False
    edges = [float(edge) for edge in shapes[0].get("size", "").split()]
    radius = shapes[0].get("radius")
    return float(radius) == 0.0 if radius else edges.count(0.0) >= 2


def _visuals(stated: Counter[str], built: Counter[str]) -> Iterator[Finding]:
    for link, expected in stated.items():
        if built[link] < expected:
            yield VISUAL(
                f"link {link}",
                f"the source states {expected} visual shapes, {built[link]} were built",
                _BUG,
                data={"source": expected, "built": built[link]},
            )


def _textures(shapes: Shapes) -> set[str]:
    used = {shape.material for shape in shapes.of("visual")}
    return {m.texture for m in shapes.materials if m.texture and m.name in used}


def _shown(mjcf: Element, assets: Path) -> set[str]:
    """Textures whose file is there, by a material that a geom wears."""
    files = {t.get("name"): t.get("file") for t in mjcf.iterfind("asset/texture")}
    worn = set(_worn(mjcf))
    materials = mjcf.iterfind("asset/material")
    named = (files.get(m.get("texture")) for m in materials if m.get("name") in worn)
    return {file for file in named if file and (assets / file).is_file()}


def _worn(mjcf: Element) -> Iterator[str | None]:
    """The material of each geom, its own or that of its class."""
    looks: dict[str | None, str | None] = {}
    for default in mjcf.iterfind("default"):
        _learn(default, None, looks)
    bodies: list[tuple[Element, str | None]] = [(w, None) for w in mjcf.iterfind("worldbody")]
    while bodies:
        body, inherited = bodies.pop()
        kind = body.get("childclass", inherited)
        for geom in body.iterfind("geom"):
            yield geom.get("material") or looks.get(geom.get("class", kind))
        bodies += [(child, kind) for tag in ("body", "frame") for child in body.iterfind(tag)]


def _learn(default: Element, inherited: str | None, looks: dict[str | None, str | None]) -> None:
    """The material that geoms of this class and of those below it wear."""
    geom = default.find("geom")
    material = inherited if geom is None else geom.get("material", inherited)
    looks[default.get("class")] = material
    for child in default.iterfind("default"):
        _learn(child, material, looks)
