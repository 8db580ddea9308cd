"""Three slides and a ball at the root of an MJCF are a free joint, without limits and forces."""

from __future__ import annotations

from pathlib import Path

import pytest
from mjcfs import read, same_motion, write

UP = '<joint name="up" type="slide" axis="0 0 1" limited="false" ref="1.5"/>'
SOURCE = f"""<mujoco><default><joint limited="true"/></default><worldbody>
  <body name="base" pos=".1 .2 1.5">
    <joint type="slide" axis="1 0 0" limited="false" ref=".1"/>
    <joint type="slide" axis="0 1 0" limited="false" ref=".2"/>
    {UP}
    <joint type="ball" limited="false"/>
    <geom size=".1 .2 .3" type="box"/>
    <body name="arm" pos="0 0 .3"><joint name="a" axis="0 1 0" limited="false" damping=".1"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .3 .1 0"/></body></body></worldbody>
  <actuator><motor name="m" joint="a"/></actuator>
  <keyframe><key name="home" qpos=".3 -.2 2 .9 .1 -.3 .3 .4"/></keyframe>
</mujoco>"""


def test_slides_and_a_ball_move_as_the_free_joint_that_is_read(tmp_path: Path):
    reading = read(SOURCE, tmp_path / "read")
    assert reading.links.base == "floating"
    assert "mjcf.free_base" in reading.rules()
    same_motion(SOURCE, write(reading, tmp_path / "out").xml, keyframe=True)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('ref="1.5"', 'ref="1"'),
        ('axis="0 1 0" limited="false"', 'axis="0 .6 .8" limited="false"'),
        ('"ball" limited="false"', '"ball" limited="false" damping=".1"'),
        ('"ball" limited="false"', '"ball" limited="true" range="0 1"'),
        ('"ball" limited="false"', '"ball" limited="false" pos="0 0 .1"'),
        ('pos=".1 .2 1.5"', 'pos=".1 .2 1.5" euler="0 0 90"'),
        (UP, f'<frame euler="90 0 0">{UP}</frame>'),
        ("<keyframe>", '<sensor><jointpos joint="up"/></sensor><keyframe>'),
    ],
)
def test_joints_with_limits_forces_or_other_positions_stay_joints(
    before: str, after: str, tmp_path: Path
):
    reading = read(SOURCE.replace(before, after), tmp_path / "read")
    assert reading.links.base == "fixed"
    assert "mjcf.free_base" not in reading.rules()
