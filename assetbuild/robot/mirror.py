"""Left against right: mass, inertia, axes, limits, first pose and drives of mirrored parts.

A robot is mirrored in one plane through its root. A turn is a pseudo-vector: the mirror image of a
turn by q about `a` is one by q about -M a, with M = diag(1, -1, 1) for the plane y = 0. So where
the right axis is -M a (two knees about +y) both sides have equal ranges; where it is M a (two hips
about +x) they are [l, u] and [-u, -l].

Robots are never quite symmetric: a difference is told as information. What a slip explains is a
warning: a range or a pose with the other side's sign, a mass or a gain twice that of its twin.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from pydantic import Field

from assetbuild.findings import Finding, Rule, Scalar, Severity
from assetbuild.quantities import Model, Positive
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.model import Actuator, Body, Control, Joint, Limits, Tree
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.tree import forward_kinematics

SIDES = (
    r"(?i:left|right)",
    r"(?<![A-Za-z0-9])[lLrR](?![A-Za-z0-9])",
    r"(?<![A-Za-z])[FfRrBbHhMm][lLrR](?![a-z])",
    r"(?<![A-Za-z])[lLrR][FfBbHhMm](?![a-z])",
    r"(?<![A-Za-z0-9])[LR](?=[A-Z][A-Za-z])",
)
"""How names say left and right: `left`, `l_hip`, `FL`, `LF`, `LHip`."""
OTHER = {"left": "right", "right": "left", "l": "r", "r": "l"}
SLIP = 2.0
"""Times the twin's value: more than two builds of one part differ by."""
DRIVE = ("kp", "kd", "damping", "friction", "armature", "effort", "velocity")
"""What of an `Actuator` is compared; a joint that nothing drives yet has the last two."""
PLANES = (1, 0, 2)
"""Axes of the root that may point to the side, the usual one first."""

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
    "correct the source, if it is a mistake",
)
HOME = Rule(
    "mirror.home",
    ("info", "warning"),
    "the first keyframe is not its own mirror image (a warning when it has the sign of the other "
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
        0.005, description="m: parts whose places mirror each other so closely are compared"
    )
    mass: Positive = Field(0.02, description="relative difference of mass")
    center: Positive = Field(0.005, description="m, of the centre of mass")
    inertia: Positive = Field(0.1, description="relative difference of inertia")
    axis: Positive = Field(0.02, description="rad, between an axis and its mirror image")
    limits: Positive = Field(0.005, description="rad or m, of either end of a range")
    home: Positive = Field(0.001, description="rad or m, at the first keyframe")
    gains: Positive = Field(
        0.01, description="relative, of kp, kd, damping, friction, armature, effort, velocity"
    )


@dataclass(frozen=True)
class Motion:
    """One joint of a part. axis: (3,) in the frame of the root; home: at the first keyframe.

    limits: None = unlimited. drive: kp, kd, effort, ... by name; None = unlimited or unstated.
    """

    name: str
    turns: bool
    axis: Array
    limits: tuple[float, float] | None = None
    home: float | None = None
    drive: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def unit(self) -> str:
        """Of its coordinate."""
        return "rad" if self.turns else "m"


@dataclass(frozen=True)
class Part:
    """A body with the joints that carry it, all at 0, in the frame of the root.

    place, com: (3,) m; inertia: (3, 3) kg m2 about the centre of mass. mass 0: it has none.
    """

    name: str
    place: Array
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    joints: tuple[Motion, ...] = ()


def parts_of(tree: Tree, control: Control) -> tuple[Part, ...]:
    """Every body of a robot with what the table and the first keyframe say of its joint."""
    poses = forward_kinematics(tree, {})
    home = dict(control.keyframes[0].joints) if control.keyframes else {}
    parts = []
    for body in tree.bodies:
        joint = tree.joint_above.get(body.name)
        moving = joint is not None and joint in tree.moving_joints and joint.mimic is None
        motions = (
            (_motion(joint, poses[body.name], home, control.by_joint.get(joint.name)),)
            if joint is not None and moving
            else ()
        )
        parts.append(_part(body, poses[body.name], motions))
    return tuple(parts)


