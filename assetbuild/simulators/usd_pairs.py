"""Which colliders of a USD stage PhysX never lets touch each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations, product
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pxr import Usd

Pair = frozenset[str]
"""Paths of two colliders."""


def colliders(stage: Usd.Stage) -> dict[str, str]:
    """Path of the rigid body by path of each enabled collider; "" for one that stands still."""
    from pxr import UsdPhysics

    found = {}
    for prim in stage.Traverse():
        if not prim.HasAPI(UsdPhysics.CollisionAPI):
            continue
        if UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is False:
            continue
        body = prim
        while body and not body.HasAPI(UsdPhysics.RigidBodyAPI):
            body = body.GetParent()
        found[str(prim.GetPath())] = str(body.GetPath()) if body else ""
    return found


def apart(stage: Usd.Stage) -> set[Pair]:
    """Colliders of different bodies that a joint or a filtered pair keeps apart."""
    from pxr import UsdPhysics

    owners = colliders(stage)
    found: set[Pair] = set()
    for prim in stage.Traverse():
        for targets in _kept_apart(prim):
            for one, other in targets:
                sides = _speaks_for(stage, one, owners), _speaks_for(stage, other, owners)
                found |= {frozenset(pair) for pair in product(*sides)}
        if prim.IsA(UsdPhysics.Joint):
            found |= _jointed(prim, owners)
    return {pair for pair in found if len({owners[path] for path in pair}) == 2}


def touching(stage: Usd.Stage) -> set[Pair]:
    """Colliders of different moving bodies that may touch; none without self-collisions."""
    name = "physxArticulation:enabledSelfCollisions"
    said = [prim.GetAttribute(name).Get() for prim in stage.Traverse() if prim.HasAttribute(name)]
    if said == [False]:  # unwritten, PhysX switches them on
        return set()
    owners = {path: body for path, body in colliders(stage).items() if body}
    pairs = {frozenset(pair) for pair in combinations(owners, 2)}
    return {pair for pair in pairs if len({owners[path] for path in pair}) == 2} - apart(stage)


def _kept_apart(prim: Usd.Prim) -> Iterator[list[tuple[str, str]]]:
    relationship = prim.GetRelationship("physics:filteredPairs")
    if relationship:
        yield [(str(prim.GetPath()), str(target)) for target in relationship.GetTargets()]


def _jointed(joint: Usd.Prim, owners: Mapping[str, str]) -> set[Pair]:
    from pxr import UsdPhysics

    physics = UsdPhysics.Joint(joint)
    ends = [rel.GetTargets() for rel in (physics.GetBody0Rel(), physics.GetBody1Rel())]
    # Links of an articulation never touch their parent, whatever `collisionEnabled` says.
    loose = physics.GetExcludeFromArticulationAttr().Get()
    if not all(ends) or (loose and physics.GetCollisionEnabledAttr().Get()):
        return set()
    sides: list[Iterable[str]] = [
        [path for path, body in owners.items() if body == str(targets[0])] for targets in ends
    ]
    return {frozenset(pair) for pair in product(*sides)}


def _speaks_for(stage: Usd.Stage, path: str, owners: Mapping[str, str]) -> list[str]:
    """The colliders that a filtered pair with this prim covers."""
    from pxr import UsdPhysics

    if path in owners:
        return [path]
    if stage.GetPrimAtPath(path).HasAPI(UsdPhysics.ArticulationRootAPI):
        return list(owners)  # it stands for the whole articulation
    return [
        collider
        for collider, body in owners.items()
        if body == path or collider.startswith(f"{path}/")
    ]
