"""What a report reads of the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from assetbuild.body.measure_bodies import Measured
from assetbuild.recipe.models import Recipe
from assetbuild.robot.identify import Curves, Fit
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Shapes


@dataclass(frozen=True)
class Subject:
    """Everything that a report reads. pin: what the lock says of the source.

    fits: what the logs of the recipe showed.
    """

    recipe: Recipe
    pin: Mapping[str, object]
    tree: Tree
    shapes: Shapes
    control: Control
    measured: Measured
    fits: tuple[tuple[Fit, Curves], ...] = ()
