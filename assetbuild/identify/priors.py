"""The actuators on their way into a fit, and with what it measured in place of their numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from assetbuild.engine.step import Files, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.identify.record import OF_JOINTS
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.identify import Fit, Recorded
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import of_same_effort
from assetbuild.robot.model import Actuator, Control, Keyframe
from assetbuild.robot.ranges import by_joint

POSITION = ("pd", "ideal_pd", "dc_motor")
"""Models whose kp and kd are those of a position controller."""


class KeepPrior(Step):
    """`control.json`, `tree.json` -> `prior.json`: drives with the gains of the recording.

    Its bytes stay the same when a gain, a contact or a sensor changes, so that nothing is fitted
    anew.
    """

    own_name = "keep_prior"
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


SCALED = ("kp", "kd")
"""Gains: the drive gives this multiple of what it was asked for while recording."""

USED = Rule(
    "identify.used",
    "info",
    "parameters of the actuator table come from logs of the real robot",
    "nothing; `apply: false` builds with the priors",
)


class UseFits(Step):
    """`control.json`, `fits/<n>.json` -> `control.json`.

    A number that a row of the table states as measured stays as it is: a person has reviewed it.
    """

    own_name = "use_fits"
    outputs = ("control.json",)

    fits: int

    def run(self, files: Files) -> Iterator[Finding]:
        """Yields what came from which log."""
        control = RobotFiles(files.inputs).control
        rows = dict(control.by_joint)
        for number in range(self.fits):
            fit = decode_file(Fit, files.inputs / "fits" / f"{number}.json")
            rows = with_fit(rows, fit)
            known = [p for p in fit.parameters if not p.refused]
            names = ", ".join(log.file for log in fit.logs)
            yield USED(
                "recipe identify",
                f"{len(known)} of {len(fit.parameters)} parameters are identified from {names}",
                data={"identified": len(known), "parameters": len(fit.parameters)},
            )
        changed = replace(control, actuators=tuple(rows.values()))
        words = tuple(of_same_effort(control.mjcf_only, control.by_joint, changed.by_joint))
        (files.outputs / "control.json").write_bytes(encode(replace(changed, mjcf_only=words)))


def with_fit(rows: dict[str, Actuator], fit: Fit) -> dict[str, Actuator]:
    """The actuators by joint, with the parameters that the fit identified."""
    gains = {joint: {"kp": kp, "kd": kd} for joint, kp, kd in fit.recorded}
    fitted = dict(rows)
    files = ", ".join(f"{log.file} ({log.sha256[:12]})" for log in fit.logs)
    for parameter in fit.parameters:
        for joint in parameter.joints:
            row = fitted[joint]
            if parameter.refused or parameter.name in row.measured or parameter.name == "delay":
                continue
            value = parameter.value
            if parameter.name in SCALED:
                asked = gains[joint][parameter.name]
                value = getattr(row, parameter.name) * value / asked if asked else value
            changed = {parameter.name: value, "source": f"measured: {files}"}
            measured = (*row.measured, parameter.name)
            fitted[joint] = replace(row, **changed, measured=measured)  # type: ignore[arg-type] # names of its fields
    return fitted
