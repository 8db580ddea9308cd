"""Does each gripper close on an object, lift it, and hold it while it is shaken, in MuJoCo?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Limits
from assetbuild.findings import Rule
from assetbuild.simulators import mujoco
from assetbuild.simulators.gripping import GripCheck
from assetbuild.simulators.mujoco.grip import Grip, Try, grip
from assetbuild.simulators.mujoco.hands import Hand
from assetbuild.simulators.mujoco.motion import MujocoCheck

NO_HAND = Rule(
    "grip.hand",
    ("info", "warning"),
    "no drive alone closes anything (information), or no object fits into it",
    "name the keyframes of the open and the closed hand: "
    "`validate: {grip: {keyframes: [open, closed]}}`",
)
LOST = Rule(
    "grip.lost",
    "warning",
    "a gripper loses an object in MuJoCo, or lets it slip",
    "contacts of the fingers that are stiffer and resist turning (`contact.links`: `condim: 4, "
    "priority: 1, solref: [0.004, 1]`), "
    "`cone: elliptic`, the rotors' armature, firmer `loops` of linkages, more effort",
)


class Gripping(GripCheck, MujocoCheck):
    """In the full model and in the mjx file; with the forces of both sides in N."""

    also: ClassVar[tuple[str, ...]] = ("mjx",)
    limits: ClassVar[Limits] = Limits(wall_s=1200.0)  # of two hands, on a busy machine
    lost: ClassVar[Rule] = LOST
    no_hand: ClassVar[Rule | None] = NO_HAND

    def models(self, inputs: Path) -> Iterator[tuple[str, str, Path]]:
        """`mjcf/<robot>.xml` and, where it is built, `mjx/<robot>_mjx.xml`."""
        for target, path in mujoco.full_and_mjx(inputs, self.robot):
            yield target, path.name, path

    def grips(
        self, inputs: Path, model: mujoco.Model, hand: Hand, tries: Sequence[Try]
    ) -> Sequence[Grip]:
        """In MuJoCo."""
        return [grip(model, hand, place, mass) for place, mass in tries]
