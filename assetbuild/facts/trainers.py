"""What the modules of all trainers have in common: patterns of names, the start, drawn events."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from assetbuild.facts.reference import Reference, pose_value
from assetbuild.facts.standins import ARGUMENTS, Record, class_of, table_of, words_of
from assetbuild.facts.table import Key, Value, Writer
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Keyframe
from assetbuild.robot.ranges import Randomize, RandomJoint, RandomMatter, first_match

Names = Mapping[str, str]
"""The robot's names by those of a module."""
STATED = frozenset(
    (
        "robot start pose", "robot soft limits", "joint model", "joint kp", "joint kd",
        "joint effort", "joint velocity", "joint armature", "joint friction", "joint damping",
        "joint stall", "joint delay", "joint start", "simulation timestep",
        "simulation decimation", "simulation gravity",
    )
)  # fmt: skip
"""What every trainer's module states; the rest stands in the MJCF or USD that it loads."""


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


def put_drive(joints: Iterable[str], facts: Mapping[str, Value], book: Writer, where: str) -> None:
    """The numbers of one group of drives; of a joint that two groups claim there are two models."""
    for joint in joints:
        earlier = book.facts.get(Key("joint", joint, "model"))
        twice = {} if earlier is None else {"model": f"{earlier} and {facts['model']}"}
        book.put("joint", joint, {**facts, **twice})
        book.place("joint", joint, where)


def delay_s(steps: Sequence[float], timestep_s: float) -> tuple[float, ...]:
    """Simulation steps as seconds."""
    return tuple(step * timestep_s for step in steps)


# --- events -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Drawn:
    """What a trainer's function draws. kind, subjects: of whom; params: what it is given."""

    function: str
    kind: str
    subjects: Sequence[str]
    params: Mapping[str, Any]  # Any: numbers, texts, and tuples and tables of them

    def put(self, form: str, book: Writer) -> None:
        """As words of the format, by subject; several terms of one subject one after another."""
        for subject in self.subjects:
            for path, value in _flat(self.params):
                key = Key(self.kind, subject, f"{form}:{self.function} {path}")
                book.facts[key] = (*_row(book.facts.get(key)), *_row(value))


def read_terms(
    terms: object, bodies: Names, joints: Names, groups: Sequence[Sequence[str]] = ()
) -> Iterator[Drawn]:
    """`EventTermCfg` by name. groups: joints of each drive, which a term may name by its place."""
    for term in table_of(terms).values():
        if class_of(term) == "EventTermCfg":
            params = {"mode": term.get("mode"), **table_of(term.get("params"))}
            entity = table_of(params.pop("asset_cfg", None))
            params["entity"] = entity.get(ARGUMENTS)
            params |= {"geom_names": entity["geom_names"]} if "geom_names" in entity else {}
            kind, subjects = _subjects(entity, bodies, joints, groups)
            yield Drawn(class_of(term.get("func")), kind, subjects, params)


def _subjects(
    entity: Record, bodies: Names, joints: Names, groups: Sequence[Sequence[str]]
) -> tuple[str, list[str]]:
    """Whom a `SceneEntityCfg` names; the robot as a whole where it names nobody."""
    if "body_names" in entity:
        return "body", matching(words_of(entity["body_names"]), bodies)
    if "joint_names" in entity:
        return "joint", matching(words_of(entity["joint_names"]), joints)
    if "actuator_ids" in entity:
        return "joint", [joint for place in entity["actuator_ids"] for joint in groups[place]]
    return "robot", [""]


def drawn(function: str, kind: str, subject: str, **params: object) -> Drawn:
    """What a term at the start must draw of one subject."""
    return Drawn(function, kind, [subject], {"mode": "startup", "entity": "robot", **params})


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


@dataclass(frozen=True)
class Ranges:
    """The recipe's `randomize` by the names of the robot."""

    recipe: Randomize | None

    @classmethod
    def of(cls, reference: Reference) -> Ranges:
        """Nothing where the recipe says nothing."""
        stated = reference.options.get("randomize")
        return cls(None if stated is None else Randomize.model_validate(stated))

    def joint(self, name: str) -> RandomJoint:
        """What may vary at a joint."""
        table = self.recipe.joints if self.recipe else {}
        return first_match(table, name) or RandomJoint.model_validate({})

    def body(self, name: str) -> RandomMatter | None:
        """What may vary of a body's matter."""
        return first_match(self.recipe.links, name) if self.recipe else None


def massive_bodies(reference: Reference) -> list[str]:
    """Bodies that have matter."""
    return [b.name for b in reference.tree.bodies if b.inertial and b.inertial.mass_kg > 0.0]


def start_of(reference: Reference) -> Keyframe:
    """Where the robot starts in every trainer."""
    return initial_pose(reference.tree, reference.control)


def put_expected_start(
    reference: Reference, form: str, soft_limits: float, clearance_m: float, book: Writer
) -> None:
    """What `put_start` must find. clearance_m: how much higher the root is put."""
    start = start_of(reference)
    x, y, z, *turn = pose_value(start.base or reference.tree.X_world_root)
    pose = (x, y, z + clearance_m, *turn)
    book.put("robot", "", {"start pose": pose, f"{form}:length of rot": 1.0})
    book.put("robot", "", {"soft limits": soft_limits})
    for joint, position in start.joints:
        book.put("joint", joint, {"start": position, f"{form}:start velocity": 0.0})
