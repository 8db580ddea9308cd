"""Where a robot touches the ground."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from assetbuild.robot.dynamics import Dynamics
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Geometry, Shapes, Sphere


def soles(
    tree: Tree, shapes: Shapes, robot: Dynamics, feet: str | None
) -> Sequence[tuple[str, Array]]:
    """(body, world point) where each foot's shapes touch the ground: below their centres."""
    found = []
    for shape in shapes.of("collision"):
        if feet is not None and re.fullmatch(feet, shape.link) is None:
            continue
        body, X_body_link = tree.placement(shape.link)
        X_world_shape = robot.motions[body].pose @ X_body_link @ shape.X_link_shape
        found.append((body, np.asarray(X_world_shape.xyz) - (0.0, 0.0, _drop(shape.geometry))))
    if feet is None and found:
        ground = min(point[2] for _, point in found)
        found = [(body, point) for body, point in found if point[2] - ground < 0.01]
    return found


def _drop(geometry: Geometry) -> float:
    """From the centre of a shape to its lowest point where that needs no mesh, m."""
    return geometry.radius if isinstance(geometry, Sphere) else 0.0
