"""The tables of a composite: the base's own, then those of each part, by names of the whole.

Each pattern is matched on the names of its own robot (see `names`); what is merged are tables of
names. Where the base speaks of a part's name, its row wins over the part's own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from assetbuild.compose.composed_control import under
from assetbuild.compose.names import HOME, Member, Row, Value, rows_of, spoken_of
from assetbuild.geometry.jobs import file_of
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import CollisionRule, Recipe
from assetbuild.recipe.validation import Key
from assetbuild.recipe_types import listed
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.contact import Contact, Surface
from assetbuild.robot.loops import LoopRow
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.sections import IMU_NAMES, Feet, Imu, Keyframe, Sensor

Table = Mapping[str, Row[Any]] | Sequence[Row[Any]]  # Any: rows of any model of a recipe
OF_THE_WHOLE = ("identify", "visual", "simulation", "validate", "rules")
"""Keys of a recipe that are about the whole model, as those of its targets are: the base's hold."""


@dataclass(frozen=True)
class Composed(LoadedRecipe):
    """The recipe of the whole. origins: of its rows, where they are written, by their keys."""

    origins: Mapping[Key, tuple[LoadedRecipe, Key]] = field(default_factory=dict)

    def origin(self, key: Key) -> tuple[LoadedRecipe, Key]:
        """The recipe of the part, where a row is the part's."""
        for length in range(len(key), 0, -1):
            if key[:length] in self.origins:
                whose, part_key = self.origins[key[:length]]
                return whose, (*part_key, *key[length:])
        return self, key

    @property
    def common_surfaces(self) -> tuple[str, ...]:
        """Patterns of `contact.links` that stand for the `contact` of a part."""
        key = ("contact", "links")
        patterns = self.recipe.contact.links
        return tuple(p for p in patterns if self.origins[(*key, p)][1] == ("contact",))


def composed(members: Sequence[Member]) -> Composed:
    """The recipe of the whole in exact names; the base is the first of the members.

    RecipeError, with its line, for a pattern that speaks of nothing.
    """
    base, keyframes = members[0], _keyframes(members)
    ranges = _randomize(members)
    randomize = base.recipe.randomize
    if randomize is None and any(ranges.values()):
        randomize = Randomize.model_validate({})
    imu = _imu(members)
    update = {
        "keyframes": keyframes,
        "feet": _feet(members),
        "imu": imu,
        "randomize": randomize,
        "edits": (),
    }
    tables: dict[Key, Table] = {
        ("collision", "links"): _by_pattern(_collision(members)),
        ("collision", "exclude", "pairs"): list(_pairs(members).values()),
        ("fixed_joints", "keep_bodies"): list(_keep_bodies(members)),
        ("motors",): _placed(members, "motors", ("extends",)),
        ("actuators",): list(_actuators(members)),
        **{
            ("keyframes", k, "joints"): _by_pattern(pose_rows(members, k), once=True)
            for k in keyframes
        },
        ("contact", "links"): _by_pattern(_contact(members)),
        ("sensors",): _placed(members, "sensors", ("link", "joint", "relative_to"))
        | _other_imus(members, imu),
        ("loops",): list(_loops(members)),
        ("cameras",): _placed(members, "cameras", ("link",)),
        **(ranges if randomize else {}),
    }
    values = {key: _values(table) for key, table in tables.items()}
    values["fixed_joints", "merge"] = any(m.recipe.fixed_joints.merge for m in members)
    recipe = _replaced(base.recipe.model_copy(update=update), values)
    return Composed(**vars(base.loaded) | {"recipe": recipe, "origins": _origins(tables)})


def left_out(recipe: Recipe, part: Recipe) -> tuple[str, ...]:
    """Keys that a part states and the whole does not follow, because it can follow one only."""
    of_targets = [key for key in type(part).model_fields if key not in Recipe.model_fields]
    return tuple(
        key
        for key in (*OF_THE_WHOLE, *of_targets)
        if part.states(key) and not recipe.agrees(key, part.value(key))
    )


# --- tables to recipe -----------------------------------------------------------------------


def _by_pattern(rows: Iterable[Row[Value]], *, once: bool = False) -> dict[str, Row[Value]]:
    """The first of the rows about the same names; RecipeError for a second if `once`."""
    by_pattern: dict[str, Row[Value]] = {}
    for row in rows:
        first = by_pattern.setdefault(row.pattern, row)
        if once and first is not row:
            message = f"`{first.key[-1]}` matches joint `{row.names[0]}` too"
            raise row.whose.error(row.key, message, "narrow one of the two patterns")
    return by_pattern


def _values(table: Table) -> Any:  # Any: as Table
    if isinstance(table, Mapping):
        return {key: row.value for key, row in table.items()}
    return tuple(row.value for row in table)


def _origins(tables: Mapping[Key, Table]) -> dict[Key, tuple[LoadedRecipe, Key]]:
    origins: dict[Key, tuple[LoadedRecipe, Key]] = {}
    for key, table in tables.items():
        rows = table.items() if isinstance(table, Mapping) else enumerate(table)
        for at, row in rows:
            origins[(*key, at)] = row.whose, row.key
    return origins


