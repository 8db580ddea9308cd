"""Principal axes of an inertia tensor, to the last bits and the same on every machine.

MJCF also takes the six numbers of the tensor (`fullinertia`), but MuJoCo 3.11 diagonalises them
to a relative 3e-6 only (measured; 4.0: 5e-15), so we diagonalise ourselves and write
`diaginertia` with `quat`.
"""

from __future__ import annotations

import math

import numpy as np

from assetbuild.robot.inertia import TRIANGLE_ROUNDING
from assetbuild.robot.pose import Quat, Vec3, quat_multiply, quat_of
from assetbuild.targets.mjcf.xml import plain

SWEEPS = 20
"""Far more than needed: the method converges quadratically, 3 x 3 in about five sweeps."""
NEAR_IDENTITY = 1e-5
"""Largest imaginary part of a quaternion that MuJoCo might take for the identity."""


def rounded_up(moments: Vec3) -> Vec3:
    """The moments as short decimals, the smallest so large that A + B >= C in doubles.

    kg m². MuJoCo compares exactly: 0.3 + 0.6 < 0.9. A violation beyond rounding stays as it is.
    """
    x, y, z = (plain(moment) for moment in moments)
    moments = (x, y, z)
    a, b, c = sorted(moments)
    if a + b >= c or c - b - a > TRIANGLE_ROUNDING * c:
        return moments
    raised = max(a, c - b)
    while raised + b < c:
        raised = math.nextafter(raised, math.inf)
    x, y, z = (raised if i == moments.index(a) else m for i, m in enumerate(moments))
    return x, y, z


def principal_inertia(
    inertia_kg_m2: tuple[float, float, float, float, float, float],
) -> tuple[Vec3, Quat]:
    """(moments, X_axes as wxyz): I = R diag(moments) R^T.

    inertia_kg_m2: (xx, yy, zz, xy, xz, yz). Jacobi's rotations (Golub and Van Loan, Matrix
    Computations, 8.5) in plain arithmetic: a diagonal tensor keeps its order and gives the
    identity, and the result does not depend on the linear algebra library.
    """
    xx, yy, zz, xy, xz, yz = inertia_kg_m2
    a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    for _ in range(SWEEPS):
        if a[0][1] == a[0][2] == a[1][2] == 0.0:
            break
        for p, q in ((0, 1), (0, 2), (1, 2)):
            _rotate(a, r, p, q)
    if r == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]:
        return (xx, yy, zz), (1.0, 0.0, 0.0, 0.0)
    return _clear_of_identity((a[0][0], a[1][1], a[2][2]), quat_of(np.array(r)))


def _clear_of_identity(moments: Vec3, quat: Quat) -> tuple[Vec3, Quat]:
    """The same tensor with its axes named in another order, when the quaternion is almost 1.

    MuJoCo takes a quaternion within about 1e-6 of the identity for the identity (measured in 3.11
    and 4.0: a mass matrix off by 1e-9); one turned by 120 degrees about (1, 1, 1) is never near.
    """
    if max(map(abs, quat[1:])) >= NEAR_IDENTITY:
        return moments, quat
    a, b, c = moments
    return (b, c, a), quat_multiply(quat, (0.5, 0.5, 0.5, 0.5))


def _rotate(a: list[list[float]], r: list[list[float]], p: int, q: int) -> None:
    """One rotation in the plane (p, q) that makes a[p][q] zero; in place."""
    off = a[p][q]
    if abs(off) <= 1e-300 or abs(off) < 1e-18 * min(abs(a[p][p]), abs(a[q][q])):
        a[p][q] = a[q][p] = 0.0
        return
    theta = (a[q][q] - a[p][p]) / (2.0 * off)
    t = math.copysign(1.0, theta) / (abs(theta) + math.hypot(theta, 1.0))
    c = 1.0 / math.hypot(t, 1.0)
    s = t * c
    third = 3 - p - q
    a[p][p] -= t * off
    a[q][q] += t * off
    a[p][q] = a[q][p] = 0.0
    kp, kq = a[third][p], a[third][q]
    a[third][p] = a[p][third] = c * kp - s * kq
    a[third][q] = a[q][third] = s * kp + c * kq
    for row in r:
        row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
