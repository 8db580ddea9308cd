"""The actuators with what was measured in place of the table's numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.effort_words import of_same_effort
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.identified import Fit
from assetbuild.robot.model import Actuator

PLAIN = ("armature", "damping", "friction", "effort")
SCALED = ("kp", "kd")
"""Gains: the drive gives this multiple of what it was asked for while recording."""

USED = Rule(
    "identify.used",
    "info",
    "parameters of the actuator table come from logs of the real robot",
    "nothing; `use: false` builds with the priors",
)


class UseFits(Step):
    """`control.json`, `fits/<n>.json` -> `control.json`.

    A number that a row of the table states as measured stays as it is: a person has reviewed it.
    """

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
    found = dict(rows)
    files = ", ".join(f"{log.file} ({log.sha256[:12]})" for log in fit.logs)
    for parameter in fit.parameters:
        for joint in parameter.joints:
            row = found[joint]
            if parameter.refused or parameter.name in row.measured or parameter.name == "delay":
                continue
            value = parameter.value
            if parameter.name in SCALED:
                asked = gains[joint][parameter.name]
                value = getattr(row, parameter.name) * value / asked if asked else value
            changed = {parameter.name: value, "source": f"measured: {files}"}
            measured = (*row.measured, parameter.name)
            found[joint] = replace(row, **changed, measured=measured)  # type: ignore[arg-type] # names of its fields
    return found