def _replaced(of: Any, values: Mapping[Key, Any]) -> Any:  # Any: a model, or a map of models
    """A copy of a model, or of a map of models, with other values at some keys."""
    update = {}
    for head in dict.fromkeys(key[0] for key in values):
        below = {key[1:]: value for key, value in values.items() if key[0] == head}
        inner = of[head] if isinstance(of, Mapping) else getattr(of, str(head))
        update[head] = below[()] if () in below else _replaced(inner, below)
    return {**of, **update} if isinstance(of, Mapping) else of.model_copy(update=update)


# --- links ----------------------------------------------------------------------------------


def _all_links(member: Member, value: Value, *key: str) -> Row[Value]:
    return Row(
        value, member.loaded, key, tuple(member.prefix + link for link in member.names["links"])
    )


def _keep_bodies(members: Sequence[Member]) -> Iterator[Row[str]]:
    """Each side merges as its own recipe says; of one that does not, all links stay."""
    some_merge = any(member.recipe.fixed_joints.merge for member in members)
    for member in members:
        fixed, key = member.recipe.fixed_joints, ("fixed_joints", "keep_bodies")
        rows = [
            Row(pattern, member.loaded, (*key, index), spoken_of(member, (*key, index), pattern))
            for index, pattern in enumerate(fixed.keep_bodies)
        ]
        if some_merge and not fixed.merge:
            rows.append(_all_links(member, ".*", "fixed_joints", "merge"))
        yield from (replace(row, value=row.pattern) for row in rows)


def _collision(members: Sequence[Member]) -> Iterator[Row[CollisionRule]]:
    for member in members:
        collision = member.recipe.collision
        folder = member.loaded.folder
        rules = {
            p: _under(_found(rule, folder), collision.preset) for p, rule in collision.links.items()
        }
        yield from rows_of(member, ("collision", "links"), rules)
        if member.part:
            default = _under(_found(collision.default, folder), collision.preset)
            yield _all_links(member, default, "collision", "default")


def _found(rule: CollisionRule, folder: Path) -> CollisionRule:
    """The rule with the files of its own folder, whatever that of the whole is."""
    pieces = getattr(rule, "pieces", None)
    if not pieces:
        return rule
    files = (piece.file and str(file_of(piece.file, folder)) for piece in pieces)
    there = (p.model_copy(update={"file": f}) for p, f in zip(pieces, files, strict=True))
    return rule.model_copy(update={"pieces": tuple(there)})


def _under(rule: CollisionRule, preset: str) -> CollisionRule:
    """The rule with its recipe's preset, which the whole may not share."""
    return rule if rule.preset is not None else rule.model_copy(update={"preset": preset})


def _pairs(members: Sequence[Member]) -> dict[tuple[str, str], Row[tuple[str, str]]]:
    pairs: dict[tuple[str, str], Row[tuple[str, str]]] = {}
    for member in members:
        for index, (a, b) in enumerate(member.recipe.collision.exclude.pairs):
            pair, key = (member.prefix + a, member.prefix + b), ("collision", "exclude", "pairs")
            pairs.setdefault(pair, Row(pair, member.loaded, (*key, index)))
        for index, link in enumerate(member.part.exclude if member.part else ()):
            for other in member.tree.by_body:
                pair, row = (link, member.prefix + other), (*member.row, "exclude", index)
                pairs.setdefault(pair, Row(pair, members[0].loaded, row))
    return pairs


def _contact(members: Sequence[Member]) -> Iterator[Row[Surface]]:
    base, key = members[0], ("contact", "links")
    yield from rows_of(base, key, base.recipe.contact.links)
    for part in base.reach:
        contact = part.recipe.contact
        # An MJCF has surfaces of its own: its recipe changes what it states.
        from_mjcf = part.recipe.source.mjcf is not None
        whole = _surface_of(contact)
        if from_mjcf:
            whole = Surface(**whole.model_dump(include=contact.model_fields_set))
        surfaces = {
            pattern: whole.model_copy(update=surface.model_dump(exclude_none=True))
            for pattern, surface in contact.links.items()
        }
        yield from rows_of(part, key, surfaces)
        if whole != (Surface() if from_mjcf else _surface_of(base.recipe.contact)):
            yield _all_links(part, whole, "contact")


def _surface_of(contact: Contact) -> Surface:
    return Surface(**{key: getattr(contact, key) for key in Surface.model_fields})


def _feet(members: Sequence[Member]) -> Feet | None:
    """The soles of all; the base decides whether they have contact sensors, if it has feet."""
    with_feet = [(member, member.recipe.feet) for member in members if member.recipe.feet]
    names = [n for m, feet in with_feet for n in spoken_of(m, ("feet", "links"), feet.links)]
    links = listed(dict.fromkeys(names))
    return with_feet[0][1].model_copy(update={"links": links}) if with_feet else None


# --- drives and poses -----------------------------------------------------------------------