def _part(body: Body, X_root_body: Pose, joints: tuple[Motion, ...]) -> Part:
    place = np.asarray(X_root_body.xyz)
    if body.inertial is None:
        return Part(body.name, place, joints=joints)
    turn = X_root_body.rotation
    return Part(
        body.name,
        place,
        body.inertial.mass_kg,
        X_root_body.apply(body.inertial.com_m),
        turn @ matrix_of(body.inertial.inertia_com_kg_m2) @ turn.T,
        joints,
    )


def _motion(
    joint: Joint, X_root_child: Pose, home: Mapping[str, float], drive: Actuator | None
) -> Motion:
    lower, upper = joint.limits.lower, joint.limits.upper
    source: Actuator | Limits = drive or joint.limits
    values = {name: getattr(source, name) for name in DRIVE if hasattr(source, name)}
    return Motion(
        joint.name,
        joint.kind != "prismatic",
        X_root_child.rotation @ np.asarray(joint.axis),
        None if lower is None or upper is None else (lower, upper),
        home.get(joint.name),
        values,
    )


# --- who belongs to whom --------------------------------------------------------------------


@dataclass(frozen=True)
class Twins:
    """Pairs of parts (left, right), and the axis of the root that points to the side."""

    pairs: tuple[tuple[Part, Part], ...]
    axis: int

    @property
    def flip(self) -> Array:
        """(3, 3) mirror image."""
        flip = np.eye(3)
        flip[self.axis, self.axis] = -1.0
        return flip


def twins(parts: Sequence[Part], tolerance_m: float = Tolerances().place) -> Twins:
    """Parts whose names say left and right and whose places are mirror images.

    Fingers of one hand, or an arm beside another, are mirrored elsewhere and are no twins.
    """
    named = _named(parts)
    found = [
        Twins(
            tuple((a, b) for a, b in named if _opposite(a.place, b.place, axis, tolerance_m)),
            axis,
        )
        for axis in PLANES
    ]
    return max(found, key=lambda one: len(one.pairs))  # the first of equals


def _opposite(p: Array, q: Array, axis: int, tolerance_m: float) -> bool:
    image = np.array(p)
    image[axis] *= -1.0
    return bool(np.linalg.norm(image - q) <= tolerance_m <= abs(p[axis]))


def _named(parts: Sequence[Part]) -> list[tuple[Part, Part]]:
    """By the body's name, or by that of its joint."""
    bodies = {part.name: part for part in parts}
    joints = {motion.name: part for part in parts for motion in part.joints}
    found = []
    for left in parts:
        right = bodies.get(other_side(left.name, bodies))
        for motion in left.joints:
            right = right or joints.get(other_side(motion.name, joints))
        if right is not None and right is not left:
            found.append((left, right))
    return found


def other_side(name: str, known: Collection[str]) -> str:
    """The name on the right of one on the left, "" when there is none among the known.

    A left finger of the left hand is the image of the right finger of the right hand, where there
    is one: all words for a side change before one alone does.
    """
    for pattern in SIDES:
        words = list(re.finditer(pattern, name))
        for chosen in ([words] if len(words) > 1 else []) + [[word] for word in words]:
            if _is_left(chosen[0][0]):
                other = _with_others(name, chosen)
                if other in known:
                    return other
    return ""


def _with_others(name: str, words: Sequence[re.Match[str]]) -> str:
    for word in reversed(words):  # from the end, so that the places before stay
        name = name[: word.start()] + _other_word(word[0]) + name[word.end() :]
    return name


def _other_word(word: str) -> str:
    """`Left` -> `Right`, `FL` -> `FR`, `lf` -> `rf`: in the letters of the word."""
    if word.lower() in OTHER:
        other = OTHER[word.lower()]
        return other.upper() if word.isupper() else other.capitalize() if word.istitle() else other
    at = _side_letter(word)
    letter = OTHER[word[at].lower()]
    return word[:at] + (letter.upper() if word[at].isupper() else letter) + word[at + 1 :]


