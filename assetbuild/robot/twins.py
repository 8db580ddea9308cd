"""Which parts of a robot are mirror images of one another: by their names and their places."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from assetbuild.robot.inertia import move_inertial
from assetbuild.robot.model import MOVING, Control, Inertial, Joint, Tree
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


NOTHING = Inertial(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Part:
    """A body where all joints are at 0, in the frame of the root, and the joint that moves it.

    inertial: of mass 0 where none is stated. joint: None where the body is held, or follows
    another. home: the joint at the initial keyframe.
    drive: kp, kd, effort, ... by name; None = unlimited or unstated.
    """

    name: str
    X_root_body: Pose
    inertial: Inertial
    joint: Joint | None = None
    home: float | None = None
    drive: Mapping[str, float | None] = field(default_factory=dict)


def _parts(tree: Tree, control: Control) -> tuple[Part, ...]:
    """Every body of a robot with what the table and the initial keyframe say of its joint."""
    poses = forward_kinematics(tree, {})
    initial = control.initial_keyframe
    home = dict(initial.joints) if initial else {}
    parts = []
    for body in tree.bodies:
        X_root_body, joint = poses[body.name], tree.joint_above.get(body.name)
        inertial = move_inertial(body.inertial or NOTHING, X_root_body)
        if joint is None or joint.kind not in MOVING or joint.mimic is not None:
            parts.append(Part(body.name, X_root_body, inertial))
            continue
        source = control.by_joint.get(joint.name) or joint.limits
        # Measured twins may differ: that is what was found.
        known = [name for name in DRIVE if name not in getattr(source, "measured", ())]
        drive = {name: getattr(source, name) for name in known if hasattr(source, name)}
        parts.append(Part(body.name, X_root_body, inertial, joint, home.get(joint.name), drive))
    return tuple(parts)


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


def twins(tree: Tree, control: Control, tolerance_m: float = PLACE_M) -> Twins:
    """Parts whose names say left and right and whose places are mirror images.

    Fingers of one hand, or an arm beside another, are mirrored elsewhere and are no twins.
    """
    named = _named(_parts(tree, control))
    candidates = []
    for axis in PLANES:
        pairs = [(a, b) for a, b in named if _is_opposite(a, b, axis, tolerance_m)]
        candidates.append(Twins(tuple(pairs), axis))
    return max(candidates, key=lambda one: len(one.pairs))  # the first of equals


def _is_opposite(one: Part, other: Part, axis: int, tolerance_m: float) -> bool:
    """Whether their places mirror each other in a plane through the root, off that plane."""
    image = list(one.X_root_body.xyz)
    image[axis] *= -1.0
    return math.dist(image, other.X_root_body.xyz) <= tolerance_m <= abs(image[axis])


def _named(parts: Sequence[Part]) -> list[tuple[Part, Part]]:
    """Pair them by the body's name, or by that of its joint."""
    bodies = {part.name: part for part in parts}
    joints = {part.joint.name: part for part in parts if part.joint}
    pairs = []
    for left in parts:
        right = bodies.get(other_side(left.name, bodies))
        if right is None and left.joint:
            right = joints.get(other_side(left.joint.name, joints))
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
