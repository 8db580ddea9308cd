"""The tables of a composite: the base's own, then those of each part under its prefix.

A part's patterns are anchored to its prefix. A pattern of the base speaks of the base alone,
unless it begins with a part's prefix: then it speaks of that part, and wins over the part's own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from assetbuild.recipe.collision import CollisionRule
from assetbuild.recipe.compose import Part
from assetbuild.recipe.models import FixedJoints, Keyframe, Recipe
from assetbuild.recipe.names import anchored, but_not
from assetbuild.recipe.sides import Side
from assetbuild.robot.actuator_table import ActuatorRow, Motor
from assetbuild.robot.contact import Contact, Surface
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.sensing import IMU_NAMES, Feet, Imu, Sensor

Value = TypeVar("Value")
HOME = "home"


@dataclass(frozen=True)
class Mounted:
    """A part with its own recipe. links, joints: its names with the prefix.

    poses: by keyframe of its source the value of each joint by its own name, rad or m.
    """

    part: Part
    recipe: Recipe
    links: tuple[str, ...]
    joints: tuple[str, ...]
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def prefix(self) -> str:
        """Of all its names."""
        return self.part.as_

    @property
    def side(self) -> Side:
        """Who decides what in it."""
        return Side.of(self.recipe, self.prefix)

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


def composed(recipe: Recipe, parts: Sequence[Mounted]) -> Recipe:
    """The recipe of the whole, whose patterns are about the names with prefixes."""
    prefixes = tuple(mounted.prefix for mounted in parts)
    collision = recipe.collision.model_copy(
        update={
            "links": _links(recipe, parts, prefixes),
            "exclude": recipe.collision.exclude.model_copy(update={"pairs": _pairs(recipe, parts)}),
        }
    )
    return recipe.model_copy(
        update={
            "collision": collision,
            "fixed_joints": _fixed_joints(recipe, parts, prefixes),
            "motors": _motors(recipe, parts),
            "actuators": _actuators(recipe, parts, prefixes),
            "keyframes": _keyframes(recipe, parts, prefixes),
            "contact": _contact(recipe, parts, prefixes),
            "feet": _feet(recipe, parts, prefixes),
            "imu": _imu(recipe, parts),
            "sensors": {
                **_prefixed_places(recipe.sensors, parts, "sensors", ("link", "joint")),
                **_imus_of_parts(recipe, parts),
            },
            "randomize": _randomize(recipe, parts, prefixes),
            "cameras": _prefixed_places(recipe.cameras, parts, "cameras", ("link",)),
            "edits": (),
        }
    )


def poses_in_source_keys(
    recipe: Recipe, parts: Sequence[Mounted], names: Iterable[str]
) -> dict[str, dict[str, float]]:
    """The parts' joints, by pattern, in keyframes that the base's source has and no recipe says."""
    found: dict[str, dict[str, float]] = {}
    for name in names:
        if name not in recipe.keyframes:
            pose: dict[str, float] = {}
            for mounted in parts:
                pose |= _part_pose(mounted, name, ())
            found[name] = pose
    return found


def left_out(recipe: Recipe, part: Recipe) -> tuple[str, ...]:
    """Keys that a part states and the whole does not follow, because it can follow one only."""
    names = {key: field.alias or key for key, field in Recipe.model_fields.items()}
    return tuple(
        names[key]
        for key in OF_THE_WHOLE
        if key in part.model_fields_set and getattr(part, key) != getattr(recipe, key)
    )


OF_THE_WHOLE = ("visual", "mjcf", "mjx", "simulation", "usd", "isaaclab", "validate_", "rules")
"""Keys of a recipe that are about the whole model: the base's hold."""


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


def _fixed_joints(recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]) -> FixedJoints:
    """Each side merges as its own recipe says; of one that does not, all links stay."""
    keep = [_own(pattern, prefixes) for pattern in recipe.fixed_joints.keep_bodies]
    for mounted in parts:
        own = mounted.recipe.fixed_joints.keep_bodies
        keep += [anchored(mounted.prefix, pattern) for pattern in own]
    merge = recipe.fixed_joints.merge, *(m.recipe.fixed_joints.merge for m in parts)
    if any(merge) and not merge[0]:
        keep.append(_own(".*", prefixes))
    if any(merge):
        whole = [m for m in parts if not m.recipe.fixed_joints.merge]
        keep += [anchored(mounted.prefix, ".*") for mounted in whole]
    update = {"merge": any(merge), "keep_bodies": tuple(keep)}
    return recipe.fixed_joints.model_copy(update=update)


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
    recipe: Recipe,
    parts: Sequence[Mounted],
    prefixes: Sequence[str],
) -> dict[str, Keyframe]:
    keyframes = {}
    for name, keyframe in recipe.keyframes.items():
        about, joints = _split(keyframe.joints, prefixes)
        joints |= about
        for mounted in parts:
            joints |= _part_pose(mounted, name, tuple(about))
        keyframes[name] = keyframe.model_copy(update={"joints": joints})
    return keyframes


