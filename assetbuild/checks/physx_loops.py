"""Do the loops stay closed in PhysX while the driven joints swing?"""

from __future__ import annotations

from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.physx import PhysxCheck


class PhysxLoops(LoopCheck, PhysxCheck):
    """Swings the driven joints of `usd/<robot>.usda` in PhysX and measures every gap."""