def _actuators(members: Sequence[Member]) -> Iterator[Row[ActuatorRow]]:
    """All rows but those of a part whose joints the base has taken."""
    taken: set[str] = set()
    for member in members:
        for index, row in enumerate(member.recipe.actuators):
            key = ("actuators", index)
            names = spoken_of(member, (*key, "joints"), row.joints, "joints")
            placed = Row(row, member.loaded, key, names)
            if member.part:
                placed = placed.without(taken)
            else:
                taken |= set(names)
            if placed.names:
                moved = under(member.prefix, row, "motor")
                moved = moved.model_copy(update={"joints": placed.pattern})
                yield replace(placed, value=moved)


def _keyframes(members: Sequence[Member]) -> dict[str, Keyframe]:
    """The base's; without any, and none in its source, the `home` of its parts."""
    base = members[0]
    if base.recipe.keyframes or base.poses or not pose_rows(members, HOME):
        return base.recipe.keyframes
    return {HOME: Keyframe.model_validate({})}


def pose_rows(members: Sequence[Member], name: str) -> list[Row[float]]:
    """The joints of the whole in a keyframe: the base's, then each part's that it leaves alone."""
    base = members[0]
    joints = base.recipe.keyframes[name].joints if name in base.recipe.keyframes else {}
    rows = list(rows_of(base, ("keyframes", name, "joints"), joints, "joints"))
    taken = {joint for row in rows for joint in row.names}
    left = (row.without(taken) for part in base.reach for row in _part_pose(base, part, name))
    return rows + [row for row in left if row.names]


def pose_of(rows: Iterable[Row[float]]) -> dict[str, float]:
    """The value of each joint, rad or m."""
    return {joint: row.value for row in rows for joint in row.names}


def _part_pose(base: Member, part: Member, name: str) -> Iterator[Row[float]]:
    """The pose that `home` of its row says, else its own keyframe of that name or `home`."""
    first: set[str] = set()
    if name == HOME and part.part:
        said_by_base = replace(part, loaded=base.loaded)
        for row in rows_of(said_by_base, (*part.row, HOME), part.part.home, "joints"):
            first |= set(row.names)
            yield row
    key, by_source = part.pose_key(name) or ("", False)
    if by_source:
        pose = {part.prefix + joint: value for joint, value in part.poses[key].items()}
        rows = [Row(value, part.loaded, ("source",), (joint,)) for joint, value in pose.items()]
    else:
        joints = part.recipe.keyframes[key].joints if key else {}
        rows = list(rows_of(part, ("keyframes", key, "joints"), joints, "joints"))
    yield from (row.without(first) for row in rows)


def _loops(members: Sequence[Member]) -> Iterator[Row[LoopRow]]:
    for member in members:
        for index, row in enumerate(member.recipe.loops):
            ends = {side: under(member.prefix, getattr(row, side), "link") for side in ("a", "b")}
            moved = under(member.prefix, row, "name").model_copy(update=ends)
            yield Row(moved, member.loaded, ("loops", index))


# --- senses and ranges ----------------------------------------------------------------------


def _imu(members: Sequence[Member]) -> Imu | None:
    """The base's; the first part's where the base has none."""
    imus = ((member.prefix, member.recipe.imu) for member in members)
    return next((under(prefix, imu, "link") for prefix, imu in imus if imu), None)


def _other_imus(members: Sequence[Member], whole: Imu | None) -> dict[str, Row[Sensor]]:
    """`<prefix>imu_ang_vel`, ...: the IMUs of parts beside the one that is the whole's."""
    sensors = {}
    for part in members[1:]:
        if (imu := part.recipe.imu) is None or (whole and whole.link == part.prefix + imu.link):
            continue
        for kind in imu.sensors:
            sensor = Sensor.model_validate({"kind": kind, "link": part.prefix + imu.link})
            sensors[part.prefix + IMU_NAMES[kind]] = Row(sensor, part.loaded, ("imu",))
    return sensors


def _placed(
    members: Sequence[Member], table: str, places: tuple[str, ...]
) -> dict[str, Row[Any]]:  # Any: sensors, cameras or motors
    """What all have by name; `places`: keys that name a link, a joint or another of them."""
    placed: dict[str, Row[Any]] = {}
    for member in members:
        for name, entry in getattr(member.recipe, table).items():
            row = Row(under(member.prefix, entry, *places), member.loaded, (table, name))
            placed.setdefault(member.prefix + name, row)
    return placed


def _randomize(members: Sequence[Member]) -> dict[Key, Table]:
    """The ranges of all; friction and seed are the base's."""
    links, joints, payloads = list[Row[Any]](), list[Row[Any]](), list[Row[Any]]()
    for member in members:
        if (ranges := member.recipe.randomize) is not None:
            links += rows_of(member, ("randomize", "links"), ranges.links)
            joints += rows_of(member, ("randomize", "joints"), ranges.joints, "joints")
            for index, payload in enumerate(ranges.payloads):
                moved = under(member.prefix, payload, "link")
                payloads.append(Row(moved, member.loaded, ("randomize", "payloads", index)))
    return {
        ("randomize", "links"): _by_pattern(links),
        ("randomize", "joints"): _by_pattern(joints),
        ("randomize", "payloads"): payloads,
    }
