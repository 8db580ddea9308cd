"""What our MJCF must say, from the source's own table: each difference that is meant, by rule.

- Bodies on a mocap body and sites of the world are scenery.
- The world as a root has no mass.
- Positions count from `ref`, and so do the commands of drives that hold positions.
- A body's frame stands in the anchor of its last joint; its old one becomes `<body>_origin`.
- A body without mass and joints becomes a site; one that the recipe merges joins its parent.
- A site with the name of a body is called `<site>_site`; a body `world` has MuJoCo's name.
- Bodies that a joint connects are excluded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from assetbuild.checks.mjcf_source.tables import Side, Subjects
from assetbuild.facts.compare import EXACT, Difference, Precision, differences
from assetbuild.facts.mjcf import MESHES
from assetbuild.facts.table import Key, Table, Value
from assetbuild.robot.inertia import combine
from assetbuild.robot.model import Inertial, Tree
from assetbuild.simulators.joint_drives import read_drives
from assetbuild.simulators.mujoco import Model, body_names, name_of

SNAPPED = 2e-6
"""Two frames that differ by less count as one in MuJoCo's compiler, in each of the two files."""
ROUGH = 1e-5
"""MuJoCo before 4.0 diagonalised a `fullinertia` to a relative 3e-6 (measured in 3.11); we take the
source's own numbers."""
MADE: Mapping[str, Value] = {
    "mjcf:group": 4.0,
    "mjcf:kind": 2.0,
    "mjcf:extent": (0.005,) * 3,
    "mjcf:colour": (0.5, 0.5, 0.5, 1.0),
}
"""A site that the build makes: MuJoCo's usual small sphere in a hidden group."""

DRIVE = frozenset({"model", "kp", "kd", "gear", "effort", "command range", "drive name",
                   "drive parameters", "damping", "friction", "armature",
                   "mjcf:actuatorfrcrange", "mjcf:effort range",
                   "mjcf:dof_dampingpoly"})  # fmt: skip
WHOLE = frozenset({"tendon", "light", "contact pair", "actuator"})
"""Kinds that only MJCF has."""
SURFACE = frozenset({"friction", "condim", "priority", "solref", "solimp", "margin", "gap"})
MESH = frozenset({"triangles", "area", "volume", "mean corner", "corner moments"})
BASE = frozenset({("robot", "base"), ("robot", "base pose"), ("keyframe", "base pose")})
OPTIONS = {"ls_iterations": "line search iterations"}
"""Key of a recipe -> quantity, where they differ."""


def rest_of(model: Model) -> dict[str, float]:
    """`ref` of each joint that has one, rad or m."""
    values = {
        name_of(model, "joint", joint): float(model.qpos0[int(model.jnt_qposadr[joint])])
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) in (2, 3)
    }
    return {name: value for name, value in values.items() if value}


def command_rest(model: Model) -> dict[str, float]:
    """The command of each drive that holds positions with its joint at `ref`, by actuator."""
    rest = rest_of(model)
    return {
        name_of(model, "actuator", drive.index): drive.command(rest[drive.joint_name])
        for drive in read_drives(model)
        if drive.joint_name in rest and drive.kind == "servo" and not drive.filtered
    }


def expected(side: Side, tree: Tree, stated: frozenset[str]) -> Subjects:
    """Facts of the source as our MJCF must have them. stated: see `MjcfSource`."""
    facts = {subject: dict(own) for subject, own in side.facts.items()}
    _without_scenery(facts, side.model, tree)
    _count_from_rest(facts, side.model)
    _join(facts, tree, merges="merge" in stated)
    _move_frames(facts, side.model)
    return _renamed(facts, body_names(tree), {body.name for body in tree.bodies})


def _without_scenery(facts: Subjects, model: Model, tree: Tree) -> None:
    roots = [int(model.body_rootid[body]) for body in range(model.nbody)]
    scenery = {
        name_of(model, "body", body)
        for body, root in enumerate(roots)
        if model.body_mocapid[root] >= 0
    }
    world = body_names(tree).get("world", "")
    facts.get(("body", world), {}).update(mass=0.0)
    for quantity in ("centre of mass", "inertia"):
        facts.get(("body", world), {}).pop(quantity, None)
    for (kind, name), own in list(facts.items()):
        owner = name if kind == "body" else own.get("body")
        if (owner in scenery and kind != "equality") or (kind == "frame" and owner in ("", world)):
            del facts[kind, name]


