"""Is the whole source still there: every link, joint, number and shape?

The readers of facts prove that our files are the robot; this check holds the robot against the
description itself, read by another parser than the build's, so that nothing can be lost before.
"""

from __future__ import annotations

import posixpath
import re
from collections import Counter
from collections.abc import Generator, Iterator
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.facts.compare import Precision, differences, equality_findings
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table, Value
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Check, RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import MOVING, Tree

Place = tuple[str, str]
"""Role of a shape, and its link."""

VISUAL = Rule(
    "count.visual",
    "error",
    "a link has fewer visual shapes than the source states",
    "a bug: report it with the source",
)
COLLISION = Rule(
    "count.collision",
    "error",
    "a link has no collision shape though its rule asks for one",
    "a bug: report it with the source",
)


class Counts(Check):
    """Findings `equal.source_urdf.*`, `count.visual`, `count.collision`: errors.

    Links and joints of a source that no edit changed are the robot's, number by number. A mesh of
    several materials becomes several shapes, and a collision method several pieces or
    one: so no link may have fewer visual shapes than the source states, or none where its rule
    asks for collision.
    """

    shares = True
    isolated: ClassVar = True
    needs: ClassVar = ("source",)
    reads: ClassVar = ("links.json", "shapes.json")

    robot: str
    rules: tuple[tuple[str, str, str], ...] = ()
    """(pattern of links, method, from) of the recipe's collision rules, the default last."""
    absent: tuple[str, ...] = ()
    """Visual meshes that the source lacks, below its root."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """None where the description is one that we wrote: of an MJCF, with edits, of parts."""
        if any(recipe.value(key) for key in ("source.mjcf", "edits", "compose")):
            return None
        links, default = (recipe.value(f"collision.{key}") for key in ("links", "default"))
        rules = [*links.items(), (".*", default)]
        return {
            "robot": recipe.value("robot"),
            "rules": tuple((pattern, rule.method, rule.from_) for pattern, rule in rules),
            "absent": tuple(recipe.value("source.missing.visuals")),
        }

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `source.urdf`, `links.json` and `shapes.json`."""
        robot = RobotFiles(files.inputs)
        source = UrdfFacts(robot=self.robot).read(files.inputs / "source.urdf")
        compared = yield from _equal(source, robot.links)
        stated = Counter(self._stated(source))
        built: Counter[Place] = Counter((s.role, s.link) for s in robot.shapes.shapes)
        figures: dict[str, object] = {"facts": compared}
        for role in ("visual", "collision"):
            figures[f"{role}_source"] = sum(n for (kind, _), n in stated.items() if kind == role)
            figures[f"{role}_built"] = len(robot.shapes.of(role))
        write_figures(files, figures)
        for link in dict.fromkeys(link for _, link in stated):
            yield from self._lost(link, stated, built)

    def _stated(self, source: Table) -> Iterator[Place]:
        """The shapes of the description but for those that `read_urdf` leaves out and reports."""
        absent = {posixpath.basename(mesh) for mesh in self.absent}
        for name in source.names("shape"):
            facts = source.of("shape", name)
            role, mesh = str(facts["role"]), str(facts.get("urdf:missing mesh"))
            is_absent = role == "visual" and posixpath.basename(mesh) in absent
            if "geometry" in facts and not is_absent:
                yield role, str(facts["body"])

    def _lost(self, link: str, stated: Counter[Place], built: Counter[Place]) -> Iterator[Finding]:
        expected, actual = stated["visual", link], built["visual", link]
        if actual < expected:
            yield VISUAL(
                f"link {link}",
                f"the source states {expected} visual shapes, {actual} were built",
                data={"source": expected, "built": actual},
            )
        rules = (*self.rules, (".*", "auto", "auto"))
        method, from_ = next((m, f) for pattern, m, f in rules if re.fullmatch(pattern, link))
        roles = ("collision", "visual") if from_ == "auto" else (from_,)
        expected = next((n for role in roles if (n := stated[role, link])), 0)
        if method != "none" and expected and not built["collision", link]:
            yield COLLISION(
                f"link {link}",
                f"the source states {expected} shapes for collision, and none was built",
                data={"source": expected, "built": 0},
            )


def _equal(source: Table, links: Tree) -> Generator[Finding, None, int]:
    """Bodies and joints of the source against the robot's links; how many facts there are."""

    def is_compared(key: Key) -> bool:
        return key.kind in ("body", "joint") and UrdfFacts.holds(key) and not key.is_foreign

    robot = robot_table(Reference(links, links), merged=False)
    expected, stated = robot.only(is_compared), _with_held(source, links).only(is_compared)
    different = differences(expected, stated, Precision())
    yield from equality_findings(different, "source_urdf", "the source", source.places)
    return len({*expected.facts, *stated.facts})


def _with_held(source: Table, links: Tree) -> Table:
    """The source as it moves: what mimics a fixed joint, or by a multiplier of 0, stays there."""
    facts = Table()
    for joint in links.joints:
        stated = source.of("joint", joint.name)
        slope, offset = (stated.get(f"mimic {word}") for word in ("multiplier", "offset"))
        if joint.mimic is None and isinstance(slope, float) and isinstance(offset, float):
            leader = links.by_joint.get(str(stated["mimics"]))
            held = leader.limits.lower if leader and leader.kind in MOVING else 0.0
            at = offset + slope * (held or 0.0)
            free: dict[str, Value] = {"mimics": "", "mimic multiplier": None, "mimic offset": None}
            facts.put("joint", joint.name, free | {"lower": at, "upper": at})
    return source | facts
