"""The questions that MuJoCo is asked as other simulators are: one class each, with its rules.

What MuJoCo alone is asked has files of its own: `stand`, `trials`, `full_effort`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files, Limits
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.policy.counting import known_joints, order_findings, read_contract
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.mjcf_only import base_brakes, carried_weight
from assetbuild.robot.model import Control
from assetbuild.simulators import mujoco
from assetbuild.simulators.free_fall import FreeFallCheck
from assetbuild.simulators.gripping import GripCheck
from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.mujoco.drives import read_drives, servoed
from assetbuild.simulators.mujoco.grip import Grip, Try, grip
from assetbuild.simulators.mujoco.hands import Hand
from assetbuild.simulators.mujoco.motion import MujocoCheck
from assetbuild.simulators.mujoco.slope import Slope as Sliding
from assetbuild.simulators.mujoco.slope import creep
from assetbuild.simulators.slopes import SlopeCheck

WRONG_DROP = Rule(
    "free_fall.drop",
    ("warning", "error"),
    "the robot does not fall by g/2 t (t + dt) (an error above 5 %)",
    "check whether a part is fixed to the world",
)
CREEP = Rule(
    "slope.creep",
    "warning",
    "a standing robot slides in MuJoCo on a slope below the angle of friction",
    "`cone: elliptic`, a larger `impratio` or more `iterations`, in `mjcf` or `mjx`; where these "
    "are set, a pose that its drives hold: feet below the hips, a larger kp",
)
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
    "`cone: elliptic`, the rotors' armature, firmer `loops` of linkages, more effort, flat pads as "
    "`<collision>` boxes where the faces of the jaws are round or stand in a wedge",
)


class FreeFall(FreeFallCheck, MujocoCheck):
    """Compares the drop of the centre of mass in MuJoCo with g/2 t (t + dt)."""

    own_name = "free_fall"
    wrong: ClassVar[Rule] = WRONG_DROP
    rounding: ClassVar[float] = 1e-9

    def carried(self, control: Control) -> Mapping[str, float]:
        """Any share that is stated."""
        return carried_weight(control.mjcf_only)

    def held(self, control: Control) -> str:
        """Its free joint has what the source's has, so that it falls by no simple law."""
        brakes = base_brakes(control.mjcf_only)
        return f"the source brakes the floating base: {brakes}" if brakes else ""


class PolicyOrders(mujoco.InMujoco):
    """Does MuJoCo count the joints as the policy's contract says?

    Figures: joints, and whether drives are counted as their joints.
    """

    own_name = "policy_orders"
    needs: ClassVar[tuple[str, ...]] = ("policy", "mjcf")
    reads: ClassVar[tuple[str, ...]] = ()

    robot: str
    """Name of the robot: the stem of its files."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Compares names in their order."""
        model = mujoco.load(files.inputs / "mjcf" / f"{self.robot}.xml", visuals=False).model
        counted = list(mujoco.joints(model))
        drives = [drive.joint_name for drive in read_drives(model)]
        alike = drives == [name for name in counted if name in drives]
        contract = read_contract(files.inputs / "policy")
        there = known_joints(contract, counted)
        write_figures(files, {"joints": len(there), "drives_as_joints": alike})
        yield from order_findings(contract, "mujoco", counted)


class Loops(LoopCheck, MujocoCheck):
    """Swings the driven joints of `mjcf/<robot>.xml`, its base held, and measures every gap."""

    own_name = "loops"


class Slope(SlopeCheck, MujocoCheck):
    """The slope in the full model and in the mjx file."""

    own_name = "slope"
    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    also: ClassVar[tuple[str, ...]] = ("mjx",)
    reads: ClassVar[tuple[str, ...]] = ("control.json",)
    creeps: ClassVar[Rule] = CREEP

    def creep(self, inputs: Path, model: mujoco.Model, robot: RobotFiles) -> Sliding | str:
        """Slide in MuJoCo, whose ground tilts while the robot stands on it."""
        return creep(servoed(model, robot.control), self.wish.share, self.wish.speed)


class Gripping(GripCheck, MujocoCheck):
    """Grips in the full model and in the mjx file, with the forces of both sides in N."""

    own_name = "grip"
    also: ClassVar[tuple[str, ...]] = ("mjx",)
    limits: ClassVar[Limits] = Limits(wall_s=1200.0)  # of two hands, on a busy machine
    lost: ClassVar[Rule] = LOST
    no_hand: ClassVar[Rule | None] = NO_HAND

    def grips(
        self, inputs: Path, model: mujoco.Model, hand: Hand, tries: Sequence[Try]
    ) -> Sequence[Grip]:
        """Try all grips in MuJoCo."""
        return [grip(model, hand, place, mass) for place, mass in tries]
