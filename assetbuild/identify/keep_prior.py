"""What of the control data a fit reads: joints and gains, without what the log does not know."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from assetbuild.engine.step import Files, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.identify.plant import OF_JOINTS
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.identify import Recorded, by_joint
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Keyframe

POSITION = ("pd", "ideal_pd", "dc_motor")
"""Models whose kp and kd are those of a position controller."""


class KeepPrior(Step):
    """`control.json`, `tree.json` -> `prior.json`: drives with the gains of the recording.

    Its bytes stay the same when a gain, a contact or a sensor changes, so that nothing is fitted
    anew.
    """

    outputs = ("prior.json",)

    joints: tuple[str, ...]
    recorded: Recorded | None = None

    def run(self, files: Files) -> Iterable[Finding]:
        """Raises StepError for a joint whose gains while recording nobody states."""
        robot = RobotFiles(files.inputs)
        control, tree = robot.control, robot.tree
        rows = tuple(self._row(control.by_joint[name]) for name in self.joints)
        others = [joint.name for joint in tree.moving_joints if joint.name not in self.joints]
        pose = dict(initial_pose(tree, control).joints)
        rest = Keyframe("home", tuple((name, pose.get(name, 0.0)) for name in others))
        kept = Control(
            actuators=rows,
            keyframes=(rest,),
            loops=control.loops,
            mjcf_only=tuple(item for item in control.mjcf_only if item.place in OF_JOINTS),
        )
        (files.outputs / "prior.json").write_bytes(encode(kept))
        return ()

    def _row(self, row: Actuator) -> Actuator:
        kp, kd = row.kp, row.kd
        if self.recorded is not None:
            kp, kd = (by_joint(table, row.joint) for table in (self.recorded.kp, self.recorded.kd))  # type: ignore[assignment] # None is refused below
        if kp is None or kd is None:
            raise StepError(
                f"identify: `recorded` states no gains of joint {row.joint}",
                hint="give one number for all joints, or a pattern for each of them",
            )
        if self.recorded is None and (row.model not in POSITION or not kp):
            raise StepError(
                f"identify: joint {row.joint} has the model `{row.model}` in the actuator table, "
                "which does not say under which gains the log was taken",
                hint="state `recorded: {kp: .., kd: ..}` for the entry",
            )
        plain = replace(row, model="pd", kp=kp, kd=kd, velocity=None, stall=None, ctrl=None)
        return replace(plain, general=None, motor="", source="", name="", gear=1.0)
