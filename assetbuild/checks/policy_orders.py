"""Does MuJoCo count the joints in the order that the policy's contract says?"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.drives import read_drives

WRONG = Rule(
    "policy.engine_order",
    "error",
    "an engine counts the joints in another order than the policy's contract says",
    "if nobody edited the bundle, this is a bug: please report it",
)


class PolicyOrders(mujoco.InMujoco):
    """Asks the compiled model. Figures: joints, and whether drives are counted as their joints."""

    needs: ClassVar[tuple[str, ...]] = ("policy", "mjcf")
    reads: ClassVar[tuple[str, ...]] = ()

    robot: str
    """Name of the robot: the stem of its files."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Compares names in their order."""
        contract = read_yaml(_contract(files.inputs / "policy"))
        model = mujoco.load(files.inputs / "mjcf" / f"{self.robot}.xml", visuals=False).model
        counted = list(mujoco.joints(model))
        known = set(contract["joints"])
        there = [name for name in counted if name in known]  # what is split up has other names
        stated = [name for name in contract["orders"]["mujoco"] if name in there]
        drives = [drive.joint_name for drive in read_drives(model)]
        alike = drives == [name for name in counted if name in drives]
        write_figures(files, {"joints": len(there), "drives_as_joints": alike})
        for place, (one, other) in enumerate(zip(stated, there, strict=True)):
            if one != other:
                text = f"MuJoCo has `{other}` at place {place}, where the contract has `{one}`"
                yield WRONG("robot", text, data={"place": place})
                return


def _contract(folder: Path) -> Path:
    return next(iter(sorted(folder.glob("*_contract.yaml"))))
