"""Intervals as ranges that a trainer draws from: a recipe takes them as they are printed."""

import pytest
import yaml

from assetbuild.identify.for_recipe import as_ranges
from assetbuild.robot.identify import Fit, LogUsed, Parameter
from assetbuild.robot.ranges import Randomize, first_match

LOG = LogUsed("chirp.csv", "0" * 64, 48.0, 12.0, 500.0)
PARAMETERS = (
    Parameter("armature", ("joint_0.0", "joint_1.0"), 0.02, 0.019, 0.021),
    Parameter("friction", ("joint_0.0",), 0.5, 0.0, 1.5),
    Parameter("damping", ("joint_0.0",), 0.5, 0.2, 0.8, refused="its interval is too wide"),
    Parameter("delay", ("joint_0.0", "joint_1.0"), 0.005, 0.0047, 0.0053),
)


@pytest.fixture
def text():
    return as_ranges([Fit((LOG,), PARAMETERS, (), (), 1.0)], timestep_s=0.002)


def test_the_recipe_takes_what_is_printed(text):
    ranges = Randomize.model_validate(yaml.safe_load(text)["randomize"])
    for joint in ("joint_0.0", "joint_1.0"):
        found = first_match(ranges.joints, joint)
        assert found.armature == (0.95, 1.05) and found.delay == (2, 3)
        assert found.damping == (1.0, 1.0) and "chirp.csv" in found.source


def test_an_interval_down_to_zero_is_no_factor(text):
    assert "# friction of joint_0.0: the interval begins at 0" in text and "friction:" not in text


def test_nothing_identified_is_nothing_to_draw():
    assert as_ranges([Fit((LOG,), (), (), (), 1.0)], timestep_s=0.002) == ""
