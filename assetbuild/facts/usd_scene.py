"""The scene around the robot: what it holds, and what it must hold."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdPhysics, UsdShade

from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.reference import Reference, pose_value
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.usd_inventory import STRENGTH, SURFACE, prim_facts
from assetbuild.facts.usd_looks import Looks, take_bindings
from assetbuild.facts.usd_meshes import extent_text
from assetbuild.facts.usd_prims import LENGTH, PLAIN, Places, Prim, acts, listed
from assetbuild.facts.usd_stage import opened, stage_facts, units_of
from assetbuild.robot.floor import floor_of
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators.usd_names import scene_identifier

FLOOR_M = 20.0
"""Edge of the floor as it is drawn; it collides without end."""
CLEARANCE_M = 1e-3
"""The soles start a millimetre above the floor: PhysX throws out what starts inside of it."""
MOVED = {"xformOp:translate": "double3", "xformOp:orient": "quatd"}
PRIMS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("/World", "Xform", ()),
    ("/World/physics", "PhysicsScene", ("PhysxSceneAPI",)),
    ("/World/floor", "Plane", ("PhysicsCollisionAPI", "MaterialBindingAPI")),
    ("/World/light", "DomeLight", ()),
    ("/World/PhysicsMaterials", "Scope", ()),
    ("/World/PhysicsMaterials/floor", "Material", SURFACE),
)
"""Path, type and applied schemas of each prim of the scene but the robot's."""


def read_scene(path: Path) -> Table:
    """The facts of the scene: of the robot's prims only what the scene says itself."""
    with opened(path) as stage:
        return _read(stage)


def _read(stage: Usd.Stage) -> Table:
    book, units = Writer(), units_of(stage)
    stage_facts(stage, units, book)
    places = Places(units)
    top = stage.GetDefaultPrim()
    book.put("stage", "", {"usd:type": str(top.GetTypeName())})
    prims: list[Prim] = []
    for child in stage.GetPseudoRoot().GetAllChildren():
        prims += _world(child, places, book)
    materials = [p for p in prims if p.prim.IsA(UsdShade.Material)]
    looks = Looks(materials, [], book, KnownFiles())
    for prim in prims:
        if prim.type == "PhysicsScene":
            _physics(prim, places, book)
        elif prim.type == "Plane":
            _floor(prim, places, looks, book)
        elif prim.type.endswith("Light"):
            _light(prim, book)
    looks.unbound()
    for prim in prims:
        prim.placed()
        take_bindings(prim)
        prim.close()
    return book.table()


def _world(prim: Usd.Prim, places: Places, book: Writer) -> list[Prim]:
    """All prims of the scene itself; a prim that refers to another file is the robot."""
    stage = prim.GetStage()
    layers = [layer for layer in stage.GetLayerStack() if not layer.anonymous]
    specs = [spec for layer in layers if (spec := layer.GetPrimAtPath(prim.GetPath()))]
    if any(spec.hasReferences or spec.hasPayloads for spec in specs):
        _robot(prim, specs, places, book)
        return []
    book.facts |= dict(listed(prim))
    if not acts(prim):
        return []
    found = [Prim(prim, book)]
    for child in prim.GetAllChildren():
        found += _world(child, places, book)
    return found


def _robot(prim: Usd.Prim, specs: list[Sdf.PrimSpec], places: Places, book: Writer) -> None:
    files = [
        f"{arc.assetPath}{arc.primPath or ''}"
        for spec in specs
        for arcs in (spec.referenceList, spec.payloadList)
        for arc in arcs.GetAddedOrExplicitItems()
    ]
    book.put("stage", "", {
        "usd:robot": ", ".join(files),
        "usd:robot prim": f"{prim.GetTypeName()} {prim.GetName()}",
    })  # fmt: skip
    bodies = [p for p in Usd.PrimRange(prim) if p.HasAPI(UsdPhysics.RigidBodyAPI)]
    for body in bodies:
        name = str(body.GetMetadata("displayName") or body.GetName())
        pose, scale = places.rigid(body)
        book.place("start", name, str(body.GetPath()))
        book.put("start", name, {"usd:initial pose": pose_value(pose)})
        if not np.allclose(scale, 1.0):
            book.put("start", name, {"usd:scale": tuple(map(float, scale))})
    paths = {body.GetPath() for body in bodies}
    for spec in specs:
        _overs(spec, paths, book, top=True)


def _overs(spec: Sdf.PrimSpec, bodies: set[Sdf.Path], book: Writer, *, top: bool = False) -> None:
    """What the scene says of a prim of the robot: where a body is, and nothing else."""
    arcs = {"references", "payload"} if top else set()
    if not top and spec.path not in bodies:
        book.put("prim", str(spec.path), {"usd:type": "no body of the robot"})
    for key in spec.ListInfoKeys():
        if key not in PLAIN | arcs:
            book.skip(str(spec.path), key, spec.GetInfo(key))
    for found in spec.properties:
        value = getattr(found, "default", found)
        if not (spec.path in bodies and found.name in MOVED):
            book.skip(str(spec.path), found.name, value)
            continue
        kind = str(found.GetInfo("typeName"))
        if kind != MOVED[found.name]:
            said = f"{kind}, where {MOVED[found.name]} is meant"
            book.put("prim", str(spec.path), {f"usd:type of {found.name}": said})
        if isinstance(value, Gf.Quatd) and abs(value.GetLength() - 1.0) > LENGTH:
            length = {f"usd:length of {found.name}": value.GetLength()}
            book.put("prim", str(spec.path), length)
    for child in spec.nameChildren:
        _overs(child, bodies, book)


