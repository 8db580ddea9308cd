"""How collision geometry is made: what every method shares; the rest are the method's own keys."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from assetbuild.quantities import Model
from assetbuild.robot.sections import Region, ToleranceRegion

Preset = Literal["locomotion", "manipulation"]


class CollisionRule(Model):
    """How the collision geometry of a link is made, and how well it must fit."""

    method: str = Field("auto", description="auto, keep, none or a plug-in of assetbuild.collision")
    from_: Literal["auto", "collision", "visual"] = Field(
        "auto", alias="from", description="the link's geometry to use; auto: collision, else visual"
    )
    preset: Preset | None = Field(
        None, description="tolerances of `auto` that are not stated; without it `collision.preset`"
    )


class ShapedRule(CollisionRule):
    """A rule whose method makes new shapes."""

    keep_open: tuple[Region, ...] = Field(
        (), max_length=64, description="places that no piece may enter: gaps, holes, handles"
    )
    regions: tuple[ToleranceRegion, ...] = Field(
        (), max_length=64, description="places with a tighter `max_outside`"
    )
