"""Which names of a composite a pattern speaks of.

A pattern of a part is matched on the part's own names; those that it matches get the prefix.
A pattern of the base speaks of the names of the base that it matches, and of a part's name where it
can mean that part alone: it matches the name with its prefix, and would not match it with any other
prefix. Of a part `arm_` with a joint `lift` these speak:

    arm_.*    wheel|arm_lift    (arm|leg)_lift    (?i)ARM_LIFT

and these do not, for they fit any part: `.*`, `.*_lift`, `[a-z]+_lift`. A pattern that would match
with some other prefixes and not with all, such as `[a-m]+_lift`, is an error: nobody could predict
what it does.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Literal, TypeVar

from assetbuild.compose.compose_parts import PLATE
from assetbuild.control.plan import own_side
from assetbuild.errors import RecipeError, meant_pattern
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Part, Recipe
from assetbuild.recipe.validation import Key
from assetbuild.recipe_types import listed
from assetbuild.robot.files import SourceControl
from assetbuild.robot.model import Tree
from assetbuild.robot.sides import Side

Value = TypeVar("Value")
Kind = Literal["links", "joints"]
HOME = "home"
OTHER_LETTERS = "jqxz"
"""What the other prefixes are written with that a pattern of the base is tried on."""
_WORDS: Mapping[Kind, str] = {"links": "link of the source", "joints": "moving joint"}


@dataclass(frozen=True)
class Member:
    """The base or a part of a composite: its own recipe, and its tree in its own names.

    source_control: of its MJCF, if it is one. part, row: of the parts, their rows of `compose` and
    the keys of these. reach: of the base, the parts, of which its patterns may speak.
    """

    loaded: LoadedRecipe
    tree: Tree
    source_control: SourceControl | None = None
    part: Part | None = None
    row: Key = ()
    reach: tuple[Member, ...] = ()

    @property
    def recipe(self) -> Recipe:
        """What it says of itself."""
        return self.loaded.recipe

    @property
    def prefix(self) -> str:
        """Prefix of all its names in the whole."""
        return self.part.as_ if self.part else ""

    @property
    def side(self) -> Side:
        """Who decides what in it."""
        return own_side(self.recipe, self.prefix)

    @cached_property
    def names(self) -> dict[Kind, tuple[str, ...]]:
        """Its own: of bodies with the plate that holds it, and of joints that move."""
        plate = [PLATE] if self.part and self.part.mount else []
        joints = tuple(joint.name for joint in self.tree.moving_joints)
        return {"links": (*self.tree.by_body, *plate), "joints": joints}

    @cached_property
    def poses(self) -> dict[str, dict[str, float]]:
        """Values of the joints that mimic no other in each keyframe of its source, rad or m."""
        free = {joint.name for joint in self.tree.moving_joints if joint.mimic is None}
        keys = self.source_control.control.keyframes if self.source_control else ()
        return {key.name: {n: q for n, q in key.joints if n in free} for key in keys}

    def pose_key(self, name: str) -> tuple[str, bool] | None:
        """Its keyframe for one of the whole, and whether the source says it; None without any.

        The one of the same name, else its `home`; its recipe's before its source's.
        """
        for key in (name, HOME):
            if key in self.recipe.keyframes:
                return key, False
            if key in self.poses:
                return key, True
        return None


@dataclass(frozen=True)
class Row(Generic[Value]):
    """A row of a table of the whole. names: that it speaks of; whose, key: where it is written."""

    value: Value
    whose: LoadedRecipe
    key: Key
    names: tuple[str, ...] = ()

    @property
    def pattern(self) -> str:
        """A pattern that matches its names and no others."""
        return listed(self.names)

    def without(self, taken: Collection[str]) -> Row[Value]:
        """The row without the names that are taken."""
        return replace(self, names=tuple(name for name in self.names if name not in taken))


def rows_of(
    member: Member, key: Key, table: Mapping[str, Value], kind: Kind = "links"
) -> Iterator[Row[Value]]:
    """The rows of a table by pattern, which stands at `key` of a recipe; errors as `spoken_of`."""
    for pattern, value in table.items():
        names = spoken_of(member, (*key, pattern), pattern, kind)
        yield Row(value, member.loaded, (*key, pattern), names)


def spoken_of(member: Member, key: Key, pattern: str, kind: Kind = "links") -> tuple[str, ...]:
    """Names of the whole that a pattern at `key` of a recipe speaks of.

    RecipeError: it speaks of nothing, or nobody can tell whether it means a part.
    """
    local_names = member.names[kind]
    matches = [member.prefix + name for name in local_names if re.fullmatch(pattern, name)]
    for part in member.reach:
        names = [name for name in part.names[kind] if re.fullmatch(pattern, part.prefix + name)]
        matches += [part.prefix + n for n in names if _means(member, key, pattern, part, n)]
    if not matches:
        raise _idle(member, key, pattern, kind)
    return tuple(matches)


def _means(base: Member, key: Key, pattern: str, part: Member, name: str) -> bool:
    """Whether a pattern that matches a name of a part means this part alone."""
    others = _other_prefixes(part, [*base.names["links"], *base.names["joints"]], base.reach)
    fits = [other + name for other in others if re.fullmatch(pattern, other + name)]
    if fits and len(fits) < len(others):
        message = f"`{pattern}` matches `{part.prefix}{name}`, and would match `{fits[0]}`"
        hint = f"write the prefix `{part.prefix}` out if the part is meant"
        raise base.loaded.error(key, message, hint)
    return not fits and bool(others)


def _other_prefixes(part: Member, base: Iterable[str], parts: Iterable[Member]) -> list[str]:
    """Prefixes of the same shape that begin no name of the composite."""
    known = [*base, *(each.prefix for each in parts)]
    upper = [re.sub("[A-Z]", letter.upper(), part.prefix) for letter in OTHER_LETTERS]
    made = [re.sub("[a-z]", c, text) for c, text in zip(OTHER_LETTERS, upper, strict=True)]
    return [prefix for prefix in made if not any(name.startswith(prefix) for name in known)]


def _idle(member: Member, key: Key, pattern: str, kind: Kind) -> RecipeError:
    fixed = [joint.name for joint in member.tree.joints if joint.name not in member.names[kind]]
    if kind == "joints" and any(re.fullmatch(pattern, name) for name in fixed):
        return member.loaded.error(key, f"`{pattern}` matches only joints that do not move")
    known = [*member.names[kind], *(p.prefix + n for p in member.reach for n in p.names[kind])]
    hint = meant_pattern(pattern, known)
    if any(re.fullmatch(pattern, name) for name in known):
        hint = "write the prefix of a part out if it is meant"
    what = "joint of the part" if key[0] == "compose" else _WORDS[kind]
    return member.loaded.error(key, f"pattern `{pattern}` matches no {what}", hint)