def _physics(prim: Prim, places: Places, book: Writer) -> None:
    """UsdPhysics: without a direction down, without a magnitude that of the earth."""
    direction = np.array(prim.take("physics:gravityDirection") or (0.0, 0.0, -1.0))
    magnitude = prim.take("physics:gravityMagnitude")
    strength = 9.81 if not isinstance(magnitude, float) or magnitude < 0.0 else magnitude
    unit = 1.0 if strength == 9.81 else places.units.metre
    length = float(np.linalg.norm(direction)) or 1.0
    if abs(length - 1.0) > LENGTH:
        book.put("simulation", "", {"usd:length of gravityDirection": length})
    gravity = direction / length * strength * unit
    rate = prim.number("physxScene:timeStepsPerSecond", "PhysxSceneAPI")
    book.put("simulation", "", {
        "gravity": tuple(float(v) for v in gravity),
        "timestep": 1.0 / rate if rate else None,
        "usd:gravityMagnitude": None if magnitude is None else strength * unit,
    })  # fmt: skip


def _floor(prim: Prim, places: Places, looks: Looks, book: Writer) -> None:
    pose, _ = places.rigid(prim.prim)
    metre = places.units.metre
    width, length = prim.number("width", unit=metre), prim.number("length", unit=metre)
    surface = looks.surface(prim.prim)
    w, h = (width or 0.0) / metre / 2.0, (length or 0.0) / metre / 2.0
    bounds = np.array([(-w, -h, 0.0), (w, h, 0.0)])
    solid = prim.has("PhysicsCollisionAPI")
    facts: dict[str, Value] = {
        "height": pose.xyz[2],
        "friction": surface.pop("friction", None),
        "usd:floor pose": pose_value(pose),
        "usd:axis": prim.text("axis") or "Z",
        "usd:width": width,
        "usd:length": length,
        "usd:extent": extent_text(prim.take("extent"), bounds),
        "usd:collides": solid and prim.flag("physics:collisionEnabled") is not False,
    }
    book.place("floor", "", prim.path)
    book.put("floor", "", facts | {f"usd:{k.removeprefix('usd:')}": v for k, v in surface.items()})


def _light(prim: Prim, book: Writer) -> None:
    name = prim.named("light")
    book.put("light", name, {
        "usd:type": prim.type, "usd:intensity": prim.number("inputs:intensity"),
    })  # fmt: skip


# --- what it must hold -----------------------------------------------------------------------


def scene_table(robot: str, reference: Reference) -> Table:
    """The robot in its initial pose, on a floor that rubs as its least rough surface.

    The larger friction of two surfaces acts, as in MuJoCo. Below a bolted robot that reaches under
    its base the floor is lower: see `robot.floor`.
    """
    book = Writer()
    tree, control = reference.tree, reference.control
    book.put("robot", "", {"up axis": "Z", "metres per unit": 1.0, "kilograms per unit": 1.0})
    book.put("stage", "", {
        "usd:defaultPrim": "World",
        "usd:type": "Xform",
        "usd:robot": f"./{robot}.usda",
        "usd:robot prim": f"Xform {scene_identifier(robot)}",
        "usd:upAxis of layers": ("Z",),
        "usd:metersPerUnit of layers": ("1.0",),
        "usd:kilogramsPerUnit of layers": ("1.0",),
    })  # fmt: skip
    simulation = control.simulation
    book.put("simulation", "", {
        "gravity": tuple(simulation.gravity),
        "timestep": 1.0 / round(1.0 / simulation.timestep),  # USD has whole steps per second
        "usd:gravityMagnitude": math.dist(simulation.gravity, (0.0, 0.0, 0.0)),
    })  # fmt: skip
    ground = floor_of(tree, control)
    book.put("floor", "", {
        "height": ground.height_m,
        "friction": ground.friction,
        "usd:floor pose": pose_value(Pose((0.0, 0.0, ground.height_m))),
        "usd:frictionCombineMode": "max",
        "usd:axis": "Z",
        "usd:width": FLOOR_M,
        "usd:length": FLOOR_M,
        "usd:extent": "its bounds",
        "usd:collides": True,
        "usd:dynamicFriction": ground.friction[0],
        "usd:restitution": 0.0,
        "usd:binding strength": "weakerThanDescendants",
    })  # fmt: skip
    book.put("light", "light", {"usd:type": "DomeLight", "usd:intensity": 1000.0})
    start, initial = tree.X_world_root, initial_pose(tree, control)
    if tree.base == "floating":
        base = initial.base
        start = IDENTITY if base is None else Pose((0.0, 0.0, CLEARANCE_M)) @ base
    for body, pose in forward_kinematics(tree, dict(initial.joints)).items():
        book.put("start", body, {"usd:initial pose": pose_value(start @ pose)})
    book.facts |= {key: value for row in PRIMS for key, value in prim_facts(*row)}
    book.put("prim", "/World/floor", {STRENGTH: "weakerThanDescendants"})
    return book.table()
