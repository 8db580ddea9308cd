"""The tables of a composite: the base's own, then those of each part under its prefix.

A part's patterns are anchored to its prefix. A pattern of the base speaks of the base alone,
unless it begins with a part's prefix: then it speaks of that part, and wins over the part's own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from assetbuild.recipe.actuators import ActuatorRow, Motor
from assetbuild.recipe.collision import CollisionRule
from assetbuild.recipe.compose import Part
from assetbuild.recipe.models import Keyframe, Recipe
from assetbuild.recipe.surface import Contact, Surface

Value = TypeVar("Value")
HOME = "home"


@dataclass(frozen=True)
class Mounted:
    """A part with its own recipe. links, joints: its names with the prefix."""

    part: Part
    recipe: Recipe
    links: tuple[str, ...]
    joints: tuple[str, ...]

    @property
    def prefix(self) -> str:
        """Of all its names."""
        return self.part.as_


def composed(recipe: Recipe, parts: Sequence[Mounted]) -> Recipe:
    """The recipe of the whole, whose patterns are about the names with prefixes."""
    prefixes = tuple(mounted.prefix for mounted in parts)
    collision = recipe.collision.model_copy(
        update={
            "links": _links(recipe, parts, prefixes),
            "exclude": recipe.collision.exclude.model_copy(update={"pairs": _pairs(recipe, parts)}),
        }
    )
    fixed = recipe.fixed_joints.model_copy(
        update={
            "keep_bodies": (
                *(_own(pattern, prefixes) for pattern in recipe.fixed_joints.keep_bodies),
                *(
                    anchored(mounted.prefix, pattern)
                    for mounted in parts
                    for pattern in mounted.recipe.fixed_joints.keep_bodies
                ),
            )
        }
    )
    return recipe.model_copy(
        update={
            "collision": collision,
            "fixed_joints": fixed,
            "motors": _motors(recipe, parts),
            "actuators": _actuators(recipe, parts, prefixes),
            "keyframes": _keyframes(recipe, parts, prefixes),
            "contact": _contact(recipe, parts, prefixes),
            "sensors": _prefixed_places(recipe.sensors, parts, "sensors", ("link", "joint")),
            "cameras": _prefixed_places(recipe.cameras, parts, "cameras", ("link",)),
            "edits": (),
        }
    )


def anchored(prefix: str, pattern: str, but: Iterable[str] = ()) -> str:
    """A part's pattern about the names with its prefix; `but`: patterns that win over it."""
    return f"{_not(but)}{re.escape(prefix)}(?:{pattern})"


def _not(patterns: Iterable[str]) -> str:
    listed = "|".join(f"(?:{pattern})" for pattern in patterns)
    return rf"(?!(?:{listed})\Z)" if listed else ""


def _own(pattern: str, prefixes: Sequence[str]) -> str:
    """A pattern of the base: about the base alone, unless it names a part's prefix itself."""
    if _about_part(pattern, prefixes):
        return pattern
    return f"(?!{'|'.join(map(re.escape, prefixes))})(?:{pattern})"


def _about_part(pattern: str, prefixes: Sequence[str]) -> bool:
    return pattern.startswith(tuple(prefixes))


def _split(
    table: Mapping[str, Value], prefixes: Sequence[str]
) -> tuple[dict[str, Value], dict[str, Value]]:
    """What the base's table says of parts, and what it says of the base, anchored."""
    about = {k: v for k, v in table.items() if _about_part(k, prefixes)}
    return about, {_own(k, prefixes): v for k, v in table.items() if k not in about}


def _links(
    recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]
) -> dict[str, CollisionRule]:
    about, own = _split(recipe.collision.links, prefixes)
    links = {**about, **own}
    for mounted in parts:
        collision = mounted.recipe.collision
        for pattern, rule in collision.links.items():
            links[anchored(mounted.prefix, pattern)] = _under(rule, collision.preset)
        links[anchored(mounted.prefix, ".*")] = _under(collision.default, collision.preset)
    return links


def _under(rule: CollisionRule, preset: str) -> CollisionRule:
    """The rule with its recipe's preset, which the whole may not share."""
    return rule if rule.preset is not None else rule.model_copy(update={"preset": preset})


