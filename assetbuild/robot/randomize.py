"""Mass properties drawn at random that some body could really have.

A draw deforms the matter of a body: it is stretched and sheared about the centre of mass, moved,
and made denser. With the pseudo-inertia J (4, 4) about the centre of mass that is J' = U J Uᵀ for
an upper triangular U = exp(α) [[A, t], [0, 1]], and every J' of an admissible body is reached:
Rucker and Wensing, "Smooth parameterization of rigid-body inertia", 2022. Since J' belongs to
deformed matter, it is positive definite whenever J is; no draw can break the triangle inequality.

Whether that matter also fits into the link is a second question, asked of the ellipsoid around
the link's geometry: tr(J Q) >= 0 exactly when some density inside it has these mass properties
(Wensing, Kim and Slotine, 2018). Draws that fail it are drawn again.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from assetbuild.robot.inertia import matrix_of, pseudo_inertia, tensor_of
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import Array, Vec3, vec3

MOST_POINTS = 200
"""Most corners of a body that are taken to find the ellipsoid around all of them."""
TOLERANCE = 0.01
MOST_ROUNDS = 200
"""A draw that fits in none of so many attempts: the ranges do not fit the link."""


@dataclass(frozen=True)
class InertialRanges:
    """What may happen to the matter of one body; all draws are uniform.

    density: (least, most) factor of the mass, shape unchanged.
    com_m: largest shift of the matter along each body axis, m.
    stretch: largest |ln| of the factor along each body axis. shear: largest shear, 1.
    """

    density: tuple[float, float] = (1.0, 1.0)
    com_m: Vec3 = (0.0, 0.0, 0.0)
    stretch: float = 0.0
    shear: float = 0.0


@dataclass(frozen=True)
class Ellipsoid:
    """All x with (x - centre)ᵀ shape (x - centre) <= 1. shape: (3, 3), rows of tuples, 1/m²."""

    centre: Vec3
    shape: tuple[Vec3, Vec3, Vec3]

    def quadric(self) -> Array:
        """Q (4, 4) with [x 1] Q [x 1]ᵀ >= 0 exactly inside."""
        shape, centre = np.asarray(self.shape), np.asarray(self.centre)
        q = np.empty((4, 4))
        q[:3, :3] = -shape
        q[:3, 3] = q[3, :3] = shape @ centre
        q[3, 3] = 1.0 - centre @ shape @ centre
        return q

    def grown_to_hold(self, inertial: Inertial) -> Ellipsoid:
        """The smallest copy of the same form and centre in which these properties are possible.

        The ellipsoid itself when they already are.
        """
        room = float(np.trace(pseudo_inertia(inertial) @ self.quadric()))
        if room >= 0.0 or inertial.mass_kg <= 0.0:
            return self
        # tr(J Q) = m - ∫ρ (x-c)ᵀ E (x-c): scaling E by s turns it into m - s (m - room).
        scale = inertial.mass_kg / (inertial.mass_kg - room)
        a, b, c = (vec3(row) for row in np.asarray(self.shape) * scale)
        return Ellipsoid(self.centre, (a, b, c))


@dataclass(frozen=True)
class Room:
    """The ellipsoid that must be able to hold the matter of a body, in the body's frame."""

    body: str
    ellipsoid: Ellipsoid


@dataclass(frozen=True)
class Rooms:
    """The room of every body with mass."""

    rooms: tuple[Room, ...] = ()


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


@dataclass(frozen=True)
class Draws:
    """Draws for one body. inertials: (n, 10) rows of mass, com (3), inertia_com (6).

    tried: draws made for each one kept, (n,); 1 = the first one fitted.
    """

    rows: Array
    tried: Array

    def inertial(self, index: int) -> Inertial:
        """One of them."""
        row = self.rows[index]
        return Inertial(float(row[0]), vec3(row[1:4]), tensor_of(matrix_of(row[4:])))

    @property
    def acceptance(self) -> float:
        """Share of all draws that fitted into the link."""
        return len(self.tried) / float(self.tried.sum())


class DoesNotFitError(ValueError):
    """The ranges lead out of the link in (nearly) every draw."""


def draw(
    inertial: Inertial, ranges: InertialRanges, count: int, seed: int, name: str, room: Ellipsoid
) -> Draws:
    """`count` draws for one body; the i-th is the same whatever `count` and the other bodies are.

    room: the ellipsoid that must be able to hold the matter. Raises DoesNotFitError.
    """
    quadric = room.quadric()
    rows, tried = np.empty((count, 10)), np.zeros(count)
    open_ = np.arange(count)
    for attempt in range(1, MOST_ROUNDS + 1):
        unit = unit_draws(seed, name, attempt, count)[open_]
        changed = deform(inertial, ranges, unit)
        # A room that had to grow holds the matter exactly: rounding decides nothing.
        fits = np.einsum("nij,ji->n", changed, quadric) >= -1e-9 * changed[:, 3, 3]
        rows[open_[fits]] = _rows_of(changed[fits])
        tried[open_] = attempt
        open_ = open_[~fits]
        if not len(open_):
            return Draws(rows, tried)
    raise DoesNotFitError(
        f"{len(open_)} of {count} draws for `{name}` left the link in all {MOST_ROUNDS} attempts"
    )


