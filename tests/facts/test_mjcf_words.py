"""Nothing that an MJCF says goes unread."""

from __future__ import annotations

import mujoco
import pytest

from assetbuild.facts.compare import Precision, differences
from assetbuild.facts.mjcf import read_spec
from assetbuild.facts.table import Table

ROBOT = """<mujoco><asset><material name="red" rgba="1 0 0 1"/></asset>
<worldbody><body name="b"><joint name="j"/><geom name="g" size=".1" material="red"/>
  <site name="s"/><site name="t" pos="0 .2 .2"/></body></worldbody>
<tendon><fixed name="f"><joint joint="j" coef="2"/></fixed>
  <spatial name="p"><site site="s"/><geom geom="g" sidesite="t"/><site site="t"/>
    <pulley divisor="2"/><site site="s"/><site site="t"/></spatial></tendon></mujoco>"""


def table(text: str) -> Table:
    return read_spec(mujoco.MjSpec.from_string(text))[1]


@pytest.mark.parametrize(
    ("old", "new", "subject"),
    [
        ('coef="2"', 'coef="2.02"', "tendon f"),
        (' sidesite="t"', "", "tendon p"),
        ('divisor="2"', 'divisor="3"', "tendon p"),
        ('<geom geom="g" sidesite="t"/>', "", "tendon p"),
        ('material="red"', 'material="red" rgba="0 1 0 1"', "shape g"),
        ('material="red"', 'material="red" rgba="1 0 0 .5"', "shape g"),
    ],
)
def test_paths_of_tendons_and_colours_are_facts(old: str, new: str, subject: str):
    found = differences(table(ROBOT), table(ROBOT.replace(old, new)), Precision())
    assert {difference.key.subject for difference in found} == {subject}
