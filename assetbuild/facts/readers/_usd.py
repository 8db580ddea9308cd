"""`usd/<robot>.usda` as it composes with its default variants, and `usd/scene.usda` around it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from assetbuild.facts.compare import FLOAT32, Precision
from assetbuild.facts.derived import start_of
from assetbuild.facts.reader import Lost, Reader, all_but
from assetbuild.facts.reference import Reference, pose_value, robot_table, simulation_values
from assetbuild.facts.table import Table, Value
from assetbuild.facts.vocabulary import MUJOCO_OPTIONS
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import RecipeView
from assetbuild.robot.floor import floor_of
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.tree import forward_kinematics

if TYPE_CHECKING:
    from assetbuild.facts.usd_prims import Places, Prim

_OUTSIDE = (
    "the controller that computes it runs outside of the simulator: see the trainers' modules"
)
_BITS = "USD has no masks: `collides` and filtered pairs say what they mean"
_SPRING = "a spring is the drive of its joint (kp, drive target), or `usd.spring` is reported"


IGNORED = Rule(
    "usd.ignored",
    "info",
    "a USD tells an engine something that assetbuild does not read",
    "if it moves or weighs the robot, give it in a way that is read: a mass for a density",
)


ENGINES = ("physics:", "physx", "newton:", "mjc:", "drive:")
OURS = re.compile(
    r"usd:((physx(Articulation|RigidBody|ConvexHullCollision)|newton|mjc|drive):.*"
    r"|physics:approximation)"
)
"""Words of engines that our own files state, too."""


def ignored_words(table: Table) -> Iterator[Finding]:
    """One finding for all of a file."""
    words = {key.quantity for key in table.facts if not OURS.fullmatch(key.quantity)}
    stated = {word.removeprefix("usd:") for word in words if word.startswith("usd:")}
    names = tuple(sorted(word for word in stated if word.startswith(ENGINES)))
    if names:
        listed = ", ".join(f"`{name}`" for name in names)
        yield IGNORED("robot", f"not read: {listed}", data={"attributes": names})


class UsdReader(Reader):
    """What the composed stage says to the engines that simulate it."""

    own_name = "usd"
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    preload = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")
    format_id: ClassVar[str] = "usd"
    display_name: ClassVar[str] = "the USD"
    folder: ClassVar[str] = "usd"
    file_globs: ClassVar[tuple[str, ...]] = ("usd/{robot}.usda", "usd/payloads/*")
    suffixes: ClassVar[tuple[str, ...]] = (".usd", ".usda", ".usdc", ".usdz")
    recipe_sections: ClassVar[tuple[str, ...]] = ("usd",)
    # Transforms and sizes are double precision.
    precision: ClassVar[Precision] = Precision(
        FLOAT32,
        {
            ("body", "pose"): 1e-9,
            ("frame", "pose"): 1e-9,
            ("camera", "pose"): 1e-9,
            ("shape", "pose"): 1e-9,
            ("shape", "size"): 1e-9,
            ("robot", "base pose"): 1e-9,
        },
        # USD turns by the arc cosine of w, which loses up to 3e-8 rad of a small turn.
        turn=1e-7,
    )
    lacks: ClassVar[Mapping[str, str]] = {
        "joint model": _OUTSIDE,
        "joint gear": _OUTSIDE,
        "joint stall": _OUTSIDE,
        "joint command range": _OUTSIDE,
        "joint drive parameters": _OUTSIDE,
        "joint delay": _OUTSIDE,
        "joint drive name": "a drive is part of its joint and has no name",
        "joint stiffness": _SPRING,
        "joint spring reference": _SPRING,
        "shape contype": _BITS,
        "shape conaffinity": _BITS,
        "sensor": Lost("UsdPhysics has none; simulators add their own"),
        "camera resolution": "what renders decides it; the shape of the picture is compared",
        "camera tracking": Lost("a camera of USD is fixed to what carries it"),
        "keyframe base pose": "a pose of Isaac Sim's schema has none",
        "keyframe target": "a pose of Isaac Sim's schema has positions alone",
        "robot start pose": "`scene.usda` has it",
        "simulation": "`scene.usda` says it",
        "floor": "`scene.usda` has it",
    }

    def read(self, path: Path) -> Table:
        """Read any USD; UsageError where it does not open, or names no default prim."""
        from assetbuild.facts.usd_robot import read_robot

        return read_robot(path)

    def expected(self, reference: Reference) -> Table:
        """The robot as USD can hold it, with the words of the format."""
        from assetbuild.facts.usd_expected import usd_table

        reference = replace(reference, shapes=reference.shapes.all_coloured)
        return usd_table(robot_table(reference).only(self.holds), reference)


CLEARANCE_M = 1e-3
"""The soles start a millimetre above the floor: PhysX throws out what starts inside of it."""


class UsdSceneReader(Reader):
    """What the scene adds to the robot's own file: floor, gravity, the rate, where it starts."""

    own_name = "usd_scene"
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    preload = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")
    format_id: ClassVar[str] = "usd_scene"
    display_name: ClassVar[str] = "the USD scene"
    folder: ClassVar[str] = "usd"
    file_globs: ClassVar[tuple[str, ...]] = ("usd/scene.usda",)
    precision: ClassVar[Precision] = Precision(FLOAT32)
    lacks: ClassVar[Mapping[str, str]] = {
        **all_but(
            ("robot up axis", "robot metres per unit", "robot kilograms per unit", "simulation",
             "floor"),
            "the scene refers to the robot's own file, which is compared by itself",
        ),
        "simulation decimation": "the trainers' modules say it",
        **dict.fromkeys(MUJOCO_OPTIONS, "MuJoCo's own"),
    }  # fmt: skip

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """None for a robot that is called as the scene: it has none."""
        return super().values(recipe) if recipe.value("robot") != "scene" else None

    def file(self, root: Path, robot: str) -> Path | None:
        """`scene.usda`; a robot of that name has none."""
        return super().file(root, robot) if robot != "scene" else None

    def read(self, path: Path) -> Table:
        """The facts of the scene; a prim that refers to another file is the robot.

        UsageError where it does not open.
        """
        from pxr import Usd

        from assetbuild.facts.usd_prims import Places, Prim, opened, units_of

        with opened(path) as stage:
            facts = Table()
            places = Places(units_of(stage, facts))
            for each in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
                prim = Prim(each)
                if prim.type == "PhysicsScene":
                    facts.put("simulation", "", _simulation(prim, places))
                elif prim.type == "Plane":
                    facts.place("floor", "", prim.path)
                    facts.put("floor", "", _floor(prim, places))
                elif prim.type == "DomeLight":
                    facts.put("light", "", {"usd:intensity": prim.number("inputs:intensity")})
                elif prim.has("PhysicsRigidBodyAPI"):
                    pose, _ = places.rigid(each)
                    name = prim.named("start", facts)
                    facts.put("start", name, {"usd:initial pose": pose_value(pose)})
            return facts

    def expected(self, reference: Reference) -> Table:
        """Gravity and rate of the recipe, the robot in its initial pose on the floor."""
        tree, control, facts = reference.tree, reference.control, Table()
        facts.put("robot", "", {
            "up axis": "Z", "metres per unit": 1.0, "kilograms per unit": 1.0,
        })  # fmt: skip
        simulation, ground = simulation_values(control), floor_of(tree, control)
        simulation["timestep"] = 1.0 / round(1.0 / control.simulation.timestep)  # whole steps per s
        held = {key: v for key, v in simulation.items() if f"simulation {key}" not in self.lacks}
        facts.put("simulation", "", held)
        facts.put("floor", "", {
            "height": ground.height_m,
            "friction": ground.friction,
            "usd:axis": "Z",
            "usd:size": (20.0, 20.0),
            "usd:collides": True,
            "usd:dynamicFriction": ground.friction[0],
            "usd:frictionCombineMode": "max",  # the rougher of two surfaces decides, as in MuJoCo
            "restitution": 0.0,
        })  # fmt: skip
        facts.put("light", "", {"usd:intensity": 1000.0})
        start, initial = tree.X_world_root, start_of(tree, control)
        if tree.base == "floating":
            base = initial.base
            start = IDENTITY if base is None else Pose((0.0, 0.0, CLEARANCE_M)) @ base
        for body, pose in forward_kinematics(tree, dict(initial.joints)).items():
            facts.put("start", body, {"usd:initial pose": pose_value(start @ pose)})
        return facts


