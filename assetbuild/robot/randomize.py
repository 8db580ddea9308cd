"""Mass properties drawn at random that some body could really have.

A draw deforms the matter of a body: it is stretched and sheared about the centre of mass, moved,
and made denser. With the pseudo-inertia J (4, 4) about the centre of mass that is J' = U J Uᵀ for
an upper triangular U = exp(α) [[A, t], [0, 1]], and every J' of an admissible body is reached:
Rucker and Wensing, "Smooth parameterization of rigid-body inertia", 2022. Since J' belongs to
deformed matter, it is positive definite whenever J is; no draw can break the triangle inequality.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.inertia import matrix_of, pseudo_inertia, tensor_of
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import Array, Vec3, vec3
from assetbuild.robot.ranges import RandomMatter, per_axis


@dataclass(frozen=True)
class JointSample:
    """Factors of the actuator table's numbers; delay in simulation steps, bias in rad or m."""

    joint: str
    kp: float = 1.0
    kd: float = 1.0
    damping: float = 1.0
    friction: float = 1.0
    armature: float = 1.0
    effort: float = 1.0
    delay: int = 0
    encoder_bias: float = 0.0


@dataclass(frozen=True)
class BodySample:
    """The drawn mass properties of one body, payloads included."""

    body: str
    inertial: Inertial


@dataclass(frozen=True)
class Sample:
    """One robot that could exist. friction: sliding, None = the recipe's.

    payloads_kg: mass of each payload of the recipe, in its order.
    """

    bodies: tuple[BodySample, ...] = ()
    joints: tuple[JointSample, ...] = ()
    payloads_kg: tuple[float, ...] = ()
    friction: float | None = None


@dataclass(frozen=True)
class Samples:
    """What `draw_samples` keeps."""

    samples: tuple[Sample, ...] = ()


def draw(inertial: Inertial, ranges: RandomMatter, count: int, seed: int, name: str) -> Array:
    """(count, 10) rows of mass, com (3), inertia about it (6): draws for one body.

    The i-th is the same whatever `count` and the other bodies are.
    """
    return _rows_of(deform(inertial, ranges, unit_draws(seed, f"link/{name}", count)))


def inertial_of(row: Array) -> Inertial:
    """The mass properties that a row of `draw` holds."""
    return Inertial(float(row[0]), vec3(row[1:4]), tensor_of(matrix_of(row[4:])))


def deform(inertial: Inertial, ranges: RandomMatter, unit: Array) -> Array:
    """Pseudo-inertias (n, 4, 4) about the body's origin of n deformed bodies.

    unit: (n, 10) in -1..1: density, shift (3), stretch (3), shear (3).
    """
    low, high = ranges.density
    alpha = np.log((low + high) / 2 + (high - low) / 2 * unit[:, 0]) / 2
    change = np.zeros((len(unit), 4, 4))
    for axis in range(3):
        change[:, axis, axis] = np.exp(ranges.stretch * unit[:, 4 + axis])
    for column, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))):
        change[:, i, j] = ranges.shear * unit[:, 7 + column]
    change[:, :3, 3] = np.asarray(per_axis(ranges.com)) * unit[:, 1:4]
    change[:, 3, 3] = 1.0
    change *= np.exp(alpha)[:, None, None]

    about_com = pseudo_inertia(Inertial(inertial.mass_kg, (0, 0, 0), inertial.inertia_com_kg_m2))
    to_origin = np.eye(4)
    to_origin[:3, 3] = inertial.com_m
    whole = to_origin @ change
    return np.asarray(whole @ about_com @ whole.transpose(0, 2, 1))


def homogeneous_box(mass_kg: float, size_m: Vec3, at_m: Vec3) -> Inertial:
    """A solid box: edges and centre in the frame whose axes it has."""
    x, y, z = size_m
    xx, yy, zz = (mass_kg / 12 * v for v in (y * y + z * z, x * x + z * z, x * x + y * y))
    return Inertial(mass_kg, at_m, (xx, yy, zz, 0.0, 0.0, 0.0))


def inconsistent(rows: Array) -> Array:
    """Which of (n, 10) draws no matter could have: mass or a second moment of mass <= 0, (n,)."""
    moments = np.linalg.eigvalsh(matrix_of(rows[:, 4:]))
    least = (moments[:, 0] + moments[:, 1] - moments[:, 2]) / 2
    return np.asarray((rows[:, 0] <= 0.0) | (least <= 0.0))


def unit_draws(seed: int, name: str, count: int, width: int = 10) -> Array:
    """(count, width) in -1..1; row i does not depend on `count`, nor one name on another."""
    digest = hashlib.sha256(f"{seed}/{name}".encode()).digest()
    generator = np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))
    return np.asarray(generator.uniform(-1.0, 1.0, (count, width)))


def _rows_of(pseudo: Array) -> Array:
    """(n, 10) mass, com, inertia about the centre of mass of pseudo-inertias (n, 4, 4)."""
    mass = pseudo[:, 3, 3]
    com = pseudo[:, :3, 3] / mass[:, None]
    second = pseudo[:, :3, :3] - mass[:, None, None] * com[:, :, None] * com[:, None, :]
    trace = np.trace(second, axis1=1, axis2=2)
    inertia = trace[:, None, None] * np.eye(3) - second
    upper = [inertia[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return np.column_stack([mass, com, *upper])
