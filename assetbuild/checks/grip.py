"""Does each gripper close on an object, lift it, and hold it while it is shaken?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.quantities import Positive
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco_grip import Grip, grip, hands_of, named, tries_of, with_object
from assetbuild.simulators.mujoco_hands import Hand

LEAST_KG = 0.005
"""Less is not tried for a hand that drops what it should hold."""

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
    "`cone: elliptic`, the rotors' armature, more effort",
)


class Gripping(Check):
    """Grips a cube, a cylinder and a sphere of 40 mm, or less where the hand is smaller.

    Friction 1; closed in 1 s on a table, lifted in 1.5 s, shaken for 1 s, held for 5 s. Findings
    `grip.lost` and `grip.hand`; figures by file and palm: of each object the slip in m and the
    forces of both sides in N.
    """

    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    also: ClassVar[tuple[str, ...]] = ("mjx",)
    reads: ClassVar[tuple[str, ...]] = ()

    engines: ClassVar[tuple[str, ...]] = ("mujoco",)
    section: ClassVar[str] = "validate.grip"
    about: ClassVar[str] = "grip, lift, shake and hold objects in MuJoCo; {} = defaults"
    wanted: ClassVar[bool] = False

    robot: str
    masses: tuple[Positive, ...] = Field((0.1, 0.5), description="kg, of the objects")
    slip: Positive = Field(0.002, description="m that an object may move in the hand, warning")
    keyframes: tuple[str, str] | None = Field(
        None,
        description="of the open and of the closed hand; without them, what one drive closes, or "
        "two drives of facing fingers, is found",
    )

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/<robot>.xml` and, where it is built, `mjx/<robot>_mjx.xml`."""
        figures: dict[str, object] = {}
        for folder, path in mujoco.full_and_mjx(files.inputs, self.robot):
            try:
                with mujoco.caught_warnings():
                    figures[folder], findings = self._examine(path)
            except StepError as error:
                figures[folder] = {"skipped": error.message}
                message = f"{path.name}: {error.message}"
                findings = [NO_HAND("robot", message, hint=error.hint, severity="warning")]
            yield from findings
        write_figures(files, figures, {"slip_m": self.slip})

    def _examine(self, path: Path) -> tuple[dict[str, object], list[Finding]]:
        """(figures by palm, findings) of one file; StepError where it cannot be tried."""
        model = with_object(path)
        hands = hands_of(model, self.keyframes)
        if not hands:
            message = f"{path.name}: no drive alone closes anything like a gripper"
            return {}, [NO_HAND("robot", message)]
        figures: dict[str, object] = {}
        findings: list[Finding] = []
        for hand in hands:
            palm = mujoco.name_of(model, "body", hand.palm)
            tries = tries_of(model, hand, self.masses)
            grips = [grip(model, hand, place, mass) for place, mass in tries]
            figures[palm] = [_row(one) for one in grips]
            findings += self._judge(path.name, palm, model, hand, grips)
        return figures, findings

    def _judge(
        self, file: str, palm: str, model: mujoco.Model, hand: Hand, grips: Sequence[Grip]
    ) -> Iterator[Finding]:
        if not grips:
            message = f"{file}: no object fits into the hand of `{palm}`"
            yield NO_HAND("robot", message, severity="warning")
        failed = [one for one in grips if not one.held or one.slip_m > self.slip]
        if failed:
            yield LOST(
                f"link {palm}",
                f"{file}: of {len(grips)} objects its gripper does not hold {len(failed)}: "
                + ", ".join(map(_words, failed))
                + self._holds(model, hand, failed),
                data={"failed": len(failed), "of": len(grips), "limit_m": self.slip},
            )

    def _holds(self, model: mujoco.Model, hand: Hand, failed: Sequence[Grip]) -> str:
        """What the hand holds of the shape whose lightest it lost; nothing where it held that."""
        lightest = next((one for one in failed if one.mass == min(self.masses)), None)
        if lightest is None:
            return ""
        mass = lightest.mass / 2.0
        while mass >= LEAST_KG:
            found = grip(model, hand, lightest.place, mass)
            if found.held and found.slip_m <= self.slip:
                return f"; it holds a {found.place.shape} of {mass:.3g} kg"
            mass /= 2.0
        return f"; nor a {lightest.place.shape} of {2.0 * mass:.3g} kg"


def _row(one: Grip) -> dict[str, object]:
    return {
        "shape": one.place.shape,
        "mass_kg": one.mass,
        "width_m": one.place.width_m,
        "held": one.held,
        "slip_m": one.slip_m if one.held else None,
        "seat_m": one.seat_m if one.held else None,
        "forces_n": list(one.forces_n) if one.held else None,
    }


def _words(one: Grip) -> str:
    did = f"slips by {1e3 * one.slip_m:.3g} mm" if one.held else "is lost"
    return f"{named(one.place, one.mass)} {did}"
