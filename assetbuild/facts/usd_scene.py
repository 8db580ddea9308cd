"""The scene around the robot: gravity, rate, floor, and where each body starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Usd

from assetbuild.facts.reference import pose_value
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.usd_prims import Places, Prim, opened, units_of
from assetbuild.facts.usd_shapes import surface_of


def read_scene(path: Path) -> Table:
    """The facts of the scene; a prim that refers to another file is the robot."""
    with opened(path) as stage:
        book = Writer()
        places = Places(units_of(stage, book))
        for each in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
            prim = Prim(each)
            if prim.type == "PhysicsScene":
                book.put("simulation", "", _simulation(prim, places))
            elif prim.type == "Plane":
                book.place("floor", "", prim.path)
                book.put("floor", "", _floor(prim, places))
            elif prim.has("PhysicsRigidBodyAPI"):
                pose, _ = places.rigid(each)
                name = prim.named("start", book)
                book.put("start", name, {"usd:initial pose": pose_value(pose)})
        return book.table()


def _simulation(prim: Prim, places: Places) -> dict[str, Value]:
    """UsdPhysics: without a direction down, without a magnitude that of the earth."""
    direction = np.array(prim.numbers("physics:gravityDirection") or (0.0, 0.0, -1.0))
    magnitude = prim.number("physics:gravityMagnitude", unit=places.units.metre)
    strength = 9.81 if magnitude is None or magnitude < 0.0 else magnitude
    gravity = direction / (np.linalg.norm(direction) or 1.0) * strength
    rate = prim.number("physxScene:timeStepsPerSecond", "PhysxSceneAPI")
    return {"gravity": tuple(gravity.tolist()), "timestep": 1.0 / rate if rate else None}


def _floor(prim: Prim, places: Places) -> dict[str, Value]:
    pose, _ = places.rigid(prim.prim)
    solid = prim.has("PhysicsCollisionAPI")
    facts: dict[str, Value] = {
        "height": pose.xyz[2],
        "friction": None,
        "usd:axis": prim.text("axis") or "Z",
        "usd:collides": solid and prim.flag("physics:collisionEnabled") is not False,
    }
    return facts | surface_of(prim.prim)
