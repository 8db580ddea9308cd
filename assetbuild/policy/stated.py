"""What a policy's files say of the robot: plain values, joints by name, SI units, radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

ByJoint = Mapping[str, float]


@dataclass(frozen=True)
class Term:
    """One observation. function: its name in `terms.FUNCTIONS`, the file's own where unknown.

    scale: one number, or one for each number of the term; clip: (least, most), before the scale.
    history: how many of the last values are seen, the oldest first. joints: those that it is about.
    """

    name: str
    function: str
    joints: tuple[str, ...] = ()
    scale: tuple[float, ...] = (1.0,)
    clip: tuple[float, float] | None = None
    history: int = 1
    params: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Policy:
    """What one policy's files say.

    file: what was read; network: the ONNX file, None where there is none. joints: all that the file
    counts, in its order; follows: the engine whose order its trainer has, "" where that is open.
    acts_on: the joints of the actions, in their order. kp, kd, position, scale, offset: by joint.
    action_clip: by joint, of the target position, rad. step_s: between two actions.
    digits: what its numbers are rounded to: a relative or an absolute half of the last digit.
    by_time: histories come as the whole observation of each step, rather than each term's own.
    """

    file: Path
    network: Path | None
    joints: tuple[str, ...]
    acts_on: tuple[str, ...]
    position: ByJoint
    scale: ByJoint
    offset: ByJoint
    terms: tuple[Term, ...]
    step_s: float | None
    follows: str = ""
    kp: ByJoint = field(default_factory=dict)
    kd: ByJoint = field(default_factory=dict)
    action_clip: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    digits: tuple[float, float] = (0.0, 0.0)
    by_time: bool = False
    scale_first: bool = False
    start_quat: tuple[float, ...] | None = None
    """w, x, y, z of the base at the start, where the file states it."""

    def same(self, one: float, other: float) -> bool:
        """Whether two numbers agree as far as the file prints them."""
        relative, absolute = self.digits
        return abs(one - other) <= max(relative * max(abs(one), abs(other)), absolute, 1e-6)
