"""What the modules of all trainers have in common: names, the start, and what the recipe draws.

`drawn:density` of a body, `drawn:kp` of a joint: the least and the most, of a factor or of an
offset in SI units. A range that changes nothing is no fact.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from assetbuild.facts._standins_child import ARGUMENTS
from assetbuild.facts.derived import first_match, per_axis, start_of
from assetbuild.facts.reader import all_but
from assetbuild.facts.reference import Reference, pose_value
from assetbuild.facts.standins import Record, class_of, table_of, words_of
from assetbuild.facts.table import Key, Table, Value
from assetbuild.facts.vocabulary import MUJOCO_OPTIONS
from assetbuild.robot.model import Actuator
from assetbuild.robot.pose import Pose

Names = Mapping[str, str]
"""The robot's names by those of a module."""
LOOPS = ("pd", "ideal_pd", "dc_motor")
"""Drives that hold a position."""
STATED = frozenset(
    (
        "robot start pose", "robot soft limits", "joint model", "joint kp", "joint kd",
        "joint effort", "joint velocity", "joint armature", "joint friction", "joint damping",
        "joint stall", "joint delay", "joint start",
    )
)  # fmt: skip
"""What every trainer's module states; the rest stands in the MJCF or USD that it loads."""


@dataclass(frozen=True)
class Term:
    """A trainer's function that draws. reads: parameter -> word of what it draws.

    means: parameter -> value without which the function would mean something else.
    """

    reads: Mapping[str, str]
    means: Mapping[str, object] = field(default_factory=dict)


def left_to_the_asset(*besides: str) -> dict[str, str]:
    """All other quantities of a robot, with the reason.

    Every module states the values of `simulation`, apart from MuJoCo's own options. besides: what
    one trainer's module states as well.
    """
    reason = "stands in the MJCF or USD that the module loads, or is the trainer's own"
    others = all_but(("simulation", *STATED, *besides), reason)
    return others | {row: reason for row in MUJOCO_OPTIONS if row not in besides}


def own_names(table: object) -> Names:
    """Names that a module writes out as the keys of a table, for a file without its robot."""
    plain = [re.sub(r"\\(\W)", r"\1", pattern) for pattern in table_of(table)]
    return {name: name for name in plain if "*" not in name}


def matching(patterns: Iterable[str], names: Names) -> list[str]:
    """The robot's names that any of the patterns matches whole."""
    matches: dict[str, None] = {}
    for pattern in patterns:
        with suppress(re.error):  # anybody's file may hold what is no pattern
            matches |= {name: None for there, name in names.items() if re.fullmatch(pattern, there)}
    return list(matches)


def number_of(value: Any, joint: str) -> float | None:  # Any: JSON
    """A number for all joints, or that of the last pattern that matches this one."""
    if isinstance(value, dict):
        values = [v for p, v in value.items() if p == joint or matching([p], {joint: joint})]
        return number_of(values[-1], joint) if values and not isinstance(values[-1], dict) else None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else None


def delay_s(steps: Sequence[float], timestep_s: float) -> tuple[float, ...]:
    """Simulation steps as seconds."""
    return tuple(step * timestep_s for step in steps)


# --- the start --------------------------------------------------------------------------------


def put_start(start: Record, quat: Sequence[float], form: str, names: Names, facts: Table) -> None:
    """Where the root and the joints start, those that it does not name at 0. quat: w, x, y, z."""
    pose = (*start.get("pos", (0.0, 0.0, 0.0)), *quat)
    # PhysX refuses a quaternion of another length than 1, and comparing poses does not see it.
    facts.put("robot", "", {"start pose": pose, f"{form}:length of rot": math.hypot(*quat)})
    stated = {"start": "joint_pos", f"{form}:start velocity": "joint_vel"}
    for there, joint in names.items():
        numbers = {key: number_of(start.get(field), there) for key, field in stated.items()}
        facts.put("joint", joint, {key: number or 0.0 for key, number in numbers.items()})


def put_expected_start(
    reference: Reference, form: str, soft_limits: float, clearance_m: float, facts: Table
) -> None:
    """What `put_start` must find. clearance_m: how much higher the root is put."""
    start = start_of(reference.tree, reference.control)
    x, y, z, *turn = pose_value(start.base or reference.tree.X_world_root)
    pose: Value = (x, y, z + clearance_m, *turn)
    facts.put("robot", "", {"start pose": pose, f"{form}:length of rot": 1.0})
    facts.put("robot", "", {"soft limits": soft_limits})
    for joint, position in start.joints:
        facts.put("joint", joint, {"start": position, f"{form}:start velocity": 0.0})


# --- event terms ------------------------------------------------------------------------------


