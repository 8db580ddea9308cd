"""Which parts of a robot are mirror images of one another: by their names and their places."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.model import Actuator, Body, Control, Joint, Limits, Tree
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.tree import forward_kinematics

SIDES = (
    r"((?i:left|right))",
    r"(?<![A-Za-z0-9])([lLrR])(?![A-Za-z0-9])",
    r"(?<![A-Za-z])[FfRrBbHhMm]([lLrR])(?![a-z])",
    r"(?<![A-Za-z])([lLrR])[FfBbHhMm](?![a-z])",
    r"(?<![A-Za-z0-9])([LR])(?=[A-Z][A-Za-z])",
)
"""How names say left and right: `left`, `l_hip`, `FL`, `LF`, `LHip`. The group is the side: `RL` is
rear left."""
OTHER = {"left": "right", "right": "left", "l": "r", "r": "l"}
DRIVE = ("kp", "kd", "damping", "friction", "armature", "effort", "velocity")
"""What of an `Actuator` is compared; a joint that nothing drives yet has the last two."""
PLANES = (1, 0, 2)
"""Axes of the root that may point to the side, the usual one first."""
PLACE_M = 0.005
"""How far a place may be from the mirror image of its twin's."""


@dataclass(frozen=True)
class Motion:
    """One joint of a part. axis: (3,) in the frame of the root; home: at the initial keyframe.

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
        """The unit of the joint's coordinate."""
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
    """Every body of a robot with what the table and the initial keyframe say of its joint."""
    poses = forward_kinematics(tree, {})
    initial = control.initial_keyframe
    home = dict(initial.joints) if initial else {}
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
    # Measured twins may differ: that is what was found.
    measured = drive.measured if drive else ()
    known = (name for name in DRIVE if name not in measured)
    values = {name: getattr(source, name) for name in known if hasattr(source, name)}
    return Motion(
        joint.name,
        joint.kind != "prismatic",
        X_root_child.rotation @ np.asarray(joint.axis),
        None if lower is None or upper is None else (lower, upper),
        home.get(joint.name),
        values,
    )


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


def twins(parts: Sequence[Part], tolerance_m: float = PLACE_M) -> Twins:
    """Parts whose names say left and right and whose places are mirror images.

    Fingers of one hand, or an arm beside another, are mirrored elsewhere and are no twins.
    """
    named = _named(parts)
    candidates = [
        Twins(
            tuple((a, b) for a, b in named if is_opposite(a.place, b.place, axis, tolerance_m)),
            axis,
        )
        for axis in PLANES
    ]
    return max(candidates, key=lambda one: len(one.pairs))  # the first of equals


def is_opposite(p: Array, q: Array, axis: int, tolerance_m: float = PLACE_M) -> bool:
    """Whether two places (3,), m, mirror each other in a plane through the root, off that plane."""
    image = np.array(p)
    image[axis] *= -1.0
    return bool(np.linalg.norm(image - q) <= tolerance_m <= abs(p[axis]))


def _named(parts: Sequence[Part]) -> list[tuple[Part, Part]]:
    """By the body's name, or by that of its joint."""
    bodies = {part.name: part for part in parts}
    joints = {motion.name: part for part in parts for motion in part.joints}
    pairs = []
    for left in parts:
        right = bodies.get(other_side(left.name, bodies))
        for motion in left.joints:
            right = right or joints.get(other_side(motion.name, joints))
        if right is not None and right is not left:
            pairs.append((left, right))
    return pairs


def other_side(name: str, known: Collection[str]) -> str:
    """The name on the right of one on the left, "" when there is none among the known.

    A left finger of the left hand is the image of the right finger of the right hand, where there
    is one: all words for a side change before one alone does.
    """
    for pattern in SIDES:
        words = list(re.finditer(pattern, name))
        for chosen in ([words] if len(words) > 1 else []) + [[word] for word in words]:
            if chosen[0][1].lower() in ("left", "l"):
                other = _with_others(name, chosen)
                if other in known:
                    return other
    return ""


def _with_others(name: str, words: Sequence[re.Match[str]]) -> str:
    """`Left` -> `Right`, `FL` -> `FR`, `lf` -> `rf`: in the letters of the word."""
    for word in reversed(words):  # from the end, so that the places before stay
        side, other = word[1], OTHER[word[1].lower()]
        other = other.upper() if side.isupper() else other.title() if side.istitle() else other
        name = name[: word.start(1)] + other + name[word.end(1) :]
    return name
