"""What our MJCF must say, from the source's own facts: each change that is meant, by rule.

- Sites of a world that is not the root are scenery; a world that is the root has no mass.
- Positions count from `ref`, and so do the commands of drives that hold positions.
- A body's frame stands in the anchor of its last joint; its old one becomes `<body>_origin`.
- A body without mass and joints becomes a site; one that the recipe merges joins its parent.
- A camera that looks at such a body looks ahead.
- A site with the name of a body is called `<site>_site`; a body `world` has MuJoCo's name.
- Bodies that a joint connects are excluded.
- A loop holds two sites, `<loop>_a` and `<loop>_b`, whatever the source holds together.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from assetbuild.checks.mjcf_source.tables import SURFACE, Side, Subjects, touches
from assetbuild.facts.compare import EXACT, Difference, Precision, differences
from assetbuild.facts.mjcf import MESHES
from assetbuild.facts.reference import pose_value
from assetbuild.facts.surface import Surface
from assetbuild.facts.table import Key, Table, Value, pair_name, pair_of
from assetbuild.robot.inertia import combine, move_inertial
from assetbuild.robot.model import Inertial, Tree
from assetbuild.robot.pose import IDENTITY, Pose, vec3
from assetbuild.simulators.mujoco import Model, body_names, name_of

SNAPPED = 2e-6
"""m or rad: MuJoCo's compiler takes frames of a body that differ by 1e-6 for one, in each file."""
ROUGH = 1e-5
"""MuJoCo before 4.0 diagonalised a `fullinertia` to a relative 3e-6 (measured in 3.11); we take the
source's own numbers."""
MADE: Mapping[str, Value] = {
    "mjcf:group": 4.0, "mjcf:type": (2.0,), "mjcf:size": (0.005,) * 3,
    "mjcf:rgba": (0.5, 0.5, 0.5, 1.0),
}  # fmt: skip
"""A site that the build makes: MuJoCo's usual small sphere in a hidden group."""
DRIVE = frozenset({"model", "kp", "kd", "gear", "effort", "command range", "drive name",
                   "drive parameters", "damping", "friction", "armature",
                   "mjcf:actuatorfrcrange", "mjcf:effort range",
                   "mjcf:dof_dampingpoly"})  # fmt: skip
SOFTNESS = frozenset({"mjcf:solref", "mjcf:solimp"})
"""What an equality has beyond the loop that it holds."""
WHOLE = frozenset({"tendon", "light", "contact pair", "actuator"})
"""Kinds that only MJCF has."""
MESH = frozenset({"area", "volume", "mean corner", "corner moments"})
BASE = frozenset({"base", "base pose"})
OPTIONS = {"ls_iterations": "line search iterations"}
"""Key of a recipe -> quantity, where they differ."""


def expected(side: Side, tree: Tree, stated: frozenset[str]) -> Subjects:
    """Facts of the source as our MJCF must have them. stated: see `MjcfSource`."""
    facts = _robot(side, body_names(tree).get("world", ""))
    for joint, rest in rest_of(side.model).items():
        _count_from(rest, joint, facts)
    for tendon, rest in tendon_rest(side.model).items():
        own = facts["tendon", tendon]
        for quantity in ("mjcf:range", "mjcf:springlength"):
            if isinstance(value := own.get(quantity), tuple):
                own[quantity] = tuple(float(v) - rest for v in value)
    sites = _sites(facts, {body.name for body in tree.bodies})
    facts = {(kind, sites.get(name, name) if kind == "frame" else name): own
             for (kind, name), own in facts.items()}  # fmt: skip
    _move(facts, side.model, tree, merges="merge" in stated)
    return _renamed(facts, body_names(tree), sites)


def rest_of(model: Model) -> dict[str, float]:
    """`ref` of each joint that has one, rad or m."""
    values = {
        name_of(model, "joint", joint): float(model.qpos0[int(model.jnt_qposadr[joint])])
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) in (2, 3)
    }
    return {name: value for name, value in values.items() if value}


def tendon_rest(model: Model) -> dict[str, float]:
    """Length of each fixed tendon whose joints stand at their `ref`, without tendons of 0."""
    import mujoco

    found: dict[str, float] = {}
    for tendon in range(model.ntendon):
        first = int(model.tendon_adr[tendon])
        for wrap in range(first, first + int(model.tendon_num[tendon])):
            if int(model.wrap_type[wrap]) == mujoco.mjtWrap.mjWRAP_JOINT:
                rest = float(model.qpos0[int(model.jnt_qposadr[int(model.wrap_objid[wrap])])])
                name = name_of(model, "tendon", tendon)
                found[name] = found.get(name, 0.0) + rest * float(model.wrap_prm[wrap])
    return {name: length for name, length in found.items() if length}


