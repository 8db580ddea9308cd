"""What of the control data the URDF's writer reads: the ratings of the joints, and the loops."""

from __future__ import annotations

from collections.abc import Iterable

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Actuator, Control


class KeepRatings(Step):
    """`control.json` -> `ratings.json`: the ratings of the joints and the loops alone.

    Its bytes stay the same when a gain changes, so that no URDF is written and read back anew.
    """

    outputs = ("ratings.json",)

    def run(self, files: Files) -> Iterable[Finding]:
        """Effort, velocity, damping and friction are kept."""
        control = RobotFiles(files.inputs).control
        kept = Control(actuators=tuple(map(_rating, control.actuators)), loops=control.loops)
        (files.outputs / "ratings.json").write_bytes(encode(kept))
        return ()


def _rating(row: Actuator) -> Actuator:
    return Actuator(
        joint=row.joint,
        model="passive",
        damping=row.damping,
        friction=row.friction,
        effort=row.effort,
        velocity=row.velocity,
    )
