"""Left against right: mass, inertia, axes, limits, first pose and drives of mirrored parts.

A robot is mirrored in one plane through its root. A turn is a pseudo-vector: the mirror image of a
turn by q about `a` is one by q about -M a, with M = diag(1, -1, 1) for the plane y = 0. So where
the right axis is -M a (two knees about +y) both sides have equal ranges; where it is M a (two hips
about +x) they are [l, u] and [-u, -l].

Robots are never quite symmetric: a difference is reported as information. What a slip explains is a
warning: a range or a pose with the other side's sign, a mass or a gain twice that of its twin.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from pydantic import Field

from assetbuild.findings import Finding, Rule, Scalar, Severity
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.inertia import matrix_of, principal_moments
from assetbuild.robot.model import Inertial, Joint
from assetbuild.robot.pose import Array
from assetbuild.robot.tree import unit_of
from assetbuild.robot.twins import PLACE_M, Part, Twins

SLIP = 2.0
"""Times the twin's value: more than two builds of one part differ by."""

LIMITS = Rule(
    "mirror.limits",
    ("info", "warning"),
    "a range is not the mirror image of its twin's (a warning when it has the sign of the other "
    "side)",
    "`set_limits`; `flip_axis` with `limits: keep` where an axis points the wrong way",
)
AXES = Rule(
    "mirror.axes",
    "info",
    "an axis is not the mirror image of its twin's",
    "`flip_axis`, or correct the source, if it is a mistake",
)
HOME = Rule(
    "mirror.home",
    ("info", "warning"),
    "the initial keyframe is not its own mirror image (a warning when it has the sign of the other "
    "side)",
    "correct it, unless it leans on purpose",
)
GAINS = Rule(
    "mirror.gains",
    ("info", "warning"),
    "gains, limits of effort or velocity, friction or armature differ (a warning from a factor "
    "of two)",
    "one row of `actuators` for both",
)
MASS = Rule(
    "mirror.mass",
    ("info", "warning"),
    "the masses differ (a warning from a factor of two)",
    "`set_mass`",
)
CENTER = Rule(
    "mirror.center",
    "info",
    "a centre of mass is not the mirror image of its twin's",
    "check its signs; `set_inertia`",
)
INERTIA = Rule(
    "mirror.inertia",
    ("info", "warning"),
    "an inertia is not the mirror image of its twin's (a warning from a factor of four)",
    "check the signs of its products; `set_inertia`",
)


class Tolerances(Model):
    """Left against right: what twins may differ by; more is information, a slip a warning.

    null for a robot that is no mirror image of itself.
    """

    place: Positive = Field(
        PLACE_M, description="m: parts whose places mirror each other so closely are compared"
    )
    mass: Positive = Field(0.02, description="relative difference of mass")
    center: Positive = Field(0.005, description="m, of the centre of mass")
    inertia: Positive = Field(0.1, description="relative difference of inertia")
    axis: Positive = Field(0.02, description="rad, between an axis and its mirror image")
    limits: Positive = Field(0.005, description="rad or m, of either end of a range")
    home: Positive = Field(0.001, description="rad or m, at the initial keyframe")
    gains: Positive = Field(
        0.01, description="relative, of kp, kd, damping, friction, armature, effort, velocity"
    )


Difference = tuple[Rule, str, str, Mapping[str, Scalar], bool]
"""What two twins differ in: rule, message, hint, numbers, and whether a slip explains it."""


def mirror_findings(twins: Twins, allowed: Tolerances) -> Iterator[Finding]:
    """All that two twins differ in by more than allowed, right against left."""
    for left, right in twins.pairs:
        one, other = left.joint, right.joint
        compared = [(f"link {right.name}", left.name, _masses(left, right, twins.flip, allowed))]
        if one and other and unit_of(one) == unit_of(other):
            motions = _motions(left, one, right, other, twins.flip, allowed)
            compared.append((f"joint {other.name}", one.name, motions))
            drives = _drives(left, one.name, right, allowed)
            compared.append((f"actuator {other.name}", one.name, drives))
        for subject, twin, differences in compared:
            for rule, message, hint, data, slip in differences:
                severity: Severity = "warning" if slip else "info"
                data = {**data, "other": twin}
                yield rule(subject, message, hint, severity=severity, data=data)


def _masses(left: Part, right: Part, flip: Array, allowed: Tolerances) -> Iterator[Difference]:
    one, other = left.inertial, right.inertial
    if not (one.mass_kg > 0.0 and other.mass_kg > 0.0):
        return
    low, high = sorted((one.mass_kg, other.mass_kg))
    if (high - low) / high > allowed.mass:
        message = f"{other.mass_kg:.4g} kg, but `{left.name}` has {one.mass_kg:.4g} kg"
        hint = "`edits: set_mass` corrects the side that is wrong"
        data = {"mass_kg": other.mass_kg, "mass_of_other_kg": one.mass_kg}
        yield MASS, message, hint, data, high >= SLIP * low
    away = float(np.linalg.norm(flip @ one.com_m - other.com_m))
    if away > allowed.center:
        apart = f"{1e3 * away:.3g} mm"
        message = f"its centre of mass is {apart} from the mirror image of `{left.name}`'s"
        hint = "is a sign wrong, or the same part on both sides? `edits: set_inertia` corrects it"
        yield CENTER, message, hint, {"distance_m": away}, False
    wanted = flip @ matrix_of(one.inertia_com_kg_m2) @ flip
    actual = matrix_of(other.inertia_com_kg_m2)
    low, high = sorted(float(np.linalg.norm(inertia)) for inertia in (actual, wanted))
    difference = float(np.linalg.norm(wanted - actual)) / (high or 1.0)
    if difference > allowed.inertia:
        message = (
            f"its inertia (largest {_largest(other):.3g} kg m²) is {difference:.0%} off the mirror "
            f"image of `{left.name}`'s (largest {_largest(one):.3g} kg m²)"
        )
        hint = "has a product of inertia the wrong sign? `edits: set_inertia` corrects it"
        yield INERTIA, message, hint, {"relative": difference}, high >= SLIP**2 * low