def _robot(side: Side, world: str) -> Subjects:
    """Facts that may be changed, without scenery. world: the root, where the world is it."""
    facts: Subjects = {}
    for (kind, name), own in side.facts.items():
        if kind != "frame" or own.get("body"):
            weightless = kind == "body" and name == world
            facts[kind, name] = {"parent": "", "mass": 0.0} if weightless else dict(own)
    return facts


def _count_from(rest: float, joint: str, facts: Subjects) -> None:
    own = facts["joint", joint]
    holds, gear = own.get("model") == "pd", own.get("gear", 1.0)
    shifted = [(own, "lower"), (own, "upper")]
    shifted += [(own, "spring reference")] if own.get("stiffness") else []
    shifted += [(own, "command range")] if holds else []
    for (kind, name), pose in facts.items():
        if kind == "keyframe" and name.endswith(f"/{joint}"):
            shifted += [(pose, "position"), *([(pose, "target")] if holds else [])]
    for some, quantity in shifted:
        value = some.get(quantity)
        commands = quantity in ("command range", "target")  # which count in the drive's gear
        by = rest * float(gear) if commands and isinstance(gear, float) else rest
        if isinstance(value, tuple):
            some[quantity] = tuple(float(v) - by for v in value)
        elif value is not None:
            some[quantity] = float(value) - by
    if isinstance(law := own.get("drive parameters"), str) and isinstance(gear, float):
        own["drive parameters"] = _law_from(rest * gear, law)


def _law_from(rest: float, law: str) -> str:
    """A gain and a bias that are affine in a position, which counts from `rest`."""
    *kinds, dyn, gain, bias = json.loads(law)
    for kind, prm in zip(kinds[1:], (gain, bias), strict=True):
        prm[0] = float(f"{prm[0] + prm[1] * rest:.15g}") if kind == "affine" else prm[0]
    return json.dumps([*kinds, dyn, gain, bias])


# --- frames of bodies -----------------------------------------------------------------------


def _move(facts: Subjects, model: Model, tree: Tree, *, merges: bool) -> None:
    """Everything into the bodies and frames of ours."""
    kept = {body.name for body in tree.bodies} | set(body_names(tree).values())
    frames = {frame.name for frame in tree.frames}
    into, X_new_old = {"": ""}, {"": IDENTITY}
    made: Subjects = {}
    solid = {str(own["body"]) for (kind, _), own in facts.items()
             if kind == "shape" and own.get("body") and touches(own)}  # fmt: skip
    for name in [name for kind, name in facts if kind == "body"]:  # a parent before its children
        own, index = facts["body", name], model.body(name).id
        parent, joints = str(own["parent"]), int(model.body_jntnum[index])
        X_parent_body = X_new_old[parent] @ _pose(own["pose"]) if parent else IDENTITY
        if parent and not joints and name not in kept and (merges or not own["mass"]):
            into[name], X_new_old[name] = into[parent], X_parent_body
            above = facts["body", into[name]]
            above |= _together(above, _moved(facts.pop(("body", name)), X_parent_body))
            if name in frames or not merges:
                made["frame", name] = {"body": into[name], "pose": pose_value(X_parent_body)}
            continue
        last = int(model.body_jntadr[index]) + joints - 1
        anchor = Pose(vec3(model.jnt_pos[last])) if parent and joints else IDENTITY
        into[name], X_new_old[name] = name, anchor.inverse()
        if any(anchor.xyz):
            made["frame", f"{name}_origin"] = {"body": name, "pose": pose_value(anchor.inverse())}
        own |= _moved({q: v for q, v in own.items() if q != "pose"}, X_new_old[name])
        if parent:
            own |= {"parent": into[parent], "pose": pose_value(X_parent_body @ anchor)}
    for (kind, _), own in facts.items():
        if kind == "loop":
            _move_loop(own, into, X_new_old, facts["robot", ""].get("base pose"), tree.root)
            continue
        if "mjcf:weld pose" in own:
            first, second = (X_new_old[str(own[f"body{side}"])] for side in (1, 2))
            X = first @ _pose(own["mjcf:weld pose"]) @ second.inverse()
            own["mjcf:weld pose"] = pose_value(X)
        watched = own.get("mjcf:targetbody")
        if kind == "camera" and watched and into.get(str(watched)) != watched:
            own |= {"mjcf:targetbody": None, "tracking": "fixed"}  # `mjcf.dropped` says so
        for side in ("", "1", "2"):
            if kind != "body" and isinstance(body := own.get(f"body{side}"), str):
                own |= _moved(own, X_new_old[body], side) | {f"body{side}": into[body]}
        if kind == "joint" and "parent" in own:
            own["parent"] = into[str(own["parent"])]
    facts |= {subject: {**own, **MADE} for subject, own in made.items()}
    _join_pairs(facts, into, solid)


