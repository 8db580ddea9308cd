"""What of the control data poses a robot: its keyframes and what may touch what."""

from __future__ import annotations

from collections.abc import Iterable

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Contact, Control


class KeepPose(Step):
    """`control.json` -> `control.json` without gains, friction, sensors and time.

    Its bytes stay the same when only those change, so that no picture is made anew.
    """

    outputs = ("control.json",)

    def run(self, files: Files) -> Iterable[Finding]:
        """Keyframes, excludes and the contact masks are kept."""
        control = RobotFiles(files.inputs).control
        kept = Control(
            keyframes=control.keyframes,
            excludes=control.excludes,
            contact=_masks(control.contact),
            contacts=tuple((name, _masks(contact)) for name, contact in control.contacts),
        )
        (files.outputs / "control.json").write_bytes(encode(kept))
        return ()


def _masks(contact: Contact) -> Contact:
    return Contact(mask=contact.mask, partners=contact.partners)
