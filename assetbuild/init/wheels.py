"""How large the wheels are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from assetbuild.init.anatomy import WHEEL
from assetbuild.init.look import InspectedRobot
from assetbuild.init.mesh_points import mesh_of, scaled_points
from assetbuild.robot.shapes import Box, MeshFile, SourceShape


def wheel_radii(robot: InspectedRobot, root: Path) -> dict[str, float]:
    """Return the radius of each wheel by its joint, m; wheels without a shape are left out.

    root: of the source's files.
    """
    found = {}
    for joint in robot.tree.moving_joints:
        if joint.kind == "continuous" and WHEEL.fullmatch(joint.child + joint.name):
            links = robot.links_of(joint.child)
            own = [shape for shape in robot.shapes.shapes if shape.link in links]
            sizes = [size for shape in own if (size := _radius(shape, root))]
            if sizes:
                found[joint.name] = max(sizes)
    return found


def _radius(shape: SourceShape, root: Path) -> float:
    """Half of the second largest extent: a wheel is as high as it is long, or wider than both."""
    geometry = shape.geometry
    if isinstance(geometry, Box):
        extents = np.asarray(geometry.size)
    elif isinstance(geometry, MeshFile):
        read = mesh_of(root, geometry)
        if read is None:
            return 0.0
        extents = np.ptp(scaled_points(read, geometry), axis=0)
    else:
        return geometry.radius
    return float(np.sort(extents)[1]) / 2.0
