"""Where the camera stands so that what is shown fills the frame, in any posture and of any size."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import Data, Model
from assetbuild.simulators.studio import Camera

FOV = 28.0
"""Field of view along the shorter side of the picture, degrees: a long lens bends little."""
MARGIN = 1.1
"""How much larger the frame is than what is shown."""
OF_A_MESH = 1500
"""Vertices of each mesh that the camera is fitted to, evenly chosen."""


def robot_points(model: Model, data: Data, geoms: Collection[int]) -> Array:
    """(n, 3) points in the world, m, of the outlines of some geoms."""
    import mujoco

    found = [np.zeros((0, 3))]
    is_mesh = np.asarray(model.geom_type) == mujoco.mjtGeom.mjGEOM_MESH.value
    for geom in geoms:
        number = int(model.geom_dataid[geom])
        if is_mesh[geom] and number >= 0:
            start, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
            local = np.array(model.mesh_vert[start : start + count : 1 + count // OF_A_MESH])
        else:
            box = np.array(model.geom_aabb[geom])
            local = box[:3] + box[3:] * _CORNERS
        turned = np.array(data.geom_xmat[geom]).reshape(3, 3)
        found.append(local @ turned.T + np.array(data.geom_xpos[geom]))
    return np.concatenate(found)


_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def ellipsoid_points(model: Model, data: Data) -> Array:
    """(n, 3) points in the world, m, of the ellipsoids that MuJoCo draws for inertias.

    Semiaxes: sqrt(5 (I2 + I3 - I1) / (2 m)), of a uniform ellipsoid with these moments.
    """
    found = [np.zeros((0, 3))]
    for body in range(1, model.nbody):
        moments, mass = np.array(model.body_inertia[body]), float(model.body_mass[body])
        if mass > 0.0:
            axes = np.sqrt(np.maximum(2.5 * (moments.sum() - 2.0 * moments) / mass, 0.0))
            turned = np.array(data.ximat[body]).reshape(3, 3)
            found.append((_DIRECTIONS * axes) @ turned.T + np.array(data.xipos[body]))
    return np.concatenate(found)


_GRID = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
_DIRECTIONS = _GRID[_GRID.any(axis=1)] / np.linalg.norm(_GRID[_GRID.any(axis=1)], axis=1)[:, None]
"""(26, 3) unit vectors all around."""


def fitted(
    points: Array, azimuth: float, elevation: float, aspect: float, margin: float = MARGIN
) -> Camera:
    """The nearest camera, looking one way, whose picture holds all points.

    points: (n, 3) m in the world; azimuth, elevation: degrees, as MuJoCo's cameras count them;
    aspect: width / height. A point p = (x right, y up, z ahead) is inside when |x| <= w (z + d),
    so the largest x - w z and the largest -x - w z decide where the camera stands across, and
    how far away; the same holds upwards.
    """
    forward, right, up = directions(azimuth, elevation)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    x, y, z = np.stack([right, up, forward]) @ (points - middle).T
    tangent = math.tan(math.radians(FOV / 2.0)) * math.sqrt(max(aspect, 1.0 / aspect))
    wide, high = tangent * min(aspect, 1.0), tangent / max(aspect, 1.0)
    wide, high = wide / margin, high / margin
    left, low = float(np.max(-x - wide * z)), float(np.max(-y - high * z))
    far_right, far_up = float(np.max(x - wide * z)), float(np.max(y - high * z))
    across, above = (far_right - left) / 2.0, (far_up - low) / 2.0
    distance = max((far_right + left) / (2.0 * wide), (far_up + low) / (2.0 * high), 1e-3)
    position = middle + across * right + above * up - distance * forward
    return Camera(position, forward, up, wide * margin, high * margin)


def directions(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """(forward, right, up), unit vectors in the world."""
    turn, tilt = math.radians(azimuth), math.radians(elevation)
    level = math.cos(tilt)
    forward = np.array([level * math.cos(turn), level * math.sin(turn), math.sin(tilt)])
    right = np.array([math.sin(turn), -math.cos(turn), 0.0])
    return forward, right, np.cross(right, forward)


def spans(points: Array, azimuth: float, elevation: float) -> tuple[float, float]:
    """(width, height) of what a camera far away would see, m."""
    _, right, up = directions(azimuth, elevation)
    return float(np.ptp(points @ right)), float(np.ptp(points @ up))
