"""Parts that are mounted on the robot of a recipe: `compose` in a recipe."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from assetbuild.quantities import Model, Name, Pattern, Real
from assetbuild.recipe.source import Source
from assetbuild.robot.sections import At, Mount

Prefix = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,31}$")]


class Part(Model):
    """Another robot, mounted on this one by a fixed joint. All its names get a prefix."""

    recipe: str | None = Field(None, description="its recipe, relative to this one")
    source: Source | None = Field(
        None,
        description="the robot itself, instead of a `recipe`: the rows of this recipe that name "
        "its prefix speak of it",
    )
    variant: Name | None = Field(None, description="of that recipe")
    as_: Prefix = Field(alias="as", description="prefix of all its names, such as `arm_`")
    at: At = Field(description="where its root sits")
    mount: Mount | None = Field(None, description="the plate or bracket between the two")
    exclude: tuple[str, ...] = Field(
        (), description="links of the base robot that nothing of the part collides with"
    )
    home: dict[Pattern, Real] = Field(
        default_factory=dict,
        description="its joints, by their own names, in keyframe `home`; without it as its "
        "recipe's own `home`",
    )

    @model_validator(mode="after")
    def _one_origin(self) -> Part:
        if (self.recipe is None) == (self.source is None):
            raise ValueError("give exactly one of `recipe`, `source`")
        if self.source is not None and self.variant is not None:
            raise ValueError("`variant` is one of a `recipe`: a `source` has none")
        return self
