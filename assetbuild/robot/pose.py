"""Rigid transforms. `X_a_b` is the pose of frame b in frame a: p_a = X_a_b.apply(p_b)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose:
    """Position in metres and unit quaternion wxyz.

    >>> X_world_arm, X_arm_hand = Pose((1.0, 0.0, 0.0)), Pose((0.0, 2.0, 0.0))
    >>> (X_world_arm @ X_arm_hand).xyz
    (1.0, 2.0, 0.0)
    """

    xyz: Vec3 = (0.0, 0.0, 0.0)
    quat: Quat = (1.0, 0.0, 0.0, 0.0)

    def __matmul__(self, other: Pose) -> Pose:
        """Composition: X_a_c = X_a_b @ X_b_c."""
        return Pose(vec3(self.apply(other.xyz)), quat_multiply(self.quat, other.quat))

    def inverse(self) -> Pose:
        """X_b_a from X_a_b."""
        w, x, y, z = self.quat
        conjugate = (w, 0.0 - x, 0.0 - y, 0.0 - z)  # no negative zeros
        return Pose(vec3(-(rotation_of(conjugate) @ np.asarray(self.xyz))), conjugate)

    @property
    def rotation(self) -> Array:
        """(3, 3) rotation matrix; its columns are the axes of the child frame."""
        return rotation_of(self.quat)

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of the child frame, in the parent frame."""
        p: Array = np.asarray(points, dtype=np.float64)
        turned: Array = p if self.quat == (1.0, 0.0, 0.0, 0.0) else p @ self.rotation.T
        moved: Array = turned + np.asarray(self.xyz)
        return moved

    def matrix(self) -> Array:
        """(4, 4) homogeneous matrix."""
        out = np.eye(4)
        out[:3, :3] = self.rotation
        out[:3, 3] = self.xyz
        return out


IDENTITY = Pose()


def vec3(values: ArrayLike) -> Vec3:
    """Three plain floats; negative zero becomes zero, so that equal poses have equal bytes."""
    x, y, z = (float(v) + 0.0 for v in np.asarray(values, dtype=np.float64))
    return (x, y, z)


def quat_multiply(a: Quat, b: Quat) -> Quat:
    """Hamilton product, normalised, w >= 0. An exact identity factor changes no bit."""
    if a == (1.0, 0.0, 0.0, 0.0):
        return b
    if b == (1.0, 0.0, 0.0, 0.0):
        return a
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return normalised_quat(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        )
    )


def normalised_quat(quat: Quat) -> Quat:
    """Unit quaternion with w >= 0; raises ValueError for a zero quaternion."""
    norm = math.sqrt(math.fsum(v * v for v in quat))
    if not norm > 0.0 or not math.isfinite(norm):
        raise ValueError("a quaternion must be finite and not zero")
    sign = -1.0 if quat[0] < 0.0 else 1.0
    w, x, y, z = (sign * v / norm + 0.0 for v in quat)
    return (w, x, y, z)


def rotation_of(quat: Quat) -> Array:
    """(3, 3) rotation matrix of a unit quaternion wxyz."""
    w, x, y, z = quat
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_of(rotation: ArrayLike) -> Quat:
    """Unit quaternion wxyz, w >= 0, of a (3, 3) rotation matrix.

    Bar-Itzhack (2000): eigenvector of the largest eigenvalue of a symmetric 4 x 4 matrix,
    accurate to rounding for every rotation, half turns included.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.asarray(rotation, dtype=np.float64)
    k = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, xy + yx, xz + zx],
            [xz - zx, xy + yx, yy - xx - zz, yz + zy],
            [yx - xy, xz + zx, yz + zy, zz - xx - yy],
        ]
    )
    w, x, y, z = np.linalg.eigh(k)[1][:, 3]
    return normalised_quat((float(w), float(x), float(y), float(z)))


def quat_of_rpy(roll: float, pitch: float, yaw: float) -> Quat:
    """URDF's roll, pitch, yaw in rad: Rz(yaw) Ry(pitch) Rx(roll)."""
    if roll == pitch == yaw == 0.0:
        return (1.0, 0.0, 0.0, 0.0)
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return normalised_quat(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def rpy_of(quat: Quat) -> Vec3:
    """Roll, pitch, yaw in rad with Rz(yaw) Ry(pitch) Rx(roll); at pitch +-90 deg roll is 0.

    Near gimbal lock only yaw -+ roll is well defined, so yaw is measured after roll is undone:
    whatever noise roll carries, yaw takes back.
    """
    r = rotation_of(quat)
    horizontal = math.hypot(r[2, 1], r[2, 2])
    pitch = math.atan2(-r[2, 0], horizontal)
    roll = 0.0 if horizontal < 1e-12 else math.atan2(r[2, 1], r[2, 2])
    s, c = math.sin(roll), math.cos(roll)
    return vec3((roll, pitch, math.atan2(s * r[0, 2] - c * r[0, 1], c * r[1, 1] - s * r[1, 2])))


def quat_between(a: ArrayLike, b: ArrayLike) -> Quat:
    """The shortest rotation that takes direction a to direction b, as wxyz."""
    u = np.asarray(a, dtype=np.float64)
    v = np.asarray(b, dtype=np.float64)
    u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
    cosine = float(u @ v)
    if cosine < -1.0 + 1e-12:  # half turn about any axis orthogonal to a
        axis = np.cross(u, np.eye(3)[int(np.argmin(np.abs(u)))])
        x, y, z = vec3(axis / np.linalg.norm(axis))
        return (0.0, x, y, z)
    x, y, z = vec3(np.cross(u, v))
    return normalised_quat((1.0 + cosine, x, y, z))


def cross(u: Array, v: Array) -> Array:
    """(n, 3) cross products, digit by digit those of numpy, which takes three times as long."""
    (ux, uy, uz), (vx, vy, vz) = u.T, v.T
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)
