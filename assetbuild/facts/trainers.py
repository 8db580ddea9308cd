"""What the modules of all trainers have in common: patterns of names, drawn events, the start."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from assetbuild.facts.reference import Reference
from assetbuild.facts.syntax import Call, flat
from assetbuild.facts.table import Value, Writer
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Keyframe
from assetbuild.robot.ranges import Randomize, RandomJoint, first_match

# --- names ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Names:
    """The robot's names by those that a module uses. Without any, patterns stand for themselves."""

    bodies: Mapping[str, str] = field(default_factory=dict)
    joints: Mapping[str, str] = field(default_factory=dict)

    def of(self, pattern: str, kind: str) -> tuple[str, ...]:
        """The robot's names that a pattern matches whole; itself where it matches none."""
        names = self.bodies if kind == "body" else self.joints
        if pattern == ".*":
            return tuple(names.values())
        try:
            found = tuple(own for there, own in names.items() if re.fullmatch(pattern, there))
        except re.error:
            found = ()
        return found or (unescaped(pattern),)


def unescaped(pattern: str) -> str:
    """The one name that a pattern matches; any other pattern as it is."""
    name = re.sub(r"\\(\W)", r"\1", pattern)
    return name if re.escape(name) == pattern else pattern


def is_name(pattern: str) -> bool:
    """Whether a pattern matches one name alone."""
    return re.escape(unescaped(pattern)) == pattern or re.fullmatch(r"[\w-]*", pattern) is not None


def texts(value: object) -> tuple[str, ...]:
    """A text or a tuple of texts; nothing of anything else."""
    if isinstance(value, str):
        return (value,)
    if isinstance(value, tuple):
        return tuple(item for item in value if isinstance(item, str))
    return ()


def spread(
    table: object, kind: str, names: Names, book: Writer, where: str
) -> Iterator[tuple[str, Any]]:  # Any: a value of `syntax`
    """(name, value) of a map by patterns; what a second pattern says of a name is unread."""
    seen: set[str] = set()
    for pattern, value in table.items() if isinstance(table, dict) else ():
        for name in names.of(str(pattern), kind):
            if name in seen:
                book.skip(where, f"{kind} {name} again", value)
            else:
                seen.add(name)
                yield name, value


# --- events -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Event:
    """A term that draws something at the start. kind: of the subjects' names."""

    name: str
    func: str
    kind: str = ""
    subjects: Sequence[str] = ()
    params: Mapping[str, Value] = field(default_factory=dict)

    def put(self, form: str, book: Writer) -> None:
        """As words of the format."""
        facts: dict[str, Value] = {f"{form}:func": self.func, f"{form}:mode": "startup"}
        facts[f"{form}:entity"] = "SceneEntityCfg robot"
        if self.kind:
            facts[f"{form}:{self.kind}"] = tuple(sorted(self.subjects))
        facts |= {f"{form}:{name}": value for name, value in self.params.items()}
        book.put("event", self.name, facts)


def read_events(
    terms: Mapping[str, object],
    form: str,
    names: Names,
    book: Writer,
    groups: Sequence[Sequence[str]] = (),
) -> None:
    """`EventTermCfg` by name. groups: joints of each drive, which a term may name by its place."""
    for name, term in terms.items():
        if not isinstance(term, Call) or term.last != "EventTermCfg":
            book.skip(f"event {name}", name, term)
            continue
        params = term.take("params")
        params = dict(params) if isinstance(params, dict) else {}
        facts: dict[str, Value] = {}
        for key in ("func", "mode"):
            facts[f"{form}:{key}"] = _leaf(term.take(key))
        entity = params.pop("asset_cfg", None)
        if isinstance(entity, Call):
            facts |= {f"{form}:{k}": v for k, v in _entity(entity, names, groups)}
            params |= {f"asset_cfg{k}": v for k, v in entity.left()}
        for key, value in params.items():
            facts |= {f"{form}:{path}": leaf for path, leaf in _matrix(value, key)}
        book.put("event", name, facts)
        for key, value in term.left():
            book.skip(f"event {name}", key, value)


def _entity(
    entity: Call, names: Names, groups: Sequence[Sequence[str]]
) -> Iterator[tuple[str, Value]]:
    yield "entity", " ".join(map(str, (entity.name, *entity.arguments)))
    entity.arguments.clear()
    for field_name, kind in (("body_names", "body"), ("joint_names", "joint")):
        stated = entity.take(field_name)
        if stated is not None:
            found = [name for p in texts(stated) for name in names.of(p, kind)]
            yield kind, tuple(sorted(found))
    places = entity.take("actuator_ids")
    if isinstance(places, tuple):
        inside = [p for p in places if isinstance(p, int) and 0 <= p < len(groups)]
        found = [name for place in inside for name in groups[place]]
        odd = [f"actuator {place}" for place in places if place not in inside]
        yield "joint", tuple(sorted((*found, *odd)))
    geoms = entity.take("geom_names")
    if geoms is not None:
        yield "shape", texts(geoms)


def _matrix(value: object, path: str) -> Iterator[tuple[str, Value]]:
    """A matrix is one vector of all its rows."""
    is_table = isinstance(value, tuple) and bool(value)
    if is_table and all(isinstance(row, tuple) for row in value):  # type: ignore[attr-defined] # a tuple
        yield path, tuple(v for row in value for v in row)  # type: ignore[attr-defined] # as above
    else:
        yield from flat(value, path)


def _leaf(value: object) -> Value:
    return value if isinstance(value, bool | str | float | int) else str(value)


# --- what the robot says ----------------------------------------------------------------------


def start_of(reference: Reference) -> Keyframe:
    """Where the robot starts in every trainer."""
    return initial_pose(reference.tree, reference.control)


def randomize_of(reference: Reference) -> Randomize | None:
    """The recipe's `randomize`."""
    stated = reference.options.get("randomize")
    return None if stated is None else Randomize.model_validate(stated)


def ranges_of(randomize: Randomize | None, joint: str) -> RandomJoint:
    """What may vary at a joint; nothing where the recipe says nothing."""
    table = randomize.joints if randomize else {}
    return first_match(table, joint) or RandomJoint.model_validate({})


def delay_s(steps: Iterable[float], timestep_s: float) -> tuple[float, ...]:
    """Simulation steps as seconds."""
    return tuple(step * timestep_s for step in steps)


def stall_of(drive: Actuator) -> float | None:
    """Effort at rest of a dc motor, N m or N; its limit where the table states none."""
    return drive.saturation


def massive_bodies(reference: Reference) -> list[str]:
    """Bodies that have matter."""
    return [b.name for b in reference.tree.bodies if b.inertial and b.inertial.mass_kg > 0.0]
