"""What only USD and PhysX know of: `usd` in a recipe."""

from __future__ import annotations

from collections.abc import Sized
from typing import Literal, Self

from pydantic import Field

from assetbuild.recipe_types import Model, NonNegative, Positive


class UsdRigidBody(Model):
    """What PhysX adds to every body. Isaac Lab calls them RigidBodyPropertiesCfg."""

    linear_damping: NonNegative = Field(0.0, description="1/s; MuJoCo has none")
    angular_damping: NonNegative = Field(
        0.0, description="1/s; unwritten, PhysX would take 0.05; MuJoCo has none"
    )
    max_linear_velocity: Positive = Field(1000.0, description="m/s; faster is cut off")
    max_angular_velocity: Positive = Field(
        1000.0, description="rad/s; faster is cut off; unwritten, PhysX would take 100"
    )
    max_depenetration_velocity: Positive = Field(
        1.0,
        description="m/s; how fast bodies that start inside of one another are driven apart: "
        "PhysX uses all of it in one step, however little they overlap",
    )


RobotType = Literal[
    "End Effector",
    "Manipulator",
    "Humanoid",
    "Wheeled",
    "Holonomic",
    "Quadruped",
    "Mobile Manipulators",
    "Aerial",
]
"""Kinds of robots in Isaac Sim's robot schema."""

OF_TREES, OF_LOOPS = 1, 16
"""Velocity iterations of PhysX's solver: with 4 the two rods of an ankle went to infinity."""


class UsdArticulation(Model):
    """How PhysX solves the robot. Isaac Lab calls them ArticulationRootPropertiesCfg."""

    self_collisions: bool = Field(
        True, description="bodies of the robot collide but for the excluded pairs, as in MuJoCo"
    )
    solver_position_iterations: int = Field(8, ge=1, le=255, description="per step")
    solver_velocity_iterations: int | None = Field(
        None,
        ge=0,
        le=255,
        description="per step; without it 1, and 16 for a robot with loops for their light rods",
    )
    sleep_threshold: NonNegative = Field(0.0, description="m2/s2; 0 = never asleep")
    stabilization_threshold: NonNegative = Field(0.0, description="m2/s2; 0 = no extra damping")

    def solving(self, loops: Sized) -> Self:
        """The options with the velocity iterations that a robot with these loops gets."""
        if self.solver_velocity_iterations is not None:
            return self
        iterations = OF_LOOPS if len(loops) else OF_TREES
        return self.model_copy(update={"solver_velocity_iterations": iterations})


class UsdOptions(Model):
    """What only USD and PhysX know of."""

    instanceable: bool = Field(True, description="meshes are shared between shapes, read-only")
    drive_type: Literal["force", "acceleration"] = Field(
        "force", description="acceleration: gains are per unit of inertia, as no other format has"
    )
    mimics: bool = Field(
        True, description="couple mimic joints; false = they move freely, as Isaac Lab can choose"
    )
    robot_type: RobotType | None = Field(
        None,
        description="`isaac:robotType` of Isaac Sim's robot schema; without it `Default` holds, "
        "which NVIDIA's SimReady does not count as a kind of robot",
    )
    rigid_body: UsdRigidBody = Field(default_factory=lambda: UsdRigidBody.model_validate({}))
    articulation: UsdArticulation = Field(
        default_factory=lambda: UsdArticulation.model_validate({})
    )
