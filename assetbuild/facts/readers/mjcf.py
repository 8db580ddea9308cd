"""`mjcf/<robot>.xml`: the full MJCF, as MuJoCo compiles it."""

from __future__ import annotations

from pydantic import Field

from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf import LACKS, MjcfReader
from assetbuild.recipe_types import Positive


class MjcfFacts(MjcfReader):
    """Every fact of the robot, in `<robot>.xml`."""

    needs = ("mjcf",)
    format_id = "mjcf"
    display_name = "the MJCF"
    file_globs = ("mjcf/{robot}.xml", "mjcf/assets/*")
    suffixes = (".xml", ".mjcf")
    recipe_sections = ("mjcf",)
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
