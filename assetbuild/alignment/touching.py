"""Which bodies of the robot may touch one another in MuJoCo, and which in Newton's solver."""

from __future__ import annotations

from collections.abc import Iterable

from assetbuild.alignment.row import Row
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.pairs import explicit_pairs, touching_geoms

SHOWN = 3
Pairs = set[frozenset[str]]
"""A pair of bodies, by name."""


def touching_in_mujoco(model: mujoco.Model, tree: Tree) -> Pairs:
    """Pairs of bodies that may touch by masks, excludes and MuJoCo's own filter, or by `<pair>`."""
    pairs = (*touching_geoms(model), *explicit_pairs(model))
    return _named(model, pairs, tree)


def touching_row(model: mujoco.Model, newton: mujoco.Model, tree: Tree) -> Row:
    """Off: number of pairs of bodies that may touch in one engine alone.

    A contact that only one engine has is an error, but for those that Newton cannot have: between
    the two bodies of a joint, and where an MJCF asks for it by a `<pair>`.
    """
    ours, theirs = (touching_in_mujoco(each, tree) for each in (model, newton))
    asked = _named(model, explicit_pairs(model), tree)
    jointed = {frozenset((joint.parent, joint.child)) for joint in tree.joints}
    here, there = ours - theirs, theirs - ours
    impossible = not there and here <= jointed | asked
    return Row(
        "self_collision",
        "HIGH",
        "robot",
        _told(ours, here),
        _told(theirs, there),
        float(len(here) + len(there)),
        0.0,
        0.5,
        "pairs",
        because="Newton has no contacts between the bodies of a joint, nor `<pair>`"
        if impossible
        else "",
        advice="`collision.exclude.adjacent: true` lets both engines ignore them",
    )


def _named(model: mujoco.Model, pairs: Iterable[tuple[int, int]], tree: Tree) -> Pairs:
    names = {name: body for body, name in mujoco.body_names(tree).items()}
    named_pairs: Pairs = set()
    for pair in pairs:
        bodies = [int(model.geom_bodyid[geom]) for geom in pair]
        if all(bodies):  # 0 is the world
            body_names = (mujoco.name_of(model, "body", body) for body in bodies)
            named_pairs.add(frozenset(names.get(name, name) for name in body_names))
    return named_pairs


def _told(pairs: Pairs, alone: Pairs) -> str:
    listed = [" and ".join(f"`{name}`" for name in sorted(pair)) for pair in alone]
    more = f", and {len(listed) - SHOWN} more" if len(listed) > SHOWN else ""
    only = f" (here alone: {', '.join(sorted(listed)[:SHOWN])}{more})" if listed else ""
    return f"{len(pairs)} pairs of bodies may touch{only}"
