"""`mjcf/<robot>.xml`: the full MJCF, as MuJoCo compiles it."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf import LACKS, MjcfReader
from assetbuild.facts.mjcf_expected import mjcf_table, solver_facts
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table
from assetbuild.quantities import Positive


class MjcfFacts(MjcfReader):
    """Every fact of the robot, in `<robot>.xml`."""

    needs = ("mjcf",)
    form = "mjcf"
    called = "the MJCF"
    folder = "mjcf"
    behind = ("mjcf/{robot}.xml", "mjcf/assets/*")
    suffixes = (".xml", ".mjcf")
    asks = ("mjcf",)
    lacks = LACKS
    copies = False

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

    def file(self, root: Path, robot: str) -> Path | None:
        """Every robot has one."""
        return root / f"{robot}.xml"

    def expected(self, reference: Reference) -> Table:
        """All that the robot is, and the solver of the recipe."""
        table = Table({**mjcf_table(reference).facts, **solver_facts(reference, "mjcf")})
        return self.complete(table, reference)