def _pairs(recipe: Recipe, parts: Sequence[Mounted]) -> tuple[tuple[str, str], ...]:
    pairs = list(recipe.collision.exclude.pairs)
    for mounted in parts:
        prefix, own = mounted.prefix, mounted.recipe.collision.exclude.pairs
        pairs += [(prefix + a, prefix + b) for a, b in own]
        pairs += [(link, other) for link in mounted.part.exclude for other in mounted.links]
    return tuple(dict.fromkeys(pairs))


def _motors(recipe: Recipe, parts: Sequence[Mounted]) -> dict[str, Motor]:
    motors = dict(recipe.motors)
    for mounted in parts:
        for name, motor in mounted.recipe.motors.items():
            extends = mounted.prefix + motor.extends if motor.extends else None
            motors.setdefault(mounted.prefix + name, motor.model_copy(update={"extends": extends}))
    return motors


def _actuators(
    recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]
) -> tuple[ActuatorRow, ...]:
    rows = [
        row.model_copy(update={"joints": _own(row.joints, prefixes)}) for row in recipe.actuators
    ]
    about = [row.joints for row in recipe.actuators if _about_part(row.joints, prefixes)]
    for mounted in parts:
        for row in mounted.recipe.actuators:
            pattern = anchored(mounted.prefix, row.joints, about)
            if not any(re.fullmatch(pattern, joint) for joint in mounted.joints):
                continue  # the base's own rows have taken all of its joints
            motor = mounted.prefix + row.motor if row.motor else None
            rows.append(row.model_copy(update={"joints": pattern, "motor": motor}))
    return tuple(rows)


def _keyframes(
    recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]
) -> dict[str, Keyframe]:
    keyframes = {}
    for name, keyframe in recipe.keyframes.items():
        about, joints = _split(keyframe.joints, prefixes)
        joints |= about
        for mounted in parts:
            joints |= _part_pose(mounted, name, tuple(about))
        keyframes[name] = keyframe.model_copy(update={"joints": joints})
    return keyframes


def _part_pose(mounted: Mounted, name: str, but: Sequence[str]) -> dict[str, float]:
    """The part's joints in a keyframe: by `home`, else as its own keyframe of that name or home."""
    own = mounted.recipe.keyframes.get(name) or mounted.recipe.keyframes.get(HOME)
    pose = dict(own.joints) if own else {}
    if name == HOME and mounted.part.home:
        first = tuple(mounted.part.home)
        pose = {f"{_not(first)}(?:{k})": v for k, v in pose.items()} | dict(mounted.part.home)
    found = {anchored(mounted.prefix, pattern, but): value for pattern, value in pose.items()}
    return {
        pattern: value
        for pattern, value in found.items()
        if any(re.fullmatch(pattern, joint) for joint in mounted.joints)
    }


def _contact(recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]) -> Contact:
    about, own = _split(recipe.contact.links, prefixes)
    links = {**about, **own}
    for mounted in parts:
        contact = mounted.recipe.contact
        whole = Surface(**{key: getattr(contact, key) for key in Surface.model_fields})
        for pattern, surface in contact.links.items():
            said = surface.model_dump(exclude_none=True)
            links[anchored(mounted.prefix, pattern)] = whole.model_copy(update=said)
        if whole != Surface(**{key: getattr(recipe.contact, key) for key in Surface.model_fields}):
            links[anchored(mounted.prefix, ".*")] = whole
    return recipe.contact.model_copy(update={"links": links})


def _prefixed_places(
    own: Mapping[str, Value], parts: Sequence[Mounted], table: str, places: tuple[str, ...]
) -> dict[str, Value]:
    """Sensors or cameras of all, each at the link or joint with the prefix."""
    found = dict(own)
    for mounted in parts:
        for name, entry in getattr(mounted.recipe, table).items():
            moved = {
                key: mounted.prefix + getattr(entry, key)
                for key in (*places, "relative_to")
                if getattr(entry, key, None) is not None
            }
            found.setdefault(mounted.prefix + name, entry.model_copy(update=moved))
    return found