def home_of_parts(parts: Sequence[Mounted]) -> Keyframe | None:
    """`home` of a base that has no keyframe: its joints at 0; None where no part has one either."""
    pose: dict[str, float] = {}
    for mounted in parts:
        pose |= _part_pose(mounted, HOME, ())
    return Keyframe.model_validate({"joints": pose}) if pose else None


def _part_pose(mounted: Mounted, name: str, but: Sequence[str]) -> dict[str, float]:
    """The part's joints in a keyframe: by `home`, else as its own keyframe of that name or home."""
    pose: dict[str, float] = {}
    if (found := mounted.pose_key(name)) is not None:
        key, by_source = found
        own = mounted.poses[key] if by_source else mounted.recipe.keyframes[key].joints
        pose = {re.escape(k) if by_source else k: v for k, v in own.items()}
    if name == HOME and mounted.part.home:
        first = tuple(mounted.part.home)
        pose = {f"{but_not(first)}(?:{k})": v for k, v in pose.items()} | dict(mounted.part.home)
    placed = {anchored(mounted.prefix, pattern, but): value for pattern, value in pose.items()}
    return {
        pattern: value
        for pattern, value in placed.items()
        if any(re.fullmatch(pattern, joint) for joint in mounted.joints)
    }


def _contact(recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]) -> Contact:
    about, own = _split(recipe.contact.links, prefixes)
    links = {**about, **own}
    for mounted in parts:
        contact = mounted.recipe.contact
        # An MJCF has surfaces of its own: its recipe changes what it states.
        from_mjcf = mounted.recipe.source.mjcf is not None
        whole = _surface_of(contact)
        if from_mjcf:
            whole = Surface(**whole.model_dump(include=contact.model_fields_set))
        for pattern, surface in contact.links.items():
            own_words = surface.model_dump(exclude_none=True)
            links[anchored(mounted.prefix, pattern)] = whole.model_copy(update=own_words)
        bases = Surface() if from_mjcf else _surface_of(recipe.contact)
        if whole != bases:
            links[anchored(mounted.prefix, ".*")] = whole
    return recipe.contact.model_copy(update={"links": links})


def _surface_of(contact: Contact) -> Surface:
    return Surface(**{key: getattr(contact, key) for key in Surface.model_fields})


def _feet(recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]) -> Feet | None:
    """The soles of all; the base decides whether they have contact sensors, if it has feet."""
    found = [recipe.feet] if recipe.feet else []
    patterns = [_own(feet.links, prefixes) for feet in found]
    for mounted in parts:
        if mounted.recipe.feet is not None:
            found.append(mounted.recipe.feet)
            patterns.append(anchored(mounted.prefix, mounted.recipe.feet.links))
    if not found:
        return None
    return found[0].model_copy(update={"links": "|".join(f"(?:{p})" for p in patterns)})


def _imu(recipe: Recipe, parts: Sequence[Mounted]) -> Imu | None:
    """The base's; the first part's where the base has none."""
    if recipe.imu is not None:
        return recipe.imu
    first = next((mounted for mounted in parts if mounted.recipe.imu is not None), None)
    if first is None or first.recipe.imu is None:
        return None
    return first.recipe.imu.model_copy(update={"link": first.prefix + first.recipe.imu.link})


def _imus_of_parts(recipe: Recipe, parts: Sequence[Mounted]) -> dict[str, Sensor]:
    """`<prefix>imu_ang_vel`, ...: the IMUs beside the one that is the whole's."""
    whole, found = _imu(recipe, parts), {}
    for mounted in parts:
        imu = mounted.recipe.imu
        if imu is None or (whole is not None and whole.link == mounted.prefix + imu.link):
            continue
        for kind in imu.sensors:
            sensor = Sensor.model_validate({"kind": kind, "link": mounted.prefix + imu.link})
            found[f"{mounted.prefix}{IMU_NAMES[kind]}"] = sensor
    return found


def _randomize(
    recipe: Recipe, parts: Sequence[Mounted], prefixes: Sequence[str]
) -> Randomize | None:
    """The ranges of all; friction and seed are the base's. None when nobody has any."""
    tables: dict[str, dict[str, Any]] = {"links": {}, "joints": {}}  # Any: of two kinds
    payloads = [
        payload.model_copy(update={"link": mounted.prefix + payload.link})
        for mounted in parts
        if mounted.recipe.randomize is not None
        for payload in mounted.recipe.randomize.payloads
    ]
    for key, table in tables.items():
        if recipe.randomize is not None:
            about, own = _split(getattr(recipe.randomize, key), prefixes)
            table |= {**about, **own}
        for mounted in parts:
            ranges = getattr(mounted.recipe.randomize, key, {})
            table |= {anchored(mounted.prefix, pattern): row for pattern, row in ranges.items()}
    if recipe.randomize is None and not (tables["links"] or tables["joints"] or payloads):
        return None
    base = recipe.randomize or Randomize.model_validate({})
    return base.model_copy(update={**tables, "payloads": (*base.payloads, *payloads)})


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
