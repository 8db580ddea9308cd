"""What people want to know of a robot and no file of geometry says: who made it, what it is."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from assetbuild.quantities import Model

Line = Annotated[
    str, Field(min_length=1, max_length=2000, pattern=r"^[^\x00-\x1f]*\S[^\x00-\x1f]*$")
]


class About(Model):
    """For the model card and for the metadata of the USD; what is not stated is left out."""

    author: Line | None = Field(None, description="who wrote the description: people or a company")
    vendor: Line | None = Field(None, description="who makes the robot itself")
    description: Line | None = Field(None, description="what the robot is, in a sentence")
    tags: tuple[Line, ...] = Field((), max_length=64, description="words to find it by")
    date: Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")] | None = Field(
        None,
        description="the day that the USD states as its own, YYYY-MM-DD; without it the USD says "
        "that none is recorded, because a build on another day must give the same bytes",
    )