def _largest(inertial: Inertial) -> float:
    """kg m2, principal moment."""
    return max(0.0, principal_moments(inertial.inertia_com_kg_m2)[2])


def _motions(
    left: Part, one: Joint, right: Part, other: Joint, flip: Array, allowed: Tolerances
) -> Iterator[Difference]:
    """left, right: the bodies that the joints `one` and `other` carry."""
    wanted = flip @ left.X_root_body.rotation @ one.axis
    if one.kind != "prismatic":
        wanted = -wanted  # a turn is a pseudo-vector
    axis = right.X_root_body.rotation @ other.axis
    cosine = float(np.clip(wanted @ axis, -1.0, 1.0))
    angle = float(np.arccos(abs(cosine)))
    if angle > allowed.axis:
        off = f"{np.degrees(angle):.3g} degrees"
        message = f"its axis is {off} off the mirror image of `{one.name}`'s"
        hint = "edit `flip_axis` turns an axis round; a tilt stands in the source"
        yield AXES, message, hint, {"angle_rad": angle}, False
        return
    sign = 1.0 if cosine > 0.0 else -1.0
    is_slip = False
    for difference in _limits(one, other, sign, allowed.limits):
        yield difference
        is_slip = difference[-1]
    # A joint that counts the wrong way has the wrong pose too, and one finding is enough.
    if left.home is None or right.home is None or is_slip:
        return
    expected = sign * left.home
    if abs(expected - right.home) > allowed.home:
        # A smaller angle has no sign to mistake.
        slip = abs(expected + right.home) <= allowed.home < 0.1 * abs(expected)
        message = f"the initial keyframe has it at {right.home:g} {unit_of(other)}; as the mirror "
        message += f"image of `{one.name}` it would be at {expected:g}"
        hint = "correct the keyframe, unless the pose leans on purpose"
        yield HOME, message, hint, {"position": right.home, "mirrored": expected}, slip


def _limits(left: Joint, right: Joint, sign: float, tolerance: float) -> Iterator[Difference]:
    hint, slip = "edit `set_limits`, of the side that is wrong", False
    if left.range is None or right.range is None:
        if left.range == right.range:
            return
        one, other = (left, right) if left.range is None else (right, left)
        message = f"`{one.name}` has no limits, but `{other.name}` has {_range_text(other)}"
    else:
        wanted = _turned(left.range, sign)
        if _apart(wanted, right.range) <= tolerance:
            return
        message = f"its range is {_range_text(right)}, but as the mirror image of `{left.name}` it "
        message += f"would be {wanted[0]:g} to {wanted[1]:g} {unit_of(right)}"
        slip = _apart(_turned(wanted, -1.0), right.range) <= tolerance
    if slip:
        message += ": the limits of left and right are swapped, or an axis points the wrong way"
        turned = f"flip_axis: {{joint: {right.name}, limits: keep}}"
        hint = f"`set_limits` for swapped limits; `{turned}`, or of the other, for an axis"
    data: dict[str, Scalar] = {}
    for joint, ending in ((left, "_of_other"), (right, "")):
        if joint.range is not None:
            data |= {f"lower{ending}": joint.range[0], f"upper{ending}": joint.range[1]}
    yield LIMITS, message, hint, data, slip


def _drives(left: Part, twin: str, right: Part, allowed: Tolerances) -> Iterator[Difference]:
    """twin: the joint on the left."""
    for name, value in right.drive.items():
        other = left.drive.get(name, value)  # not there: measured
        if value == other:
            continue
        values = [abs(v) if v is not None else np.inf for v in (value, other)]
        small, large = min(values), max(values)
        if np.isfinite(large) and large - small <= allowed.gains * large:
            continue
        message = f"its {name} is {_value(value)}, but that of `{twin}` is {_value(other)}"
        data = {"of": name, "value": value, "value_of_other": other}
        yield GAINS, message, "one row of `actuators` for both", data, large >= SLIP * small


def _turned(limits: tuple[float, float], sign: float) -> tuple[float, float]:
    return limits if sign > 0.0 else (-limits[1], -limits[0])


def _apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]))


def _range_text(joint: Joint) -> str:
    low, high = joint.bounds
    return f"{low:g} to {high:g} {unit_of(joint)}"


def _value(value: float | None) -> str:
    return "unlimited" if value is None else f"{value:g}"
