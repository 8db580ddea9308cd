"""OpenUSD: a layered asset that Isaac Lab spawns and PhysX simulates, with usd-core alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Self

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.kinds import Target
from assetbuild.recipe.models import Recipe
from assetbuild.recipe.usd import Usd as Options
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Control, Shapes, Tree
from assetbuild.robot.tree import forward_kinematics
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
from assetbuild.targets.usd.names import PrimPaths
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

    options: Options = Options.model_validate({})
    """The recipe's `usd`."""

    @classmethod
    def configure(cls, recipe: Recipe) -> Self:
        """With what the recipe says under `usd`."""
        return cls(robot=recipe.robot, options=recipe.usd)

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes the layers from the inside out, so that each finds what it refers to."""
        tree = decode(Tree, (files.inputs / "tree.json").read_bytes())
        shapes = decode(Shapes, (files.inputs / "shapes.json").read_bytes())
        control = decode(Control, (files.inputs / "control.json").read_bytes())
        meshes = files.inputs / "meshes"
        names = PrimPaths.of(self.robot, tree, shapes)
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
        self, folder: Path, names: PrimPaths, tree: Tree, shapes: Shapes, control: Control
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