def _count_from_rest(facts: Subjects, model: Model) -> None:
    for joint, rest in rest_of(model).items():
        own = facts["joint", joint]
        moved = ["lower", "upper", *(["spring reference"] if own.get("stiffness") else [])]
        for (kind, name), pose in facts.items():
            if kind == "keyframe" and name.endswith(f"/{joint}"):
                for quantity in pose.keys() & {"position", "target"}:
                    if quantity == "position" or own.get("model") == "pd":
                        pose[quantity] = _less(pose[quantity], rest)
        if own.get("model") == "pd" and own.get("command range"):
            own["command range"] = tuple(float(v) - rest for v in own["command range"])  # type: ignore[union-attr] # two numbers
        for quantity in moved:
            own[quantity] = _less(own.get(quantity), rest)


def _less(value: Value, rest: float) -> Value:
    return None if value is None else float(value) - rest  # type: ignore[arg-type] # a number


def _join(facts: Subjects, tree: Tree, *, merges: bool) -> None:
    """Bodies on no joint become sites, or parts of their parents where the recipe merges."""
    moved = {own.get("body") for (kind, _), own in facts.items() if kind == "joint"}
    kept = {body.name for body in tree.bodies} | {"world_body"}
    sites = {frame.name for frame in tree.frames}
    bodies = [name for kind, name in facts if kind == "body"]
    for name in reversed(bodies):  # children first
        own = facts["body", name]
        if name in kept or name in moved or not own["parent"] or (own["mass"] and not merges):
            continue
        into = str(own["parent"])
        if own["mass"]:
            facts["body", into] |= _together(facts["body", into], own)
        del facts["body", name]
        for (kind, _), other in facts.items():
            for quantity in ("body", "parent"):
                if other.get(quantity) == name and kind != "pair":
                    other[quantity] = into
        if name in sites or not merges:
            facts["frame", name] = {"body": into, "pose": own["pose"], **MADE}


def _together(*bodies: Mapping[str, Value]) -> dict[str, Value]:
    parts = [
        Inertial(own["mass"], own["centre of mass"], own["inertia"])  # type: ignore[arg-type] # numbers
        for own in bodies
        if own["mass"]
    ]
    whole = combine(parts)
    return {
        "mass": whole.mass_kg, "centre of mass": whole.com_m, "inertia": whole.inertia_com_kg_m2
    }  # fmt: skip


def _move_frames(facts: Subjects, model: Model) -> None:
    """A body's frame goes to the anchor of its last joint."""
    for joint in range(model.njnt):
        subject = ("joint", name_of(model, "joint", joint))
        body = int(model.jnt_bodyid[joint])
        last = joint == int(model.body_jntadr[body]) + int(model.body_jntnum[body]) - 1
        if not last or "anchor" not in facts.get(subject, {}):
            continue
        name = name_of(model, "body", body)
        own = facts["body", name]
        if any(model.jnt_pos[joint]):
            facts["frame", f"{name}_origin"] = {"body": name, "pose": own["pose"], **MADE}
            own["pose"] = (*facts[subject]["anchor"], *own["pose"][3:])  # type: ignore[misc, index] # numbers


def _renamed(facts: Subjects, names: Mapping[str, str], bodies: set[str]) -> Subjects:
    """Names of ours. bodies: those of the robot; a site of such a name has another."""
    sites = {name: f"{name}_site" for kind, name in facts if kind == "frame" and name in bodies}
    found: Subjects = {}
    for (kind, name), own in facts.items():
        other = {"body": names, "frame": sites}.get(kind, {})
        changed = {quantity: _said(value, names, sites) for quantity, value in own.items()}
        for quantity in ("body", "parent", "body1", "body2"):
            if quantity in own:
                changed[quantity] = names.get(str(own[quantity]), own[quantity])
        found[kind, other.get(name, name)] = changed
    return found


