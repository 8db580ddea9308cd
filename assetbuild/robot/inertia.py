"""Mass properties: moved, combined and judged. Inertia tuples are (xx, yy, zz, xy, xz, yz).

Formulas: Lynch and Park, Modern Robotics, ch. 8 (parallel axes, change of axes); Wensing, Kim and
Slotine, "Linear matrix inequalities for physically consistent inertial parameter
identification", 2018 (pseudo-inertia, triangle inequalities).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from assetbuild.findings import Scalar
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.model import Inertial, Tree
from assetbuild.robot.pose import IDENTITY, Array, Pose, Quat, Vec3, rotation_of, vec3

Tensor = tuple[float, float, float, float, float, float]


class InertiaBounds(Model):
    """Where the rules `inertia.*` draw the line."""

    triangle_slack: Positive = Field(
        0.01, description="share of C by which A + B >= C may fail before it is an error"
    )
    # Never an error: such a tensor is valid, simulators take it, and a long thin tube has it.
    radius: Positive = Field(
        0.5, description="m: radius of the ball with this mass and moment, warning above"
    )
    # Osmium has 22,590. Of all bodies with a mass and at most this density, a ball of just this
    # density has the least largest moment, so a smaller one belongs to no matter at all.
    density: Positive = Field(
        25_000.0, description="kg/m3: a body of less inertia than this matter has is reported"
    )
    small_mass: Positive = Field(1e-3, description="kg: a moving body below it is reported")


LEAST_MOMENT_KG_M2 = 1e-15
"""MuJoCo refuses a moving body with a smaller principal moment (its mjMINVAL)."""


def matrix_of(tensor: Tensor | Array) -> Array:
    """(..., 3, 3) symmetric matrices of (..., 6) tensors xx, yy, zz, xy, xz, yz."""
    places = ((0, 3, 4), (3, 1, 5), (4, 5, 2))
    return np.asarray(tensor, dtype=np.float64)[..., places]


def tensor_of(matrix: ArrayLike) -> Tensor:
    """(xx, yy, zz, xy, xz, yz) of a symmetric (3, 3) matrix; the two halves are averaged."""
    m = np.asarray(matrix, dtype=np.float64)
    xx, yy, zz = vec3(np.diag(m))
    xy, xz, yz = vec3([(m[0, 1] + m[1, 0]) / 2, (m[0, 2] + m[2, 0]) / 2, (m[1, 2] + m[2, 1]) / 2])
    return (xx, yy, zz, xy, xz, yz)


def rotate_tensor(tensor: Tensor, quat: Quat) -> Tensor:
    """R I Rᵀ: a tensor given in turned axes, in the axes that `quat` was measured from.

    An exact identity rotation changes no bit.
    """
    if quat == IDENTITY.quat:
        return tensor
    rotation = rotation_of(quat)
    return tensor_of(rotation @ matrix_of(tensor) @ rotation.T)


def move_inertial(inertial: Inertial, X_new_old: Pose) -> Inertial:
    """The same matter, described in another frame. An exact identity pose changes no bit."""
    if X_new_old == IDENTITY:
        return inertial
    return Inertial(
        inertial.mass_kg,
        vec3(X_new_old.apply(inertial.com_m)),
        rotate_tensor(inertial.inertia_com_kg_m2, X_new_old.quat),
    )


def parallel_axis(mass: float, offset: Sequence[float]) -> Tensor:
    """m (|d|² 1 - d dᵀ): what a shift by `offset` (3,) m away from the centre of mass adds."""
    x, y, z = offset
    return (
        mass * (y * y + z * z),
        mass * (x * x + z * z),
        mass * (x * x + y * y),
        -mass * x * y,
        -mass * x * z,
        -mass * y * z,
    )


def combine(parts: Sequence[Inertial]) -> Inertial:
    """One rigid body made of `parts`, all given in the same frame; one part is returned as it is.

    Raises ValueError without parts. Parts without any mass meet at the first one's centre.
    """
    if not parts:
        raise ValueError("nothing to combine")
    if len(parts) == 1:
        return parts[0]
    mass = math.fsum(part.mass_kg for part in parts)
    com = parts[0].com_m
    if mass != 0.0:
        com = vec3([math.fsum(p.mass_kg * p.com_m[i] for p in parts) / mass for i in range(3)])
    terms: list[Tensor] = []
    for part in parts:
        offset = [part.com_m[i] - com[i] for i in range(3)]
        terms += [part.inertia_com_kg_m2, parallel_axis(part.mass_kg, offset)]
    xx, yy, zz, xy, xz, yz = (math.fsum(term[i] for term in terms) for i in range(6))
    return Inertial(mass, com, (xx, yy, zz, xy, xz, yz))


def total_mass(tree: Tree) -> float:
    """kg, of all bodies."""
    return math.fsum(body.inertial.mass_kg for body in tree.bodies if body.inertial)


def about_point(inertial: Inertial, point_m: Vec3) -> Tensor:
    """Inertia about a point of the body frame, in the axes of the body, kg m²."""
    offset = [inertial.com_m[i] - point_m[i] for i in range(3)]
    shift = parallel_axis(inertial.mass_kg, offset)
    xx, yy, zz, xy, xz, yz = (a + b for a, b in zip(inertial.inertia_com_kg_m2, shift, strict=True))
    return (xx, yy, zz, xy, xz, yz)


def principal_moments(tensor: Tensor) -> Vec3:
    """Eigenvalues in rising order, kg m²; exact for a diagonal tensor."""
    return vec3(np.linalg.eigvalsh(matrix_of(tensor)))


TRIANGLE_ROUNDING = 1e-12
"""Share of C: a smaller violation of A + B >= C is rounding of the six numbers."""


def triangle_violation(tensor: Tensor) -> float:
    """(C - A - B) / C of the principal moments A <= B <= C: positive when no mass could have them.

    1 for a rod without thickness and without error: -1 is a ball. 0 when C is not positive.
    With the mass it decides whether the pseudo-inertia is positive definite, whatever the origin:
    its least second moment is (A + B - C) / 2, and moving the origin is a congruence.
    """
    a, b, c = principal_moments(tensor)
    return (c - a - b) / c if c > 0.0 else 0.0


def pseudo_inertia(inertial: Inertial) -> Array:
    """(4, 4): second moments of mass and first moments about the origin of the body frame.

    [[Σ, m c], [m cᵀ, m]] with Σ = tr(I)/2 1 - I. Positive definite exactly for matter that has
    positive density in a volume.
    """
    at_origin = matrix_of(about_point(inertial, (0.0, 0.0, 0.0)))
    first = inertial.mass_kg * np.asarray(inertial.com_m)
    out = np.empty((4, 4))
    out[:3, :3] = np.trace(at_origin) / 2 * np.eye(3) - at_origin
    out[:3, 3] = out[3, :3] = first
    out[3, 3] = inertial.mass_kg
    return out


def equivalent_radius(inertial: Inertial) -> float:
    """Radius of the solid ball with this mass and largest principal moment: √(5/2 I/m), m.

    It tells "too much inertia for its mass" in a length that a person can compare with the part.
    `inf` without mass.
    """
    if inertial.mass_kg <= 0.0:
        return math.inf
    largest = principal_moments(inertial.inertia_com_kg_m2)[2]
    return math.sqrt(max(0.0, 2.5 * largest / inertial.mass_kg))


def mass_data(before: Inertial, after: Inertial) -> dict[str, Scalar | tuple[Scalar, ...]]:
    """What the finding of an edit holds of the mass properties before and after."""
    return {
        "before_kg": before.mass_kg,
        "after_kg": after.mass_kg,
        "before_m": before.com_m,
        "after_m": after.com_m,
        "before_kg_m2": before.inertia_com_kg_m2,
        "after_kg_m2": after.inertia_com_kg_m2,
    }
