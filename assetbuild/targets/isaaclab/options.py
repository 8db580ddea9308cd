"""What a recipe says about the modules for Isaac Lab."""

from __future__ import annotations

from pydantic import Field

from assetbuild.quantities import Model, NonNegative


class IsaacLabOptions(Model):
    """What only Isaac Lab's configuration has."""

    soft_joint_pos_limit_factor: float = Field(
        1.0, gt=0.0, le=1.0, description="share of a joint's range beyond which rewards punish"
    )
    contact_sensors: bool = Field(True, description="`activate_contact_sensors` of the spawner")
    clearance: NonNegative = Field(
        0.001, description="m; how much higher than in its initial keyframe the robot is spawned"
    )
    friction_buckets: int = Field(
        64,
        ge=1,
        le=64000,
        description="contact materials that `randomize` draws; PhysX has room for 64000",
    )