def _join_pairs(facts: Subjects, into: Mapping[str, str], solid: set[str]) -> None:
    """Two bodies pass where all pass that became one with them. solid: bodies that can touch."""
    if all(into[body] == body for body in solid):
        return
    apart = {name for kind, name in facts if kind == "pair"}
    for name in apart:
        del facts["pair", name]
    parts: dict[str, list[str]] = {}
    for body in solid:
        parts.setdefault(into[body], []).append(body)
    for first, second in combinations(sorted(parts), 2):
        pairs = product(parts[first], parts[second])
        if all(pair_name(*pair) in apart for pair in pairs):
            facts["pair", pair_name(first, second)] = {"filtered": True}


def _move_loop(
    own: dict[str, Value],
    into: Mapping[str, str],
    X_new_old: Mapping[str, Pose],
    base: Value,
    root: str,
) -> None:
    """What is held to the world of a fixed robot is held to its root. base: X_world_root."""
    for side in "ab":
        body = str(own[f"body {side}"])
        X = X_new_old[body] @ _pose(own[f"end {side}"])
        if not body and base and root in into:
            body, X = root, X_new_old[root] @ _pose(base).inverse() @ X
        own[f"body {side}"] = into[body]
        own[f"end {side}"] = pose_value(X if own["type"] == "weld" else Pose(X.xyz))


def _moved(own: Mapping[str, Value], X: Pose, side: str = "") -> dict[str, Value]:
    """Facts in the old frame of a body, in the new one. X: the old frame in the new."""
    found: dict[str, Value] = dict(own)
    for name, value in own.items():
        if name in {"": ("anchor", "mjcf:pos")}.get(side, (f"mjcf:anchor{side}",)):
            found[name] = tuple(X.apply(value).tolist())  # type: ignore[arg-type] # three numbers
        elif name in ("axis", "mjcf:dir") and not side:
            found[name] = tuple((X.rotation @ np.array(value)).tolist())
        elif name == "pose":
            found[name] = pose_value(X @ _pose(value))
        elif name == "inertia":
            there = move_inertial(_inertial(own), X)
            found |= {"centre of mass": there.com_m, name: there.inertia_com_kg_m2}
        elif name == "corner moments":
            surface = Surface(0, 0.0, 0.0, own["mean corner"], value)  # type: ignore[arg-type] # numbers
            found |= {q: surface.moved(X).facts()[q] for q in ("mean corner", name)}
    return found


def _pose(value: Value) -> Pose:
    x, y, z, *quat = value  # type: ignore[misc, str-unpack] # seven numbers
    return Pose((x, y, z), tuple(quat))  # type: ignore[arg-type] # as above


def _inertial(own: Mapping[str, Value]) -> Inertial:
    return Inertial(own["mass"], own["centre of mass"], own["inertia"])  # type: ignore[arg-type] # numbers


def _together(*bodies: Mapping[str, Value]) -> dict[str, Value]:
    """Mass properties of bodies in one frame."""
    parts = [_inertial(own) for own in bodies if own["mass"]]
    if not parts:
        return {}
    whole = combine(parts)
    return {"mass": whole.mass_kg, "centre of mass": whole.com_m,
            "inertia": whole.inertia_com_kg_m2}  # fmt: skip


def _sites(facts: Subjects, bodies: set[str]) -> dict[str, str]:
    """New names of sites that are called as a body of the source or of the robot."""
    taken = bodies | {name for kind, name in facts if kind == "body"}
    sites = {}
    for old in [name for kind, name in facts if kind == "frame"]:
        name = old
        while name in taken:
            name += "_site"
        taken.add(name)
        sites[old] = name
    return sites


