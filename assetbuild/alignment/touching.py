"""Which bodies of the robot may touch one another in MuJoCo, and which in another engine."""

from __future__ import annotations

from typing import Any

from assetbuild.alignment.row import Row
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco, usd_pairs
from assetbuild.simulators.mujoco.pairs import explicit_pairs, touching_geoms

SHOWN = 3
Pairs = set[frozenset[str]]
"""A pair of bodies, by name."""


def touching_in_usd(stage: Any) -> Pairs:  # Any: Usd.Stage
    """Pairs of bodies that may touch in PhysX."""
    owners = usd_pairs.colliders(stage)
    bodies = {path: _name(stage.GetPrimAtPath(path)) for path in set(owners.values()) if path}
    return {frozenset(bodies[owners[path]] for path in pair) for pair in usd_pairs.touching(stage)}


def touching_row(model: mujoco.Model, theirs: Pairs, tree: Tree, engine: str = "PhysX") -> Row:
    """Off: number of pairs of bodies that may touch in one engine alone.

    A contact that only one engine has is an error, but for those that PhysX and Newton
    cannot have: between
    the two bodies of a joint, and where an MJCF asks for it by a `<pair>`.
    """
    names = {name: body for body, name in mujoco.body_names(tree).items()}
    ours = _named(model, touching_geoms(model), names)
    asked = _named(model, explicit_pairs(model), names)
    jointed = {frozenset((joint.parent, joint.child)) for joint in tree.joints}
    here, there = (ours | asked) - theirs, theirs - (ours | asked)
    impossible = not there and here <= jointed | asked
    return Row(
        "self_collision",
        "HIGH",
        "robot",
        _told(ours | asked, here),
        _told(theirs, there),
        float(len(here) + len(there)),
        0.0,
        0.5,
        "pairs",
        because=f"{engine} has no contacts between the bodies of a joint, nor `<pair>`"
        if impossible
        else "",
        advice="`collision.exclude.adjacent: true` lets both engines ignore them",
    )


def _named(model: mujoco.Model, pairs: Any, names: dict[str, str]) -> Pairs:  # Any: pairs of geoms
    found: Pairs = set()
    for pair in pairs:
        bodies = [int(model.geom_bodyid[geom]) for geom in pair]
        if all(bodies):  # 0 is the world
            said = (mujoco.name_of(model, "body", body) for body in bodies)
            found.add(frozenset(names.get(name, name) for name in said))
    return found


def _told(pairs: Pairs, alone: Pairs) -> str:
    listed = [" and ".join(f"`{name}`" for name in sorted(pair)) for pair in alone]
    more = f", and {len(listed) - SHOWN} more" if len(listed) > SHOWN else ""
    only = f" (here alone: {', '.join(sorted(listed)[:SHOWN])}{more})" if listed else ""
    return f"{len(pairs)} pairs of bodies may touch{only}"


def _name(prim: Any) -> str:  # Any: Usd.Prim
    return str(prim.GetMetadata("displayName") or prim.GetName())
