"""Do the loops stay closed in Newton while the driven joints swing?"""

from __future__ import annotations

from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.newton import NewtonCheck


class NewtonLoops(LoopCheck, NewtonCheck):
    """Swings the driven joints of `usd/<robot>.usda` in Newton and measures every gap."""
