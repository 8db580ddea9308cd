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
from assetbuild.robot.pose import Array
from assetbuild.robot.twins import PLACE_M, Motion, Part, Twins

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


def mirror_findings(twins: Twins, allowed: Tolerances) -> Iterator[Finding]:
    """All that two twins differ in by more than allowed, right against left."""
    for left, right in twins.pairs:
        if left.mass > 0.0 and right.mass > 0.0:
            yield from _masses(left, right, twins.flip, allowed)
        if len(left.joints) == len(right.joints):
            for one, other in zip(left.joints, right.joints, strict=True):
                if one.turns == other.turns:
                    yield from _motions(one, other, twins.flip, allowed)
                    yield from _drives(one, other, allowed)


def _masses(left: Part, right: Part, flip: Array, allowed: Tolerances) -> Iterator[Finding]:
    low, high = sorted((left.mass, right.mass))
    if (high - low) / high > allowed.mass:
        message = f"{right.mass:.4g} kg, but `{left.name}` has {left.mass:.4g} kg"
        hint = "`edits: set_mass` corrects the side that is wrong"
        data = {"mass_kg": right.mass, "mass_of_other_kg": left.mass}
        yield _finding(MASS, "link", left, right, message, hint, data, slip=high >= SLIP * low)
    away = float(np.linalg.norm(flip @ left.com - right.com))
    if away > allowed.center:
        apart = f"{1e3 * away:.3g} mm"
        message = f"its centre of mass is {apart} from the mirror image of `{left.name}`'s"
        hint = "is a sign wrong, or the same part on both sides? `edits: set_inertia` corrects it"
        yield _finding(CENTER, "link", left, right, message, hint, {"distance_m": away})
    wanted = flip @ left.inertia @ flip
    low, high = sorted(float(np.linalg.norm(inertia)) for inertia in (right.inertia, wanted))
    difference = float(np.linalg.norm(wanted - right.inertia)) / (high or 1.0)
    if difference > allowed.inertia:
        message = (
            f"its inertia (largest {_largest(right):.3g} kg m²) is {difference:.0%} off the mirror "
            f"image of `{left.name}`'s (largest {_largest(left):.3g} kg m²)"
        )
        hint = "has a product of inertia the wrong sign? `edits: set_inertia` corrects it"
        data, slip = {"relative": difference}, high >= SLIP**2 * low
        yield _finding(INERTIA, "link", left, right, message, hint, data, slip=slip)


def _largest(part: Part) -> float:
    """kg m2, principal moment."""
    return max(0.0, float(np.linalg.eigvalsh(part.inertia)[-1]))


def _motions(left: Motion, right: Motion, flip: Array, allowed: Tolerances) -> Iterator[Finding]:
    cosine = float(np.clip(image(left, flip) @ right.axis, -1.0, 1.0))
    angle = float(np.arccos(abs(cosine)))
    if angle > allowed.axis:
        off = f"{np.degrees(angle):.3g} degrees"
        message = f"its axis is {off} off the mirror image of `{left.name}`'s"
        hint = "edit `flip_axis` turns an axis round; a tilt stands in the source"
        yield _finding(AXES, "joint", left, right, message, hint, {"angle_rad": angle})
        return
    sign = 1.0 if cosine > 0.0 else -1.0
    finding = _limits(left, right, sign, allowed.limits)
    if finding is not None:
        yield finding
    if finding is None or finding.severity != "warning":
        yield from _home(left, right, sign, allowed.home)
    # A joint that counts the wrong way has the wrong pose too, and one finding is enough.


def _limits(left: Motion, right: Motion, sign: float, tolerance: float) -> Finding | None:
    hint, slip = "edit `set_limits`, of the side that is wrong", False
    if left.limits is None or right.limits is None:
        if left.limits == right.limits:
            return None
        one, other = (left, right) if left.limits is None else (right, left)
        message = f"`{one.name}` has no limits, but `{other.name}` has {_range_text(other)}"
    else:
        wanted = _turned(left.limits, sign)
        if _apart(wanted, right.limits) <= tolerance:
            return None
        message = f"its range is {_range_text(right)}, but as the mirror image of `{left.name}` it "
        message += f"would be {wanted[0]:g} to {wanted[1]:g} {right.unit}"
        slip = _apart(_turned(wanted, -1.0), right.limits) <= tolerance
    if slip:
        message += ": the limits of left and right are swapped, or an axis points the wrong way"
        turned = f"flip_axis: {{joint: {right.name}, limits: keep}}"
        hint = f"`set_limits` for swapped limits; `{turned}`, or of the other, for an axis"
    data: dict[str, Scalar] = {}
    for joint, ending in ((left, "_of_other"), (right, "")):
        if joint.limits is not None:
            data |= {f"lower{ending}": joint.limits[0], f"upper{ending}": joint.limits[1]}
    return _finding(LIMITS, "joint", left, right, message, hint, data, slip=slip)


def _home(left: Motion, right: Motion, sign: float, tolerance: float) -> Iterator[Finding]:
    if left.home is None or right.home is None:
        return
    wanted = sign * left.home
    if abs(wanted - right.home) <= tolerance:
        return
    slip = abs(wanted + right.home) <= tolerance < 0.1 * abs(wanted)  # less has no sign to mistake
    message = f"the initial keyframe has it at {right.home:g} {right.unit}; as the mirror image of "
    message += f"`{left.name}` it would be at {wanted:g}"
    hint = "correct the keyframe, unless the pose leans on purpose"
    data = {"position": right.home, "mirrored": wanted}
    yield _finding(HOME, "joint", left, right, message, hint, data, slip=slip)


def _drives(left: Motion, right: Motion, allowed: Tolerances) -> Iterator[Finding]:
    for name, value in right.drive.items():
        other = left.drive.get(name, value)  # not there: measured
        if value == other:
            continue
        values = [abs(v) if v is not None else np.inf for v in (value, other)]
        small, large = min(values), max(values)
        if np.isfinite(large) and large - small <= allowed.gains * large:
            continue
        message = f"its {name} is {_value(value)}, but that of `{left.name}` is {_value(other)}"
        hint, slip = "one row of `actuators` for both", large >= SLIP * small
        data = {"of": name, "value": value, "value_of_other": other}
        yield _finding(GAINS, "actuator", left, right, message, hint, data, slip=slip)


def _finding(
    rule: Rule,
    kind: str,
    left: Part | Motion,
    right: Part | Motion,
    message: str,
    hint: str,
    data: Mapping[str, Scalar],
    *,
    slip: bool = False,
) -> Finding:
    severity: Severity = "warning" if slip else "info"
    whole = {**data, "other": left.name}
    return rule(f"{kind} {right.name}", message, hint, severity=severity, data=whole)


def _turned(limits: tuple[float, float], sign: float) -> tuple[float, float]:
    return limits if sign > 0.0 else (-limits[1], -limits[0])


def _apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]))


def _range_text(joint: Motion) -> str:
    low, high = joint.limits or (-np.inf, np.inf)
    return f"{low:g} to {high:g} {joint.unit}"


def _value(value: float | None) -> str:
    return "unlimited" if value is None else f"{value:g}"


def image(joint: Motion, flip: Array) -> Array:
    """(3,) the axis of the mirror image: a turn is a pseudo-vector."""
    return np.asarray((-1.0 if joint.turns else 1.0) * (flip @ joint.axis))
