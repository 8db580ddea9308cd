"""What a recipe says about the module for mjlab."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from assetbuild.quantities import Model, Pattern, Positive
from assetbuild.robot.sections import Action

Spread = tuple[Positive, Positive]


class FootScan(Model):
    """The rays that measure how high a foot is above the ground."""

    radius: Positive = Field(0.04, description="m; of the ring of rays around a foot's site")
    samples: int = Field(4, ge=1, description="rays on the ring")


class PoseReward(Model):
    """How far joints may leave the initial pose before the reward `pose` drops."""

    knees: Pattern = Field(
        "(?i).*(calf|knee).*", description="joints that swing most while walking"
    )
    standing: Spread = Field(
        (0.05, 0.1), description="rad; standard deviation of other joints and of knees at rest"
    )
    walking: Spread = Field((0.3, 0.6), description="rad; as above, at walking speed")
    running: Spread = Field((0.3, 0.6), description="rad; as above, at running speed")


class MjlabOptions(Model):
    """What only mjlab's configuration has; the task options are those of its velocity task."""

    soft_joint_pos_limit_factor: float = Field(
        0.9, gt=0.0, le=1.0, description="share of a joint's range beyond which rewards punish"
    )
    num_envs: int = Field(4096, ge=1, description="robots that the task simulates side by side")
    cone: Literal["elliptic", "pyramidal"] = Field("elliptic", description="friction cone")
    impratio: Positive = Field(
        10.0, description="impedance of friction relative to that of the normal force"
    )
    njmax: int | None = Field(
        300, ge=1, description="room for constraints of one robot; null = mjlab's choice"
    )
    nconmax: int | None = Field(
        None, ge=1, description="room for contacts of one robot; null = MuJoCo Warp's choice"
    )
    action: Action = Action()
    foot_scan: FootScan = FootScan()
    pose: PoseReward = PoseReward()
