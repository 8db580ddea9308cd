"""What was measured becomes keys of a recipe and numbers of the actuator table."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from logs import JOINTS, prior
from robot_files import run_step

from assetbuild.identify.for_recipe import as_ranges
from assetbuild.identify.priors import UseFits
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.identify import Fit, LogUsed, Parameter
from assetbuild.robot.model import Control
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


@pytest.mark.parametrize(("refused", "damping", "identified"), [("", 0.3, 2), ("noise", 0.1, 1)])
def test_what_the_logs_show_is_used_and_counted(
    refused: str, damping: float, identified: int, tmp_path: Path
):
    """The drive gave half of the gain that it was asked for while it was recorded, 60 N m/rad."""
    table = Control(tuple(prior(joint) for joint in JOINTS))
    shown = (
        Parameter("kp", ("shoulder",), 30.0, 29.0, 31.0),
        Parameter("damping", ("shoulder",), 0.3, 0.2, 0.4, refused=refused),
    )
    fit = Fit(
        (LogUsed("a.csv", "0" * 64, 8.0, 2.0, 250.0),),
        shown,
        (),
        recorded=(("shoulder", 60.0, 1.0),),
    )
    (tmp_path / "in/fits").mkdir(parents=True)
    (tmp_path / "in/control.json").write_bytes(encode(table))
    (tmp_path / "in/fits/0.json").write_bytes(encode(fit))
    (finding,) = run_step(UseFits(fits=1), tmp_path / "in", tmp_path / "out")
    assert finding.rule == "identify.used"
    assert finding.data == {"identified": identified, "parameters": 2}
    shoulder, elbow = decode_file(Control, tmp_path / "out/control.json").actuators
    assert (shoulder.kp, shoulder.damping) == (table.actuators[0].kp / 2, damping)
    assert elbow == table.actuators[1]
