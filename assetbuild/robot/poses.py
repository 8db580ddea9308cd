"""Poses by name, as a recipe states them: by patterns of joints."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from assetbuild.quantities import Model, Pattern, Real


class Keyframe(Model):
    """A named pose."""

    base: Literal["on_ground"] | tuple[Real, Real, Real] = Field(
        "on_ground", description="on_ground: lowest collision point at z = 0; or x, y, z in metres"
    )
    joints: dict[Pattern, Real] = Field(
        default_factory=dict, description="rad or m; joints that no pattern matches are 0"
    )
