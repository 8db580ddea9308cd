"""Does each gripper hold objects in PhysX as well?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Limits
from assetbuild.findings import Rule
from assetbuild.simulators import mujoco
from assetbuild.simulators.gripping import GripCheck
from assetbuild.simulators.mujoco.grip import Grip, Try
from assetbuild.simulators.mujoco.hands import Hand
from assetbuild.simulators.physx import PhysxCheck
from assetbuild.simulators.physx.grip import grips

LOST = Rule(
    "physx.grip",
    "warning",
    "a gripper loses an object in PhysX, or lets it slip",
    "more effort, collision pieces that do not fill the space between the fingers",
)


class PhysxGripping(GripCheck, PhysxCheck):
    """Does in PhysX what `grip` does in MuJoCo, whose model says where the objects lie."""

    usual_s = 60.0
    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    limits: ClassVar[Limits] = Limits(wall_s=1200.0, memory_mb=16384)
    lost: ClassVar[Rule] = LOST

    def models(self, inputs: Path) -> Iterator[tuple[str, str, Path]]:
        """The hands are those of `mjcf/<robot>.xml`."""
        yield "usd", "PhysX", inputs / f"mjcf/{self.robot}.xml"

    def grips(
        self, inputs: Path, model: mujoco.Model, hand: Hand, tries: Sequence[Try]
    ) -> Sequence[Grip]:
        """In PhysX, all in one process."""
        main = inputs / f"usd/{self.robot}.usda"
        return grips(main, model, hand, tries, self.limits.wall_s / 2.0)
