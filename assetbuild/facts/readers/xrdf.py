"""The reader of facts of `xrdf/<robot>.xrdf`: which joints a planner moves, and how fast; which
links it lets collide."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.facts.derived import first_match, start_of
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.facts.reader import Reader, all_but
from assetbuild.facts.reference import Reference, filtered_pairs
from assetbuild.facts.table import Table, pair_name

LIMITS = ("acceleration", "jerk")


class Xrdf(Reader):
    """All facts are words of the format (`xrdf:acceleration`), of joints."""

    needs: ClassVar = ("xrdf",)
    format_id: ClassVar[str] = "xrdf"
    display_name: ClassVar[str] = "the XRDF"
    folder: ClassVar[str] = "xrdf"
    file_globs: ClassVar[tuple[str, ...]] = ("xrdf/{robot}.xrdf",)
    lacks: ClassVar[Mapping[str, str]] = all_but((), "stands in the URDF beside")
    recipe_sections: ClassVar[tuple[str, ...]] = ("xrdf",)

    def read(self, path: Path) -> Table:
        """Places in the configuration space, limits and default positions, rad or m and s."""
        xrdf, facts = read_yaml(path), Table()
        names = xrdf["cspace"]["joint_names"]
        for place, name in enumerate(names):
            facts.put("joint", name, {"xrdf:place": float(place)})
        for word in LIMITS:
            for name, limit in zip(names, xrdf["cspace"].get(f"{word}_limits", ()), strict=False):
                facts.put("joint", name, {f"xrdf:{word}": limit})
        for name, position in xrdf["default_joint_positions"].items():
            facts.put("joint", name, {"xrdf:default": position})
        for one, others in xrdf.get("self_collision", {}).get("ignore", {}).items():
            for other in others:
                facts.put("pair", pair_name(one, other), {"xrdf:ignored": True})
        return facts.plain()

    def expected(self, reference: Reference) -> Table:
        """Expect what the section `xrdf` says; a joint that follows another has no place."""
        options, facts = reference.options.get("xrdf") or {}, Table()
        pose = dict(start_of(reference.tree, reference.control).joints)
        leading = [joint.name for joint in reference.tree.moving_joints if joint.mimic is None]
        driven = {row.joint for row in reference.control.actuators if row.model != "passive"}
        pattern = options.get("joints", ".*")
        planned = [name for name in leading if name in driven and re.fullmatch(pattern, name)]
        for name in leading:
            facts.put("joint", name, {"xrdf:default": pose[name]})
        for place, name in enumerate(planned):
            facts.put("joint", name, {"xrdf:place": float(place)})
        for word in LIMITS:
            asked = options.get(word)
            table = asked if isinstance(asked, Mapping) else {".*": asked}
            stated = {name: first_match(table, name) for name in planned}
            limits = {name: float(limit) for name, limit in stated.items() if limit is not None}
            for name, limit in limits.items() if len(limits) == len(planned) else ():
                facts.put("joint", name, {f"xrdf:{word}": limit})
        tree, shapes = reference.tree, reference.shapes
        filtered = {frozenset(pair) for pair in filtered_pairs(tree, shapes, reference.control)}
        links = dict.fromkeys(shape.link for shape in shapes.of("collision"))
        for pair in itertools.combinations(links, 2):
            bodies = frozenset(tree.placement(link)[0] for link in pair)
            if len(bodies) == 1 or bodies in filtered:
                facts.put("pair", pair_name(*pair), {"xrdf:ignored": True})
        return facts
