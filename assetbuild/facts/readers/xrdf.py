"""The reader of facts of `xrdf/<robot>.xrdf`: what a planner knows beyond the URDF.

Links are those of the URDF, unmerged. Which of them are covered by how many spheres is compared
with the robot; where these lie is what `validate` writes again.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.facts.derived import first_match, start_of
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, filtered_pairs
from assetbuild.facts.table import Table, Value, Writer, pair_name
from assetbuild.facts.vocabulary import VOCABULARY

BALLS, SOME = "xrdf:spheres", "as many as it may have"
DEFAULTS: Mapping[str, Any] = {  # Any: plain JSON, here and below
    "joints": ".*", "acceleration": None, "jerk": None, "tool_frames": [], "max_spheres": 32,
}  # fmt: skip
"""Defaults of the recipe's `xrdf`, for a bundle that does not state them."""
LIMITS = ("acceleration", "jerk")
GEOMETRIES, GROUP = ("collision", "self_collision"), "collision_spheres"


class Xrdf(Reader):
    """All facts are words of the format (`xrdf:acceleration`), of joints, links, spheres, pairs."""

    needs: ClassVar = ("xrdf",)
    form: ClassVar[str] = "xrdf"
    called: ClassVar[str] = "the XRDF"
    folder: ClassVar[str] = "xrdf"
    behind: ClassVar[tuple[str, ...]] = ("xrdf/{robot}.xrdf",)
    lacks: ClassVar[Mapping[str, str]] = {
        kind: "stands in the URDF beside" for kind, _ in VOCABULARY
    }
    asks: ClassVar[tuple[str, ...]] = ("xrdf",)

    def file(self, root: Path, robot: str) -> Path | None:
        """`<robot>.xrdf`."""
        return root / f"{robot}.xrdf"

    def found(self, path: Path, reference: Reference) -> Table:
        """Where a link has no more spheres than it may, their number is no matter."""
        table, solid = self.read(path), _solid(reference)
        most = _said(reference)["max_spheres"]
        within = {
            key: SOME
            for key, number in table.facts.items()
            if key.quantity == BALLS and 0.0 < float(str(number)) <= max(most, solid[key.name])
        }
        return table | Table(within)

    def read(self, path: Path) -> Table:
        """Joints, limits, spheres and pairs; UsageError for what is no YAML."""
        said, book = read_yaml(path), Writer()
        words = {f"xrdf:{word}": said.get(word) for word in ("format", "format_version")}
        words["xrdf:tool_frames"] = said.get("tool_frames")
        words |= {f"xrdf:{name}": said.get(name, {}).get("geometry") for name in GEOMETRIES}
        book.put("planner", "", words)
        cspace = said.get("cspace", {})
        names = cspace.get("joint_names", [])
        for place, name in enumerate(names):
            book.put("joint", name, {"xrdf:place": float(place)})
        for word in LIMITS:
            for name, limit in zip(names, cspace.get(f"{word}_limits", ()), strict=False):
                book.put("joint", name, {f"xrdf:{word}": limit})
        for name, position in said.get("default_joint_positions", {}).items():
            book.put("joint", name, {"xrdf:default": position})
        for link, balls in said.get("geometry", {}).get(GROUP, {}).get("spheres", {}).items():
            real = [ball for ball in balls if ball["radius"] > 0.0 and len(ball["center"]) == 3]
            book.put("link", link, {BALLS: float(len(real))})
        for one, others in said.get("self_collision", {}).get("ignore", {}).items():
            for other in others:
                book.put("pair", pair_name(one, other), {"xrdf:ignored": True})
        return book.plain_table()

    def expected(self, reference: Reference) -> Table:
        """From the section `xrdf` of the recipe, and the robot."""
        said, solid, book = _said(reference), _solid(reference), Writer()
        words: dict[str, Value] = {"xrdf:format": "xrdf", "xrdf:format_version": 1.0}
        words["xrdf:tool_frames"] = tuple(said["tool_frames"]) or None
        words |= {f"xrdf:{name}": GROUP if solid else None for name in GEOMETRIES}
        book.put("planner", "", words)
        for name, facts in _joints(reference, said):
            book.put("joint", name, facts)
        for link in solid:
            book.put("link", link, {BALLS: SOME})
        pairs = filtered_pairs(reference.tree, reference.shapes, reference.control, of_links=True)
        for one, other in pairs:
            book.put("pair", pair_name(one, other), {"xrdf:ignored": True})
        return book.table()


def _said(reference: Reference) -> dict[str, Any]:
    return {**DEFAULTS, **(reference.options.get("xrdf") or {})}


def _solid(reference: Reference) -> Counter[str]:
    """Number of collision shapes by link."""
    return Counter(shape.link for shape in reference.shapes.of("collision"))


def _joints(
    reference: Reference, said: Mapping[str, Any]
) -> Iterator[tuple[str, dict[str, Value]]]:
    """Places in the cspace, limits, default positions; a joint that follows another has none."""
    leading = [joint.name for joint in reference.tree.moving_joints if joint.mimic is None]
    pose = dict(start_of(reference.tree, reference.control).joints)
    driven = {row.joint for row in reference.control.actuators if row.model != "passive"}
    planned = [name for name in leading if name in driven and re.fullmatch(said["joints"], name)]
    for name in leading:
        yield name, {"xrdf:default": pose[name]}
    for place, name in enumerate(planned):
        yield name, {"xrdf:place": float(place)}
    for word in LIMITS:
        table = said[word] if isinstance(said[word], Mapping) else {".*": said[word]}
        limits = [first_match(table, name) for name in planned]
        numbers = [float(limit) for limit in limits if limit is not None]
        if len(numbers) == len(planned):
            for name, number in zip(planned, numbers, strict=True):
                yield name, {f"xrdf:{word}": number}
