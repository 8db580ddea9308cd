"""What the modules of all trainers have in common: patterns of names, drives, the start, events."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from assetbuild.facts.derived import first_match, start_of
from assetbuild.facts.reference import Reference, pose_value
from assetbuild.facts.standins import ARGUMENTS, Record, class_of, table_of, words_of
from assetbuild.facts.table import Key, Value, Writer
from assetbuild.facts.vocabulary import VOCABULARY

Names = Mapping[str, str]
"""The robot's names by those of a module."""
Ranges = Mapping[str, Any]
"""A section of the recipe's `randomize`. Any: JSON."""
STATED = frozenset(
    (
        "robot start pose", "robot soft limits", "joint model", "joint kp", "joint kd",
        "joint effort", "joint velocity", "joint armature", "joint friction", "joint damping",
        "joint stall", "joint delay", "joint start", "simulation timestep",
        "simulation decimation", "simulation gravity",
    )
)  # fmt: skip
"""What every trainer's module states; the rest stands in the MJCF or USD that it loads."""
UNCHANGED = (1.0, 1.0)
"""A factor that draws nothing."""


def left_to_the_asset(*besides: str) -> dict[str, str]:
    """All other quantities, with the reason. besides: what one trainer's module states as well."""
    reason = "stands in the MJCF or USD that the module loads, or is the trainer's own"
    rows = (f"{kind} {name}" for kind, name in VOCABULARY)
    return {row: reason for row in rows if row not in STATED and row not in besides}


# --- reading ----------------------------------------------------------------------------------


def own_names(table: object) -> Names:
    """Names that a module writes out as the keys of a table, for a file without its robot."""
    plain = [re.sub(r"\\(\W)", r"\1", pattern) for pattern in table_of(table)]
    return {name: name for name in plain if "*" not in name}


def matching(patterns: Iterable[str], names: Names) -> list[str]:
    """The robot's names that any of the patterns matches whole."""
    found: dict[str, None] = {}
    for pattern in patterns:
        with suppress(re.error):  # anybody's file may hold what is no pattern
            found |= {own: None for there, own in names.items() if re.fullmatch(pattern, there)}
    return list(found)


def put_by_joint(table: object, names: Names, quantity: str, book: Writer) -> None:
    """One quantity that a table states by patterns of joints."""
    for pattern, value in table_of(table).items():
        for joint in matching([pattern], names):
            book.put("joint", joint, {quantity: value})


def put_start(start: Record, quat: Sequence[float], form: str, names: Names, book: Writer) -> None:
    """Where the root and the joints start. quat: w, x, y, z."""
    pose = (*start.get("pos", (0.0, 0.0, 0.0)), *quat)
    # PhysX refuses a quaternion of another length than 1, and comparing poses does not see it.
    book.put("robot", "", {"start pose": pose, f"{form}:length of rot": math.hypot(*quat)})
    put_by_joint(start.get("joint_pos"), names, "start", book)
    put_by_joint(start.get("joint_vel"), names, f"{form}:start velocity", book)


def delay_s(steps: Sequence[float], timestep_s: float) -> tuple[float, ...]:
    """Simulation steps as seconds."""
    return tuple(step * timestep_s for step in steps)


def put_terms(
    terms: object,
    form: str,
    bodies: Names,
    joints: Names,
    book: Writer,
    groups: Sequence[Sequence[str]] = (),
) -> None:
    """`EventTermCfg` by name. groups: joints of each drive, which a term may name by its place."""
    for term in table_of(terms).values():
        if class_of(term) == "EventTermCfg":
            params = {"mode": term.get("mode"), **table_of(term.get("params"))}
            entity = table_of(params.pop("asset_cfg", None))
            params["entity"] = entity.get(ARGUMENTS)
            params |= {"geom_names": entity["geom_names"]} if "geom_names" in entity else {}
            for kind, subject in _subjects(entity, bodies, joints, groups):
                _put_draw(form, class_of(term.get("func")), (kind, subject), params, book)


def _subjects(
    entity: Record, bodies: Names, joints: Names, groups: Sequence[Sequence[str]]
) -> Iterator[tuple[str, str]]:
    """Whom a `SceneEntityCfg` names; the robot as a whole where it names nobody."""
    if "body_names" in entity:
        yield from (("body", name) for name in matching(words_of(entity["body_names"]), bodies))
    elif "joint_names" in entity:
        yield from (("joint", name) for name in matching(words_of(entity["joint_names"]), joints))
    elif "actuator_ids" in entity:
        yield from (("joint", joint) for place in entity["actuator_ids"] for joint in groups[place])
    else:
        yield "robot", ""


def put_drawn(form: str, function: str, kind: str, name: str, book: Writer, **params: Any) -> None:
    """What a term at the start must draw of one subject. params: any JSON."""
    whole = {"mode": "startup", "entity": "robot", **params}
    _put_draw(form, function, (kind, name), whole, book)


def _put_draw(
    form: str, function: str, subject: tuple[str, str], params: Mapping[str, Any], book: Writer
) -> None:
    """As words of the format; several terms of one subject one after another."""
    for path, value in _flat(params):
        key = Key(*subject, f"{form}:{function} {path}")
        book.facts[key] = (*_row(book.facts.get(key)), *_row(value))


def _flat(table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from ((f"{key}.{path}", leaf) for path, leaf in _flat(value))
        else:
            yield key, value


def _row(value: Any) -> tuple[Any, ...]:  # Any: a leaf, or a matrix of them
    """All numbers of a matrix, row by row."""
    if not isinstance(value, list | tuple):
        return () if value is None else (value,)
    return tuple(leaf for item in value for leaf in _row(item))


# --- what the robot says ----------------------------------------------------------------------


def varied(reference: Reference, section: str, name: str) -> Ranges | None:
    """What the recipe's `randomize` says of a body (`links`) or a joint (`joints`)."""
    table = (reference.options.get("randomize") or {}).get(section) or {}
    found: Ranges | None = first_match(table, name)
    return found


def factors(ranges: Ranges, *keys: str) -> dict[str, tuple[float, float]]:
    """The factors that draw something."""
    found = {key: tuple(ranges.get(key, UNCHANGED)) for key in keys}
    return {key: pair for key, pair in found.items() if pair != UNCHANGED}


def massive_bodies(reference: Reference) -> list[str]:
    """Bodies that have matter."""
    return [b.name for b in reference.tree.bodies if b.inertial and b.inertial.mass_kg > 0.0]


def put_expected_start(
    reference: Reference, form: str, soft_limits: float, clearance_m: float, book: Writer
) -> None:
    """What `put_start` must find. clearance_m: how much higher the root is put."""
    start = start_of(reference.tree, reference.control)
    x, y, z, *turn = pose_value(start.base or reference.tree.X_world_root)
    pose: Value = (x, y, z + clearance_m, *turn)
    book.put("robot", "", {"start pose": pose, f"{form}:length of rot": 1.0})
    book.put("robot", "", {"soft limits": soft_limits})
    for joint, position in start.joints:
        book.put("joint", joint, {"start": position, f"{form}:start velocity": 0.0})
