"""What the report adds to the findings of the steps."""

from __future__ import annotations

from assetbuild.engine.graph import Node
from assetbuild.facts.readers.mjcf import MjcfFacts
from assetbuild.pipeline.judging import _not_compared
from assetbuild.plan import Outline
from assetbuild.targets.mjcf import Mjcf


def test_a_target_without_a_reader_keeps_the_robot_from_being_ready():
    """As that of another package may be."""
    written, read = (Node("n", step, {}) for step in (Mjcf(robot="r"), MjcfFacts(robot="r")))
    outline = Outline(targets={"mjcf": written, "sdf": written}, checks={"mjcf_equal": read})
    (finding,) = _not_compared(outline)
    assert (finding.rule, finding.subject) == ("formats.not_compared", "recipe targets sdf")
    assert finding.unready
