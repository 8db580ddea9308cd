"""Composites of robots that are no more than names, with recipes that know their lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from assetbuild.compose.names import Member
from assetbuild.engine.world import World
from assetbuild.errors import RecipeError
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.recipe.validation import validated
from assetbuild.recipe.yaml_tree import parse
from assetbuild.robot.files import SourceControl
from assetbuild.robot.model import Body, Control, Joint, Keyframe, Tree


@dataclass(frozen=True)
class Named:
    """A robot by its names. tables: of its recipe; row: of a part, more of its row in `compose`.

    A link beyond those of the moving joints is fixed to the root; poses: keyframes of its MJCF.
    """

    joints: Sequence[str]
    links: Sequence[str]
    tables: Mapping[str, Any] = field(default_factory=dict)
    row: Mapping[str, Any] = field(default_factory=dict)
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def tree(self) -> Tree:
        """All links on the root, the first on the moving joints."""
        fixed = [f"{link}_fixed" for link in self.links[1 + len(self.joints) :]]
        kinds = ["revolute"] * len(self.joints) + ["fixed"] * len(fixed)
        rows = zip([*self.joints, *fixed], kinds, self.links[1:], strict=True)
        joints = tuple(Joint(name, kind, self.links[0], child) for name, kind, child in rows)
        return Tree("r", "floating", tuple(Body(link) for link in self.links), joints)

    def said(self) -> SourceControl | None:
        """Its keyframes, as an MJCF says them."""
        keys = tuple(Keyframe(name, tuple(pose.items())) for name, pose in self.poses.items())
        return SourceControl(Control(keyframes=keys)) if keys else None


def loaded(file: str, tables: Mapping[str, Any]) -> LoadedRecipe:
    """A recipe as if it had been read from a file: a key a line."""
    head = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    text = yaml.safe_dump({**head, **tables}, sort_keys=False, default_flow_style=False)
    root = parse(text.encode(), file, RecipeError)
    return LoadedRecipe(validated(Recipe, root, RecipeError), Path(file), file, None, root, World())


def members(base: Named, **parts: Named) -> list[Member]:
    """The base, `base.yaml`, and the parts by prefix, `<prefix>.yaml`, on its root."""
    rows = [
        {"recipe": f"{prefix}.yaml", "as": prefix, "at": {"link": base.links[0]}, **part.row}
        for prefix, part in parts.items()
    ]
    whole = loaded("base.yaml", {**base.tables, "compose": rows})
    made = []
    for index, (prefix, part) in enumerate(parts.items()):
        own, row = loaded(f"{prefix}.yaml", part.tables), whole.recipe.compose[index]
        made.append(Member(own, part.tree(), part.said(), row, ("compose", index)))
    first = Member(whole, base.tree(), base.said())
    return [replace(first, reach=tuple(made)), *made]
