"""What readers of the MJCF other than MuJoCo make of its loops."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.closure import gaps
from assetbuild.robot.model import Control, Tree

NEAR_M = 1e-6

OPEN_AT_ZERO = Rule(
    "mjcf.loop_at_zero",
    "warning",
    "a loop does not close where all joints are 0; of an MJCF's loop Newton 1.8 reads one end "
    "alone and takes the other to be there",
    "give Newton the USD, whose loops it reads with both ends",
)


def explain_loops(tree: Tree, control: Control) -> Iterator[Finding]:
    """One finding for all loops that are open in MuJoCo's `qpos0`."""
    at_zero = gaps(tree, control.loops, {joint.name: 0.0 for joint in tree.moving_joints})
    found = {name: gap for name, gap in at_zero.items() if gap > NEAR_M}
    if found:
        shown = ", ".join(f"`{name}` ({gap:.3g} m)" for name, gap in list(found.items())[:4])
        yield OPEN_AT_ZERO(
            "robot",
            f"{len(found)} loops are open where all joints are 0: {shown}"
            f"{', ...' if len(found) > 4 else ''}; MuJoCo, MJX and mjlab hold both ends, but "
            "Newton 1.8 holds other points of this MJCF",
            "give Newton the USD",
            data=found,
        )
