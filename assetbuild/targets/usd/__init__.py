"""OpenUSD: a layered asset that Isaac Lab spawns and PhysX simulates, with usd-core alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.kinds import Robot, Target, read_robot
from assetbuild.robot.kinematics import forward_kinematics
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.targets.usd.bodies import apply_rigid_bodies, write_base
from assetbuild.targets.usd.colliders import apply_filtered_pairs, define_colliders
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
from assetbuild.targets.usd.scene import SCENE, home_poses, write_scene
from assetbuild.targets.usd.unsupported import unsupported


class Usd(Target):
    """`usd/<robot>.usda`, `usd/payloads/...` and `usd/scene.usda`."""

    outputs = ("usd/",)
    tools: ClassVar[tuple[str, ...]] = ("usd-core",)
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = (
        "pxr.Usd",
        "pxr.UsdGeom",
        "pxr.UsdLux",
        "pxr.UsdPhysics",
        "pxr.UsdShade",
    )

    self_collisions: bool = True
    """Bodies of the robot collide with one another, but for excluded pairs; MuJoCo's way."""
    solver_position_iterations: int = Field(8, ge=1, le=255)
    """Of PhysX's articulation solver."""
    solver_velocity_iterations: int = Field(1, ge=0, le=255)
    """Of PhysX's articulation solver."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes the layers from the inside out, so that each finds what it refers to."""
        robot = read_robot(files)
        names = Names.of(self.robot, robot.tree, robot.shapes)
        X_world_root = _root_at_origin(robot)
        folder = files.outputs / "usd"
        payloads = folder / PAYLOADS
        with plain_environment():
            write_library(payloads, names, robot.shapes, robot.mesh_dir)
            write_materials(payloads, names, robot.shapes, robot.mesh_dir)
            write_instances(payloads, names, robot.shapes)
            poses = {
                body: X_world_root @ X_root_body
                for body, X_root_body in forward_kinematics(robot.tree, {}).items()
            }
            write_base(payloads, names, self.robot, robot.tree, poses)
            yield from self._write_physics(payloads, names, robot, X_world_root)
            main = f"{self.robot}.usda"
            write_interface(folder / main, names)
            if main != SCENE:
                home = home_poses(robot.tree, robot.control, X_world_root)
                write_scene(folder, main, names, robot.control, home)
        yield from names.findings(self.robot)
        yield from unsupported(robot.tree, robot.control)

    def _write_physics(
        self, folder: Path, names: Names, robot: Robot, X_world_root: Pose
    ) -> Iterator[Finding]:
        """`physics.usda`: what the variant `physics` adds to the robot."""
        stage = new_layer(folder / "physics.usda", names)
        yield from apply_rigid_bodies(stage, names, robot.tree)
        yield from define_colliders(stage, names, robot.shapes, robot.control.contact)
        define_joints(stage, names, robot.tree, robot.control)
        apply_articulation(
            stage,
            names,
            robot.tree,
            X_world_root,
            self_collisions=self.self_collisions,
            iterations=(self.solver_position_iterations, self.solver_velocity_iterations),
        )
        apply_filtered_pairs(stage, names, robot.tree, robot.shapes, robot.control)
        save(stage)


def _root_at_origin(robot: Robot) -> Pose:
    """X_world_root at q = 0. A floating base starts in the origin.

    A fixed one stands where the source's root link lies in the origin, which is not its own frame
    when that link was an empty placeholder.
    """
    if robot.tree.base == "floating":
        return IDENTITY
    _, X_root_link = robot.tree.placement(robot.links.root)
    return X_root_link.inverse()