def deform(inertial: Inertial, ranges: InertialRanges, unit: Array) -> Array:
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
    change[:, :3, 3] = np.asarray(ranges.com_m) * unit[:, 1:4]
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


def bounding_ellipsoid(points: Array) -> Ellipsoid:
    """An ellipsoid around `points` (n, 3) whose axes exceed the least one's by TOLERANCE, about.

    Khachiyan's algorithm with away steps (Todd and Yildirim, 2007); give it the vertices of the
    hull. What has no thickness gets 1e-4 of its extent. Raises ValueError without a point.
    """
    if not len(points):
        raise ValueError("no point to enclose")
    round_points, middle, basis = _rounded(np.asarray(points, dtype=np.float64))
    core = _spread_out(round_points, MOST_POINTS)
    weight = _enclosing_weights(core)
    centre = weight @ core
    offset = core - centre
    shape = np.linalg.inv(offset.T @ (offset * weight[:, None])) / 3.0
    # What the tolerance and the choice of points left outside is taken in.
    offset = round_points - centre
    shape /= max(1.0, float(np.einsum("ni,ij,nj->n", offset, shape, offset).max()))
    back = np.linalg.inv(basis)
    a, b, c = (vec3(row) for row in back.T @ shape @ back)
    return Ellipsoid(vec3(middle + basis @ centre), (a, b, c))


def _spread_out(points: Array, count: int) -> Array:
    """At most `count` of the points, each the farthest from those before it."""
    if len(points) <= count:
        return points
    chosen = [int(np.argmax((points**2).sum(axis=1)))]
    apart = np.full(len(points), np.inf)
    while len(chosen) < count:
        apart = np.minimum(apart, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(apart)))
    return np.asarray(points[chosen])


def _rounded(points: Array) -> tuple[Array, Array, Array]:
    """Points of extent 1 in each direction, and (middle, basis) with x = middle + basis y."""
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=True)
    extent = float(np.ptp(points, axis=0).max()) or 1e-3
    lengths = np.zeros(3)
    lengths[: len(spread)] = spread / np.sqrt(len(points))
    flat = lengths < 1e-4 * extent
    lengths[flat] = 1e-4 * extent
    round_points = (points - middle) @ axes.T / lengths
    for axis in np.flatnonzero(flat):
        step = np.eye(3)[axis]
        round_points = np.vstack([round_points + step, round_points - step])
    return round_points, middle, axes.T * lengths


def _enclosing_weights(points: Array) -> Array:
    """Weights (n,) whose second moments give the least ellipsoid."""
    count = len(points)
    lifted = np.hstack([points, np.ones((count, 1))])
    weight = np.full(count, 1.0 / count)
    for _ in range(1_000):
        moment = (lifted * weight[:, None]).T @ lifted
        reach = ((lifted @ np.linalg.inv(moment)) * lifted).sum(axis=1)
        far = int(np.argmax(reach))
        near = int(np.argmin(np.where(weight > 0.0, reach, math.inf)))
        if reach[far] <= 4.0 * (1.0 + TOLERANCE) and reach[near] >= 4.0 * (1.0 - TOLERANCE):
            break
        index = far if reach[far] - 4.0 >= 4.0 - reach[near] else near
        least = -weight[index] / (1.0 - weight[index]) if weight[index] < 1.0 else 0.0
        rise = reach[index] - 1.0
        step = max((reach[index] - 4.0) / (4.0 * rise), least) if rise > 0.0 else least
        weight *= 1.0 - step
        weight[index] += step
    return weight


def inconsistent(rows: Array) -> Array:
    """Which of (n, 10) draws no matter could have: mass or a second moment of mass <= 0, (n,)."""
    moments = np.linalg.eigvalsh(matrix_of(rows[:, 4:]))
    least = (moments[:, 0] + moments[:, 1] - moments[:, 2]) / 2
    return np.asarray((rows[:, 0] <= 0.0) | (least <= 0.0))


def unit_draws(seed: int, name: str, attempt: int, count: int, width: int = 10) -> Array:
    """(count, width) in -1..1; row i does not depend on `count`, nor one name on another."""
    digest = hashlib.sha256(f"{seed}/{name}/{attempt}".encode()).digest()
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
