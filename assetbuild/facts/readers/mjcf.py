"""`mjcf/<robot>.xml`: the full MJCF, as MuJoCo compiles it."""

from __future__ import annotations

from pydantic import Field

from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf import LACKS, MjcfReader
from assetbuild.quantities import Positive


class MjcfFacts(MjcfReader):
    """Every fact of the robot, in `<robot>.xml`."""

    needs = ("mjcf",)
    form = "mjcf"
    called = "the MJCF"
    behind = ("mjcf/{robot}.xml", "mjcf/assets/*")
    suffixes = (".xml", ".mjcf")
    asks = ("mjcf",)
    lacks = LACKS
    solver = "mjcf"
    visuals = True

    section = "validate"
    equality: Positive = Field(
        1e-9,
        le=1e-6,
        description="relative: any number of the MJCF, read back, against the robot's, error",
    )

    @property
    def exactness(self) -> Precision:
        """As the recipe has it."""
        return Precision(
            {**dict.fromkeys(EXACT, self.equality), "length": 1e-6}, self.precision.by_quantity
        )