def _side_letter(word: str) -> int:
    """Where a word of two letters says the side: `RL` is rear left, `LH` left hind."""
    return 1 if word[1].lower() in "lr" else 0


def _is_left(word: str) -> bool:
    word = word.lower()
    return word in ("left", "l") or (len(word) == 2 and word[_side_letter(word)] == "l")


# --- what differs ---------------------------------------------------------------------------


def mirror_findings(found: Twins, allowed: Tolerances) -> Iterator[Finding]:
    """All that two twins differ in by more than allowed, right against left."""
    for left, right in found.pairs:
        if left.mass > 0.0 and right.mass > 0.0:
            yield from _masses(left, right, found.flip, allowed)
        if len(left.joints) == len(right.joints):
            for one, other in zip(left.joints, right.joints, strict=True):
                if one.turns == other.turns:
                    yield from _motions(one, other, found.flip, allowed)
                    yield from _drives(one, other, allowed)


def _masses(left: Part, right: Part, flip: Array, allowed: Tolerances) -> Iterator[Finding]:
    apart = abs(left.mass - right.mass) / max(left.mass, right.mass)
    if apart > allowed.mass:
        yield _finding(
            MASS,
            f"link {right.name}",
            left.name,
            f"{right.mass:.4g} kg, but `{left.name}` has {left.mass:.4g} kg",
            "edit `set_mass`, of the side that is wrong",
            max(left.mass, right.mass) >= SLIP * min(left.mass, right.mass),
            {"mass_kg": right.mass, "mass_of_other_kg": left.mass},
        )
    away = float(np.linalg.norm(flip @ left.com - right.com))
    if away > allowed.center:
        yield _finding(
            CENTER,
            f"link {right.name}",
            left.name,
            f"its centre of mass is {1e3 * away:.3g} mm from the mirror image of `{left.name}`'s",
            "edit `set_inertia`; a sign that was not turned, or the same part on both sides?",
            False,
            {"distance_m": away},
        )
    yield from _inertias(left, right, flip, allowed)


def _inertias(left: Part, right: Part, flip: Array, allowed: Tolerances) -> Iterator[Finding]:
    wanted = flip @ left.inertia @ flip
    own, other = (float(np.linalg.norm(part)) for part in (right.inertia, wanted))
    difference = float(np.linalg.norm(wanted - right.inertia)) / (max(own, other) or 1.0)
    if difference > allowed.inertia:
        yield _finding(
            INERTIA,
            f"link {right.name}",
            left.name,
            f"its inertia (largest {_largest(right):.3g} kg m²) is {difference:.0%} off the mirror "
            f"image of `{left.name}`'s (largest {_largest(left):.3g} kg m²)",
            "edit `set_inertia`; a sign of a product of inertia lost?",
            max(own, other) >= SLIP**2 * min(own, other),
            {"relative": difference},
        )


def _largest(part: Part) -> float:
    """kg m2, principal moment."""
    return max(0.0, float(np.linalg.eigvalsh(part.inertia)[-1]))


def _motions(left: Motion, right: Motion, flip: Array, allowed: Tolerances) -> Iterator[Finding]:
    image = (-1.0 if left.turns else 1.0) * (flip @ left.axis)
    cosine = float(np.clip(image @ right.axis, -1.0, 1.0))
    angle = float(np.arccos(abs(cosine)))
    if angle > allowed.axis:
        yield _finding(
            AXES,
            f"joint {right.name}",
            left.name,
            f"its axis is {np.degrees(angle):.3g} degrees off the mirror image of `{left.name}`'s",
            "edit `flip_axis` turns an axis round; a tilt stands in the source",
            False,
            {"angle_rad": angle},
        )
        return
    sign = 1.0 if cosine > 0.0 else -1.0
    slipped = False
    if left.limits != right.limits or sign < 0.0:
        for finding in _limits(left, right, sign, allowed.limits):
            slipped = slipped or finding.severity == "warning"
            yield finding
    if not slipped:  # a joint that counts the wrong way has the wrong pose too
        yield from _home(left, right, sign, allowed.home)


