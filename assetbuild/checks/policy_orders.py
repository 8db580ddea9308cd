"""Does MuJoCo count the joints in the order that the policy's contract says?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.plugin_types import write_figures
from assetbuild.policy.counting import known_joints, order_findings, read_contract
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.drives import read_drives


class PolicyOrders(mujoco.InMujoco):
    """Asks the compiled model. Figures: joints, and whether drives are counted as their joints."""

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
