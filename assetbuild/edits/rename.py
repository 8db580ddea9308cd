"""`rename: {links: {pattern: replacement}, joints: {...}}`: other names, none of them twice."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field, model_validator

from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.findings import Rule
from assetbuild.plugin_types import Edit, Edited
from assetbuild.recipe_types import Pattern
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import SourceShapes

RENAMED = Rule(
    "edit.rename",
    "info",
    "a link or joint has another name",
    "use the new name in the rest of the recipe",
)


class Rename(Edit):
    """The first pattern that matches a whole name renames it; `\\1` stands for a group.

    What comes later in the recipe (edits, collision, actuators, ...) uses the new names.
    """

    follows_names: ClassVar[bool] = False

    links: dict[Pattern, str] = Field(default_factory=dict, description="pattern -> replacement")
    joints: dict[Pattern, str] = Field(default_factory=dict, description="pattern -> replacement")

    @model_validator(mode="after")
    def _some(self) -> Rename:
        if not self.links and not self.joints:
            raise ValueError("give `links` or `joints`")
        return self

    def patterns(self) -> tuple[tuple[tuple[str, ...], str, str], ...]:
        """See `Edit`."""
        links = [(("links", pattern), "link", pattern) for pattern in self.links]
        return (*links, *((("joints", pattern), "joint", pattern) for pattern in self.joints))

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        link = _new_names("link", (body.name for body in tree.bodies), self.links)
        joint = _new_names("joint", (j.name for j in tree.joints), self.joints)
        bodies = tuple(replace(body, name=link[body.name]) for body in tree.bodies)
        joints = tuple(
            replace(
                j,
                name=joint[j.name],
                parent=link[j.parent],
                child=link[j.child],
                mimic=replace(j.mimic, joint=joint[j.mimic.joint]) if j.mimic else None,
            )
            for j in tree.joints
        )
        moved = tuple(replace(shape, link=link[shape.link]) for shape in shapes.shapes)
        findings = [RENAMED(f"{kind} {new}", f"{kind} `{old}` is called `{new}`",
                            data={"before": old, "after": new})
                    for kind, names in (("link", link), ("joint", joint))
                    for old, new in names.items() if old != new]  # fmt: skip
        renamed = replace(tree, bodies=bodies, joints=joints)
        return Edited(renamed, replace(shapes, shapes=moved), tuple(findings))


def _new_names(kind: str, names: Iterable[str], rules: Mapping[str, str]) -> dict[str, str]:
    """Old name -> new name of all, in order."""
    new: dict[str, str] = {}
    taken: dict[str, str] = {}
    for name in names:
        new[name] = _new_name(kind, name, rules)
        other = taken.setdefault(new[name], name)
        if other != name:
            raise RecipeError(
                f"rename: the {kind}s `{other}` and `{name}` would both be called `{new[name]}`",
                hint="a narrower pattern, or a group of it in the replacement, such as `\\1`",
            )
    return new


def _new_name(kind: str, name: str, rules: Mapping[str, str]) -> str:
    for pattern, replacement in rules.items():
        match = re.fullmatch(pattern, name)
        if match is None:
            continue
        try:
            new = match.expand(replacement)
        except (re.error, IndexError) as error:
            raise RecipeError(f"rename: `{replacement}` for {kind} `{name}`: {error}") from None
        if not new.strip():
            raise RecipeError(f"rename: the {kind} `{name}` would have no name")
        return new
    return name
