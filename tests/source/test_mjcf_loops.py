"""An MJCF's `connect` and `weld` are loops of the robot, and our MJCF holds what they held."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcfs import Written, read, write
from tiny import run_step

from assetbuild.checks.gains import Gains
from assetbuild.errors import SourceError
from assetbuild.robot.model import Loop
from assetbuild.robot.pose import vec3

CRANK = (0.03, 0.0, 0.1)
BY_ANCHOR = '<connect name="pin" body1="coupler" body2="rocker" anchor="0.2 0 0.03"/>'
BY_SITES = '<connect name="pin" site1="over" site2="under" solref="0.004 1"/>'
WELD = (
    '<weld name="pin" body1="coupler" body2="rocker" relpose="0.13 0 -0.1 1 0 .1 0" anchor=".1 0 0"'
)
LOOSE = f"{WELD} torquescale='2' solimp='.8 .9 .01 .5 2'/>"
OPEN = '<connect name="pin" body1="coupler" body2="rocker" anchor="0.2 0 0.03" active="false"/>'


def four_bar(equality: str, *, base: str = "") -> str:
    """A linkage about y whose coupler has its joint away from the origin of its body."""
    return f"""<mujoco><compiler angle="radian"/><worldbody><body name="base" pos="0 0 .3">{base}
  <inertial mass="1" pos="0 0 0" diaginertia=".01 .01 .01"/>
  <body name="crank" pos="-.1 0 0"><joint name="crank" axis="0 1 0" damping=".01"/>
    <geom type="capsule" fromto="0 0 0 .03 0 .1" size=".01" mass=".2" contype="0" conaffinity="0"/>
    <body name="coupler" pos=".03 0 .1"><joint name="coupler" axis="0 1 0" pos=".001 0 0"/>
      <site name="over" pos=".2 0 .03" quat="1 .2 0 0"/>
      <geom type="capsule" fromto="0 0 0 .2 0 .03" size=".01" mass=".3" contype="0"
        conaffinity="0"/>
    </body></body>
  <body name="rocker" pos=".1 0 0"><joint name="rocker" axis="0 1 0"/>
    <site name="under" pos=".03 0 .13"/>
    <geom type="capsule" fromto="0 0 0 .03 0 .13" size=".01" mass=".25" contype="0"
      conaffinity="0"/></body></body></worldbody>
  <equality>{equality}</equality>
  <actuator><position name="crank" joint="crank" kp="20" kv=".5"/></actuator></mujoco>"""


def built(equality: str, folder: Path, *, base: str = "") -> Written:
    return write(read(four_bar(equality, base=base), folder / "read"), folder / "out")


def the_loop(done: Written) -> Loop:
    (loop,) = done.control.loops
    return loop


@pytest.mark.parametrize("equality", [BY_ANCHOR, BY_SITES, LOOSE, f"{WELD}/>"])
def test_the_linkage_moves_as_in_the_source(equality: str, tmp_path: Path):
    done = built(equality, tmp_path)
    assert the_loop(done).name == "pin"
    a = mujoco.MjModel.from_xml_string(four_bar(equality))
    b = mujoco.MjModel.from_xml_path(str(done.xml))
    assert b.neq == 1
    one, other, random = mujoco.MjData(a), mujoco.MjData(b), np.random.default_rng(1)
    for _ in range(200):
        one.ctrl[:] = other.ctrl[:] = random.uniform(-1.0, 1.0, 1)
        mujoco.mj_step(a, one)
        mujoco.mj_step(b, other)
        np.testing.assert_allclose(other.qpos, one.qpos, rtol=1e-6, atol=1e-11)


def test_an_anchor_is_a_point_of_both_bodies(tmp_path: Path):
    loop = the_loop(built(BY_ANCHOR, tmp_path))
    assert (loop.a.body, loop.b.body) == ("coupler", "rocker")
    # The frame of the coupler's link stands in its joint.
    np.testing.assert_allclose(loop.a.X_body_end.xyz, (0.199, 0.0, 0.03), atol=1e-12)
    np.testing.assert_allclose(loop.b.X_body_end.xyz, (0.03, 0.0, 0.13), atol=1e-12)


def test_what_is_held_to_the_world_of_a_fixed_robot_is_held_to_its_root(tmp_path: Path):
    text = '<connect name="pin" body1="coupler" anchor="0.2 0 0.03"/>'
    loop = the_loop(built(text, tmp_path))
    assert loop.b.body == "base"
    closed = np.add(CRANK, (0.2 - 0.1, 0.0, 0.03))
    np.testing.assert_allclose(loop.b.X_body_end.xyz, vec3(closed), atol=1e-12)


def test_a_tether_of_a_floating_robot_stays_in_the_mjcf_with_a_warning(tmp_path: Path):
    text = '<connect name="leash" body1="coupler" anchor="0.2 0 0.03"/>'
    reading = read(four_bar(text, base="<freejoint/>"), tmp_path / "read")
    done = write(reading, tmp_path / "out")
    assert done.control.loops == ()
    assert mujoco.MjModel.from_xml_path(str(done.xml)).neq == 1
    (said,) = [finding for finding in reading.findings if finding.rule == "mjcf.tether"]
    assert said.severity == "warning"


def test_a_constraint_that_is_switched_off_closes_nothing(tmp_path: Path):
    done = built(OPEN, tmp_path)
    assert done.control.loops == ()
    model = mujoco.MjModel.from_xml_path(str(done.xml))
    assert model.neq == 1 and not model.eq_active0[0]


@pytest.mark.parametrize(
    "equality",
    [
        BY_ANCHOR.replace("0.2 0", "1e300 0"),
        BY_ANCHOR.replace("0.2 0", "nan 0"),
        BY_SITES.replace("0.004", "nan"),
        '<joint name="pin" joint1="rocker" joint2="crank" polycoef="0 nan 0 0 0"/>',
    ],
)
def test_a_number_that_is_none_is_refused_with_its_line(equality: str, tmp_path: Path):
    with pytest.raises(SourceError, match="not finite, or above 10000") as refused:
        built(equality, tmp_path)
    assert refused.value.where is not None and refused.value.where.line == 14


def test_a_drive_that_the_source_locks_is_a_warning_and_its_gains_are_not_judged(tmp_path: Path):
    done = built('<weld name="pin" body1="crank" body2="base"/>', tmp_path)
    assert [f.subject for f in done.findings if f.rule == "loop.locked"] == ["joint crank"]
    assert run_step(Gains(integrator="Euler"), done.inputs, tmp_path / "gains") == []
