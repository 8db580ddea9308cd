"""The layers of the asset, from the inside out, so that each finds what it refers to.

Alone among the modules that the target imports these need USD's library: they are imported late.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from assetbuild.findings import Finding
from assetbuild.robot.lost_motion import whole_gravity
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd.about import Origin, write_metadata
from assetbuild.targets.usd.bodies import apply_rigid_bodies, write_base
from assetbuild.targets.usd.colliders import (
    apply_filtered_pairs,
    apply_masks,
    define_colliders,
    touching_neighbours,
)
from assetbuild.targets.usd.geometry import write_instances, write_library, write_materials
from assetbuild.targets.usd.isaac import apply_robot_schema
from assetbuild.targets.usd.joints import (
    apply_articulation,
    define_actuators,
    define_joints,
    define_loops,
)
from assetbuild.targets.usd.layers import PAYLOADS, new_interface, new_layer, save, save_by_engine
from assetbuild.targets.usd.names import PrimPaths
from assetbuild.targets.usd.scene import SCENE, write_scene
from assetbuild.targets.usd.unsupported import unsupported


def write_asset(
    folder: Path,
    robot: str,
    tree: Tree,
    shapes: Shapes,
    control: Control,
    meshes: Path,
    options: UsdOptions,
    origin: Origin,
) -> Iterator[Finding]:
    """`<robot>.usda`, its payloads and `scene.usda`."""
    shapes = shapes.all_coloured
    names = PrimPaths.of(robot, tree, shapes)
    payloads, main = folder / PAYLOADS, f"{robot}.usda"
    write_library(payloads, names, shapes, meshes)
    write_materials(payloads, names, shapes, meshes)
    write_instances(payloads, names, shapes, instanceable=options.instanceable)
    write_base(payloads, names, robot, control.cameras)
    # What the variants of `Physics` add to the robot.
    stage = new_layer(payloads / "physics.usda", names)
    weightless = whole_gravity(control.mjcf_only)
    yield from apply_rigid_bodies(stage, names, options.rigid_body, weightless)
    yield from define_colliders(stage, names, shapes, control)
    touching = touching_neighbours(names, shapes, control)
    define_joints(stage, names, control, options, touching)
    define_loops(stage, names, control, touching)
    define_actuators(stage, names, control)
    apply_articulation(stage, names, options.articulation.solving(control.loops))
    apply_filtered_pairs(stage, names, shapes, control)
    apply_masks(stage, names, shapes, control)
    apply_robot_schema(stage, names, control, options)
    save_by_engine(stage, payloads, names)
    interface = new_interface(folder / main, names)
    write_metadata(interface, robot, tree, origin)
    save(interface)
    if main != SCENE:
        write_scene(folder, main, names, control)
    yield from names.findings(robot)
    yield from unsupported(tree, control, options)
