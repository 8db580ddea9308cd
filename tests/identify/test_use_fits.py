"""What logs show takes the place of the table's numbers, and is reported."""

from __future__ import annotations

from pathlib import Path

import pytest
from logs import JOINTS, prior
from tiny import run_step

from assetbuild.identify.priors import UseFits
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.identify import Fit, LogUsed, Parameter
from assetbuild.robot.model import Control


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
