"""Do the loops stay closed in MuJoCo while the driven joints swing?"""

from __future__ import annotations

from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.mujoco.motion import MujocoCheck


class Loops(LoopCheck, MujocoCheck):
    """Swings the driven joints of `mjcf/<robot>.xml`, its base held, and measures every gap."""