def _said(value: Value, names: Mapping[str, str], sites: Mapping[str, str]) -> Value:
    """`site head` and the like, or several, with our names."""
    if isinstance(value, tuple):
        return tuple(_said(one, names, sites) for one in value)  # type: ignore[return-value] # alike
    kind, _, name = value.partition(" ") if isinstance(value, str) else ("", "", "")
    known = {"site": sites, "body": names, "frame": names}.get(kind, {})
    return f"{kind} {known[name]}" if name in known else value


# --- what differs ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Compared:
    """counts: [in the source, found here] by kind, of what is compared."""

    different: list[Difference]
    facts: int
    counts: dict[str, list[int]]


def compare(
    source: Side, ours: Side, tree: Tree, stated: frozenset[str], *, rough: bool
) -> Compared:
    """Everything that neither a rule above nor the recipe explains.

    rough: see `ROUGH`.
    """
    wanted, found = expected(source, tree, stated), dict(ours.facts)
    for subject in [subject for subject in found if subject not in wanted]:
        if _is_added(subject, found, stated):
            del found[subject]
    before, after = (_compared(facts, stated) for facts in (wanted, found))
    by = {**EXACT, "length": 1e-6} | ({"tensor": ROUGH, "vector": ROUGH} if rough else {})
    exact = differences(before, after, Precision(by, MESHES.by_quantity))
    loose = differences(before, after, Precision({**by, "pose": SNAPPED}, MESHES.by_quantity))
    snapped, told = source.snapped | ours.snapped, {found.key for found in loose}
    counts = {
        kind: [len(before.names(kind)), len({*before.names(kind)} & {*after.names(kind)})]
        for kind in dict.fromkeys(key.kind for key in before.facts)
    }
    return Compared(
        _as_wholes(
            [d for d in exact if d.key in told or (d.key.kind, d.key.name) not in snapped],
            before,
            after,
        ),
        len({*before.facts, *after.facts}),
        counts,
    )


def _as_wholes(found: list[Difference], before: Table, after: Table) -> list[Difference]:
    """Of what only MJCF has and one file lacks, one difference instead of one for each word."""
    known = [{(key.kind, key.name) for key in table.facts} for table in (before, after)]
    told: dict[tuple[str, str, str], Difference] = {}
    for one in found:
        subject = (one.key.kind, one.key.name)
        absent = [side for side, there in zip(("extra", "missing"), known, strict=True)
                  if one.key.kind in WHOLE and subject not in there]  # fmt: skip
        whole = Difference(Key(*subject, ""), None, None, absent[0]) if absent else one
        told.setdefault((*subject, whole.key.quantity), whole)
    return list(told.values())


def _is_added(subject: tuple[str, str], ours: Subjects, stated: frozenset[str]) -> bool:
    """Whether the recipe, or a rule of the build, adds to what the source has."""
    kind, name = subject
    if kind == "pair":
        bodies = name.split(" ")
        above = {str(ours["body", body]["parent"]) for body in bodies}
        return bool(above & set(bodies)) or "exclude" in stated
    return kind in ("sensor", "frame", "camera") and "senses" in stated


def _compared(facts: Subjects, stated: frozenset[str]) -> Table:
    return Table(
        {
            Key(*subject, quantity): value
            for subject, own in facts.items()
            for quantity, value in own.items()
            if not _is_stated(subject, quantity, own, stated)
        }
    )


def _is_stated(
    subject: tuple[str, str], quantity: str, own: Mapping[str, Value], stated: frozenset[str]
) -> bool:
    """Whether the recipe says it."""
    kind, name = subject
    touches = bool(own.get("mask") or own.get("partners"))
    reasons = {
        "actuators": kind in ("actuator", "keyframe command")
        or quantity == "target"
        or (kind == "joint" and quantity in DRIVE)
        or (kind == "sensor" and str(own.get("object")).startswith("actuator ")),
        "base": (kind, quantity) in BASE or (kind == "joint" and "type" not in own),
        "collision": kind == "pair" or (kind == "shape" and touches),
        "contact": kind == "shape" and quantity in SURFACE,
        "decimated": kind == "shape" and not touches and quantity in MESH,
        f"keyframe {name.split('/')[0]}": kind in ("keyframe", "keyframe command"),
    }
    if kind == "simulation":
        return bool(
            {quantity, quantity.removeprefix("mjcf:")} & {OPTIONS.get(s, s) for s in stated}
        )
    return any(said and reason in stated for reason, said in reasons.items())
