"""What a recipe says about the XRDF."""

from __future__ import annotations

from pydantic import Field

from assetbuild.quantities import Model, Pattern, Positive, Share

LimitTable = dict[Pattern, Positive]


class XrdfOptions(Model):
    """What only a planner asks for: `xrdf/<robot>.xrdf`."""

    joints: Pattern = Field(
        ".*",
        description="driven joints that a planner moves; it holds all others, such as a gripper's, "
        "at their default positions",
    )
    acceleration: Positive | LimitTable | None = Field(
        None,
        description="rad/s2 or m/s2: one number, or one for each pattern of joints, of which the "
        "first that matches wins; planners require it",
    )
    jerk: Positive | LimitTable | None = Field(
        None, description="rad/s3 or m/s3, likewise; planners require it"
    )
    tool_frames: tuple[str, ...] = Field(
        (), max_length=100, description="links that a planner moves to a goal; it requires one"
    )
    max_spheres: int = Field(32, ge=1, le=1024, description="most spheres of a link")
    margin: Share = Field(
        0.02,
        le=0.5,
        description="how far a sphere may stick out of a link's collision geometry, share of its "
        "size",
    )
    min_coverage: Share = Field(
        0.9, le=1, description="share of a link's collision volume below which a warning is given"
    )
