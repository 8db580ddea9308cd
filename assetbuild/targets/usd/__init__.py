"""OpenUSD: a layered asset that Isaac Lab spawns and PhysX simulates, with usd-core alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.kinds import Target
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Shapes, Tree
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd.bodies import apply_rigid_bodies, write_base
from assetbuild.targets.usd.colliders import (
    apply_filtered_pairs,
    apply_masks,
    define_colliders,
)
from assetbuild.targets.usd.geometry import write_instances, write_library, write_materials
from assetbuild.targets.usd.joints import apply_articulation, define_joints
from assetbuild.targets.usd.layers import (
    PAYLOADS,
    new_layer,
    plain_environment,
    save,
    write_interface,
)
from assetbuild.targets.usd.names import Names
from assetbuild.targets.usd.scene import SCENE, write_scene
from assetbuild.targets.usd.unsupported import unsupported


class Usd(Target):
    """`usd/<robot>.usda`, `usd/payloads/...` and `usd/scene.usda`."""

    version = "5"
    outputs = ("usd/",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "shapes.json", "control.json", "meshes/")
    tools: ClassVar[tuple[str, ...]] = ("usd-core",)
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = (
        "pxr.Usd",
        "pxr.UsdGeom",
        "pxr.UsdPhysics",
        "pxr.UsdShade",
    )

    sections: ClassVar[Mapping[str, str]] = {"usd": "options"}

    options: UsdOptions = UsdOptions()
    """The recipe's `usd`."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes the layers from the inside out, so that each finds what it refers to."""
        robot = RobotFiles(files.inputs)
        tree, shapes, control = robot.tree, robot.shapes, robot.control
        meshes = robot.mesh_dir
        names = Names.of(self.robot, tree, shapes)
        folder = files.outputs / "usd"
        payloads = folder / PAYLOADS
        with plain_environment():
            write_library(payloads, names, shapes, meshes)
            write_materials(payloads, names, shapes, meshes)
            write_instances(payloads, names, shapes, instanceable=self.options.instanceable)
            write_base(payloads, names, self.robot, tree, forward_kinematics(tree, {}))
            yield from self._write_physics(payloads, names, tree, shapes, control)
            main = f"{self.robot}.usda"
            write_interface(folder / main, names)
            if main != SCENE:
                write_scene(folder, main, names, tree, control)
        yield from names.findings(self.robot)
        yield from unsupported(tree, control, self.options)

    def _write_physics(
        self, folder: Path, names: Names, tree: Tree, shapes: Shapes, control: Control
    ) -> Iterator[Finding]:
        """`physics.usda`: what the variant `physics` adds to the robot."""
        stage = new_layer(folder / "physics.usda", names)
        yield from apply_rigid_bodies(stage, names, tree, self.options.rigid_body)
        yield from define_colliders(stage, names, shapes, control)
        define_joints(stage, names, tree, control, self.options)
        apply_articulation(stage, names, tree, self.options.articulation)
        apply_filtered_pairs(stage, names, tree, shapes, control)
        apply_masks(stage, names, tree, shapes, control)
        save(stage)