def _renamed(facts: Subjects, names: Mapping[str, str], sites: Mapping[str, str]) -> Subjects:
    """With the names of ours wherever a fact names something."""
    kinds = {"site": sites, "body": names, "frame": names}

    def said(value: Value) -> Value:
        """`site head` and the like, or several."""
        if isinstance(value, tuple):
            return tuple(said(one) for one in value)  # type: ignore[return-value] # alike
        kind, _, name = value.partition(" ") if isinstance(value, str) else ("", "", "")
        known = kinds.get(kind, {})
        return f"{kind} {known[name]}" if name in known else value

    return {
        subject: {quantity: said(value) for quantity, value in own.items()}
        for subject, own in facts.items()
    }


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
    """Everything that neither a rule above nor the recipe explains. rough: see `ROUGH`."""
    wanted = expected(source, tree, stated)
    here = {
        subject: own
        for subject, own in ours.facts.items()
        if subject in wanted or not _is_added(*subject, ours.facts, stated)
    }
    before, after = (_table(facts, stated) for facts in (wanted, here))
    by = {**EXACT, "length": 1e-6} | ({"tensor": ROUGH, "vector": ROUGH} if rough else {})
    poses = {("shape", "pose"): SNAPPED, ("frame", "pose"): SNAPPED}
    found = differences(before, after, Precision(by, {**MESHES.by_quantity, **poses}))
    # How many triangles keep an area depends on rounding; area and moments tell all that have one.
    found = [one for one in found if one.key.quantity != "triangles"]
    counts = {
        kind: [len(before.names(kind)), len({*before.names(kind)} & {*after.names(kind)})]
        for kind in dict.fromkeys(key.kind for key in before.facts)
    }
    wholes = _as_wholes(found, before, after)
    return Compared(wholes, len({*before.facts, *after.facts}), counts)


def _as_wholes(found: list[Difference], before: Table, after: Table) -> list[Difference]:
    """Report an element that one file lacks as one difference instead of one for each word."""
    told: dict[Key, Difference] = {}
    for one in found:
        for table, lack in ((before, "extra"), (after, "missing")):
            if one.key.kind in WHOLE and one.key.name not in table.names(one.key.kind):
                one = Difference(one.key._replace(quantity=""), None, None, lack)  # in its place
        told.setdefault(one.key, one)
    return list(told.values())


def _is_added(kind: str, name: str, ours: Subjects, stated: frozenset[str]) -> bool:
    """Whether the recipe, or a rule of the build, adds to what the source has."""
    if kind == "pair":
        bodies = set(pair_of(name))
        above = {str(ours["body", body]["parent"]) for body in bodies}
        return bool(above & bodies) or "exclude" in stated
    if kind == "loop" and "loops" in stated:
        return True
    loops = {loop for other, loop in ours if other == "loop"}
    if kind == "frame" and name.rstrip("_")[-2:] in ("_a", "_b"):  # a site at the end of a loop
        return name.rstrip("_")[:-2] in loops
    return kind in ("sensor", "frame", "camera") and "senses" in stated


def _table(facts: Subjects, stated: frozenset[str]) -> Table:
    """What the recipe does not say."""
    return Table(
        {
            Key(*subject, quantity): value
            for subject, own in facts.items()
            for quantity, value in own.items()
            if not _is_stated(*subject, quantity, own, stated)
        }
    )


def _is_stated(
    kind: str, name: str, quantity: str, own: dict[str, Value], stated: frozenset[str]
) -> bool:
    """Whether the recipe says it."""
    shape, drive = kind == "shape", kind == "joint" and quantity in DRIVE
    commands = kind == "keyframe" and quantity in ("target", "mjcf:command")
    watches = kind == "sensor" and str(own.get("object")).startswith("actuator ")
    free = kind == "joint" and "type" not in own
    root = kind == "body" and quantity == "pose" and not own.get("parent")
    if root and any(word.startswith("keyframe ") for word in stated):
        return True  # a floating robot starts where the first keyframe has it
    if kind == "simulation":
        return bool(
            {quantity, quantity.removeprefix("mjcf:")} & {OPTIONS.get(s, s) for s in stated}
        )
    reasons = {
        "actuators": kind == "actuator" or drive or commands or watches,
        "base": quantity in BASE or free or root,
        "collision": kind == "pair" or (shape and touches(own)),
        "merge": kind == "pair",
        "loops": kind == "loop" or (kind == "equality" and own.keys() <= SOFTNESS),
        "contact": shape and quantity.removeprefix("mjcf:") in SURFACE,
        "decimated": shape and not touches(own) and quantity in MESH,
        f"keyframe {name.split('/')[0]}": kind == "keyframe",
        f"commands {name.split('/')[0]}": commands,
    }
    return any(said and reason in stated for reason, said in reasons.items())