def put_terms(
    terms: object,
    known: Mapping[str, Term],
    bodies: Names,
    joints: Names,
    facts: Table,
    groups: Sequence[Sequence[str]] = (),
) -> None:
    """What `EventTermCfg`s draw. groups: joints of each drive, which a term names by its place."""
    for stated in table_of(terms).values():
        if class_of(stated) != "EventTermCfg":
            continue
        function, params = class_of(stated.get("func")), table_of(stated.get("params"))
        entity = table_of(params.get("asset_cfg"))
        values = {"mode": stated.get("mode"), "entity": entity.get(ARGUMENTS)}
        values |= {key: entity[key] for key in ("geom_names",) if key in entity}
        values |= dict(_leaves({key: item for key, item in params.items() if key != "asset_cfg"}))
        term = known.get(function, Term({}))
        for kind, name in _subjects(entity, bodies, joints, groups):
            for param, word in term.reads.items():
                put_draw(facts, kind, name, word, values.get(param))
            others = {"mode": "startup", "entity": ["robot"], **term.means}
            for param in dict.fromkeys((*others, *values)):
                if param not in term.reads and values.get(param) != others.get(param):
                    stands = str(values.get(param, "missing"))
                    facts.put(kind, name, {f"drawn:{function} {param}": stands})


def _leaves(table: Record) -> Iterator[tuple[str, Any]]:  # Any: JSON
    for key, value in table.items():
        if isinstance(value, dict):
            yield from ((f"{key}.{path}", leaf) for path, leaf in _leaves(value))
        else:
            yield key, value


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


Ranges = Mapping[str, Any]
"""A section of the recipe's `randomize`. Any: JSON."""
Draws = Callable[[Actuator | None, str], object]
"""Whether a format draws one of `FACTORS` of a joint with this drive."""
FACTORS = ("kp", "kd", "effort", "damping", "friction", "armature")
SHEARS = ("shear 12", "shear 13", "shear 23")
OF_MATTER = ("density", "com x", "com y", "com z", "stretch", *SHEARS)


def varied(reference: Reference, section: str, name: str) -> Ranges | None:
    """What the recipe's `randomize` says of a body (`links`) or a joint (`joints`)."""
    table = (reference.options.get("randomize") or {}).get(section) or {}
    ranges: Ranges | None = first_match(table, name)
    return ranges


def put_draw(table: Table, kind: str, name: str, word: str, stated: Any) -> None:  # Any: JSON
    """Note what is drawn of a subject; several draws of one quantity one after another."""
    numbers = tuple(_flat(stated))
    unchanged = 1.0 if word in (*FACTORS, "density") else 0.0
    if any(number != unchanged for number in numbers):
        key = Key(kind, name, f"drawn:{word}")
        before: Value = table.facts.get(key, ())
        table.facts[key] = (*before, *numbers)  # type: ignore[misc] # a tuple, as written here


def _flat(stated: Any) -> Iterator[Any]:  # Any: as above
    """All numbers of a matrix, row by row."""
    if isinstance(stated, list | tuple):
        for item in stated:
            yield from _flat(item)
    elif stated is not None:
        yield stated


def drawn(reference: Reference, draws: Draws, without: tuple[str, ...] = ()) -> Table:
    """All that a format must draw. without: the words that it has no way to draw."""
    table, tree = Table(), reference.tree
    recipe = reference.options.get("randomize") or {}
    for body in tree.bodies:
        matter = varied(reference, "links", body.name)
        for word, pair in _matter(matter) if matter and not body.is_massless else ():
            put_draw(table, "body", body.name, word, pair)
    for payload in recipe.get("payloads", ()):
        name, X_body_link = tree.placement(payload["link"])
        if not tree.by_body[name].is_massless:
            put_draw(table, "body", name, "payload mass", payload["mass"])
            put_draw(table, "body", name, "payload box", _box(payload, X_body_link))
    for joint in tree.moving_joints:
        ranges = varied(reference, "joints", joint.name) or {}
        row = reference.control.by_joint.get(joint.name)
        for word in FACTORS:
            if draws(row, word):
                put_draw(table, "joint", joint.name, word, ranges.get(word))
        bias = ranges.get("encoder_bias") or 0.0
        put_draw(table, "joint", joint.name, "encoder bias", (-bias, bias))
    put_draw(table, "robot", "", "surface friction", recipe.get("friction"))
    put_draw(table, "robot", "", "restitution", recipe.get("restitution"))
    return table.only(lambda key: key.quantity.removeprefix("drawn:") not in without)


def _matter(matter: Ranges) -> Iterator[tuple[str, tuple[float, float]]]:
    yield "density", tuple(matter["density"])
    for axis, most in zip("xyz", per_axis(matter["com"]), strict=True):
        yield f"com {axis}", (-most, most)
    yield "stretch", (-matter["stretch"], matter["stretch"])
    for shear in SHEARS:
        yield shear, (-matter["shear"], matter["shear"])


def _box(payload: Ranges, X_body_link: Pose) -> list[list[float]]:
    """(4, 4) [[S, h], [h, 1]] of one kilogram: second moments e²/12 along its edges, m²."""
    turn = X_body_link.rotation
    centre = turn @ np.array(payload["at"]) + np.array(X_body_link.xyz)
    matter = np.eye(4)
    second = turn @ np.diag(np.square(payload["size"]) / 12.0) @ turn.T
    matter[:3, :3] = second + np.outer(centre, centre)
    matter[:3, 3] = matter[3, :3] = centre
    box: list[list[float]] = matter.tolist()
    return box