def _limits(left: Motion, right: Motion, sign: float, tolerance: float) -> Iterator[Finding]:
    if left.limits is None and right.limits is None:
        return
    if left.limits is None or right.limits is None:
        one, other = (left, right) if left.limits is None else (right, left)
        message = f"`{one.name}` has no limits, but `{other.name}` has {_shown(other)}"
        yield _limit_finding(left, right, message, slip=False, counts="")
        return
    wanted = _turned(left.limits, sign)
    if _apart(wanted, right.limits) <= tolerance:
        return
    swapped = _apart(_turned(wanted, -1.0), right.limits) <= tolerance
    message = f"its range is {_shown(right)}, but as the mirror image of `{left.name}` it would be "
    message += f"{wanted[0]:g} to {wanted[1]:g} {right.unit}"
    counts = f"flip_axis: {{joint: {right.name}, limits: keep}}"
    yield _limit_finding(left, right, message, swapped, counts)


def _limit_finding(left: Motion, right: Motion, message: str, slip: bool, counts: str) -> Finding:
    hint = "edit `set_limits`, of the side that is wrong"
    if slip:
        message += ": the limits of left and right are swapped, or an axis points the wrong way"
        hint = f"`set_limits` for swapped limits; `{counts}`, or of the other, for an axis"
    data: dict[str, Scalar] = {}
    for joint, ending in ((left, "_of_other"), (right, "")):
        if joint.limits is not None:
            data |= {f"lower{ending}": joint.limits[0], f"upper{ending}": joint.limits[1]}
    return _finding(LIMITS, f"joint {right.name}", left.name, message, hint, slip, data)


def _home(left: Motion, right: Motion, sign: float, tolerance: float) -> Iterator[Finding]:
    if left.home is None or right.home is None:
        return
    wanted = sign * left.home
    if abs(wanted - right.home) <= tolerance:
        return
    turned = abs(wanted + right.home) <= tolerance
    yield _finding(
        HOME,
        f"joint {right.name}",
        left.name,
        f"the first keyframe has it at {right.home:g} {right.unit}; as the mirror image of "
        f"`{left.name}` it would be at {wanted:g}",
        "correct the keyframe, unless the pose leans on purpose",
        turned,
        {"position": right.home, "mirrored": wanted},
    )


def _drives(left: Motion, right: Motion, allowed: Tolerances) -> Iterator[Finding]:
    for name, own in right.drive.items():
        other = left.drive.get(name)
        if own == other:
            continue
        values = [abs(v) if v is not None else np.inf for v in (own, other)]
        small, large = min(values), max(values)
        if np.isfinite(large) and large - small <= allowed.gains * large:
            continue
        yield _finding(
            GAINS,
            f"actuator {right.name}",
            left.name,
            f"its {name} is {_value(own)}, but that of `{left.name}` is {_value(other)}",
            "one row of `actuators` for both",
            large >= SLIP * small,
            {"of": name, "value": own, "value_of_other": other},
        )


def _finding(
    rule: Rule,
    subject: str,
    other: str,
    message: str,
    hint: str,
    slip: bool,
    data: Mapping[str, Scalar],
) -> Finding:
    severity: Severity = "warning" if slip else "info"
    return rule(subject, message, hint, severity=severity, data={**data, "other": other})


def _turned(limits: tuple[float, float], sign: float) -> tuple[float, float]:
    return limits if sign > 0.0 else (-limits[1], -limits[0])


def _apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]))


def _shown(joint: Motion) -> str:
    low, high = joint.limits or (-np.inf, np.inf)
    return f"{low:g} to {high:g} {joint.unit}"


def _value(value: float | None) -> str:
    return "unlimited" if value is None else f"{value:g}"