def _simulation(prim: Prim, places: Places) -> dict[str, Value]:
    """UsdPhysics: without a direction down, without a magnitude that of the earth."""
    direction = np.array(prim.numbers("physics:gravityDirection") or (0.0, 0.0, -1.0))
    magnitude = prim.number("physics:gravityMagnitude", unit=places.units.metre)
    strength = 9.81 if magnitude is None or magnitude < 0.0 else magnitude
    gravity = direction / (np.linalg.norm(direction) or 1.0) * strength
    rate = prim.number("physxScene:timeStepsPerSecond", "PhysxSceneAPI")
    return {"gravity": tuple(gravity.tolist()), "timestep": 1.0 / rate if rate else None}


def _floor(prim: Prim, places: Places) -> dict[str, Value]:
    from assetbuild.facts.usd_shapes import surface_of

    pose, _ = places.rigid(prim.prim)
    solid = prim.has("PhysicsCollisionAPI")
    facts: dict[str, Value] = {
        "height": pose.xyz[2],
        "friction": None,
        "usd:axis": prim.text("axis") or "Z",
        "usd:size": tuple(
            prim.number(side, unit=places.units.metre) or 0.0 for side in ("width", "length")
        ),
        "usd:collides": solid and prim.flag("physics:collisionEnabled") is not False,
    }
    return facts | surface_of(prim.prim)
