"""What of the control data the URDF's writer reads: the ratings of the joints, and the loops."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.loop_mimics import loop_mimics
from assetbuild.robot.model import Actuator, Control, LoopMimic

LOOP_MIMIC = Rule(
    "loop.mimic",
    "error",
    "a loop with `urdf: mimic` does not follow one driven joint, so no mimic joints stand for it",
    "leave `urdf: mimic` out, so that the URDF leaves the loop open",
)


class KeepRatings(Step):
    """`control.json`, `tree.json` -> `ratings.json`: the ratings of the joints and the loops alone.

    Its bytes stay the same when a gain changes, so that no URDF is written and read back anew.
    """

    outputs = ("ratings.json",)

    def run(self, files: Files) -> Iterator[Finding]:
        """Effort, velocity, damping and friction are kept."""
        control = RobotFiles(files.inputs).control
        mimics: tuple[LoopMimic, ...] = ()
        refused: dict[str, str] = {}
        if any(loop.urdf == "mimic" for loop in control.loops):
            mimics, refused = loop_mimics(RobotFiles(files.inputs).tree, control)
        ratings = tuple(map(_rating, control.actuators))
        kept = Control(actuators=ratings, loops=control.loops, loop_mimics=mimics)
        (files.outputs / "ratings.json").write_bytes(encode(kept))
        for name, why in refused.items():
            hint = "leave `urdf: mimic` out: the URDF then leaves the loop open"
            yield LOOP_MIMIC(f"loop {name}", f"no mimic joints can stand for it: {why}", hint)


def _rating(row: Actuator) -> Actuator:
    return Actuator(
        joint=row.joint,
        model="passive",
        damping=row.damping,
        friction=row.friction,
        effort=row.effort,
        velocity=row.velocity,
    )
