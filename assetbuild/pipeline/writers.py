"""The steps that wrote a bundle, as its own `report/robot.json` asks for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from assetbuild.control.keep import KeepRatings
from assetbuild.engine.code import Code
from assetbuild.engine.step import Step
from assetbuild.facts.again.written import code_digest
from assetbuild.facts.reference import Reference
from assetbuild.geometry.measure_assets import ReadMeshes
from assetbuild.plugin_types import Target
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.recipe.models import Recipe
from assetbuild.samples.state_ranges import StateRanges

RANGES = "dr"
"""The name of what writes `dr.yaml` in the bundle; recipes ask for it by `randomize`."""


def patterns(recipe: Recipe) -> dict[str, list[str]]:
    """The rows of the actuator table, whose patterns some modules repeat; none of a composite."""
    rows = () if recipe.compose else recipe.actuators
    return {"actuators": [row.joints for row in rows]}


def code_of_writers(kinds: Mapping[str, type[Step]], code: Code) -> dict[str, str]:
    """A digest for each writer; some read ratings and triangles, which are made on the way."""
    made = {**code.of(KeepRatings).modules, **code.of(ReadMeshes).modules}
    digests = {}
    for name, kind in kinds.items():
        before = getattr(kind, "preparation", None)
        own = {**code.of(kind).modules, **(code.of(before).modules if before else {})}
        digests[name] = code_digest({**made, **own})
    return digests


def writer_kinds(names: Iterable[str]) -> dict[str, type[Target]]:
    """The steps of these names, as far as they are installed."""
    known = plugin_names(Target)
    kinds: dict[str, type[Target]] = {n: load_plugin(Target, n) for n in names if n in known}
    return kinds | ({RANGES: StateRanges} if RANGES in names else {})


@dataclass(frozen=True)
class StatedRecipe:
    """What a bundle says of its recipe, for targets to ask as they ask a recipe."""

    robot: str
    targets: tuple[str, ...]
    reference: Reference

    def value(self, path: str) -> Any:  # Any: plain JSON
        """The value at a path such as `feet.links`, None below what is null. KeyError."""
        options = self.reference.options
        if path == "actuators":
            return [SimpleNamespace(joints=pattern) for pattern in options[path]]
        if path in ("robot", "targets", "compose"):
            # The rows of a composite are not kept, so that nothing need be known of its parts.
            return {"robot": self.robot, "targets": self.targets, "compose": ()}[path]
        if path in options:
            return options[path]
        above, _, key = path.rpartition(".")
        section = self.value(above) if above else options
        return None if section is None else section[key]

    def states(self, key: str) -> bool:
        """Whether the recipe states a key at its top; defaults are stated here too."""
        return key in self.reference.options

    def stated(self, path: str) -> frozenset[str]:
        """The keys of a section."""
        section = self.value(path)
        return frozenset(section) if isinstance(section, dict) else frozenset()
