"""Ball joints of an MJCF, its `connect` and its `weld` are the robot's, with all that they hold."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcfs import Written, compared, read, same_motion, write, written
from robot_files import run_step, write_robot_ports
from tiny import TinyRobot, box_inertial

from assetbuild.checks.gains import Gains
from assetbuild.control.source_control import source_keyframes
from assetbuild.errors import SourceError, StepError
from assetbuild.plugin_types import Target
from assetbuild.robot import chains
from assetbuild.robot.chains import angles_of
from assetbuild.robot.model import Body, Control, Joint, JointKind, Keyframe, Loop, Tree
from assetbuild.robot.pose import Pose, normalised_quat, quat_multiply, vec3
from assetbuild.robot.shapes import Shapes
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.usd import Usd

TURNED = "0.9 0.1 -0.3 0.3"
SOURCE = f"""<mujoco><compiler angle="{{}}"/><worldbody><body name="base"><geom size=".1"/>
  <body name="rod" pos="0 0 .3"><joint name="b" type="ball" pos=".01 0 .02" {{}}/>
  <geom type="capsule" size=".03" fromto="0 0 0 .3 .1 0"/>
  <body name="tip" pos=".3 0 0"><joint name="s" type="slide" axis="1 0 0"/>
  <joint name="c" type="ball" damping=".1"/><geom size=".05" pos=".02 .03 0"/></body>
  </body></body></worldbody>
  <actuator><motor name="m" joint="b" gear="1 2 3"/><motor name="n" joint="s"/></actuator>
  <sensor><ballquat name="q" joint="b"/></sensor>
  <keyframe><key name="home" qpos="{TURNED} .1 1 0 0 0"/></keyframe></mujoco>"""


def base(kind: JointKind) -> Tree:
    """An arm on a joint of several coordinates."""
    joints = (
        Joint("base", kind, "floor", "car", Pose((0.1, 0.2, 0.3))),
        Joint("arm", "continuous", "car", "arm", Pose((0.1, 0.0, 0.2)), (0.0, 1.0, 0.0)),
    )
    box = box_inertial(2.0, (0.1, 0.1, 0.5))
    bodies = (Body("floor"), Body("car", box), Body("arm", box))
    return Tree("car", "fixed", bodies, joints)


@pytest.mark.parametrize(
    ("angle", "joint"),
    [
        ("radian", 'damping=".2" armature=".01" frictionloss=".05" stiffness="2"'),
        ("degree", 'range="0 40" solreflimit=".01 1"'),
        ("radian", 'limited="false"'),
        ("radian", 'damping=".2 .1 0" actuatorgravcomp="true"'),
        ("radian", ""),
    ],
)
def test_it_says_and_does_what_it_does_in_the_source(angle: str, joint: str, tmp_path: Path):
    text = SOURCE.format(angle, joint)
    done = written(text, tmp_path)
    assert compared(done) == set()
    same_motion(text, done.xml, keyframe=True)


@pytest.mark.parametrize("target", [Urdf(robot="robot"), Usd(robot="robot")])
def test_what_has_no_ball_joints_names_the_edit_that_splits_them(target: Target, tmp_path: Path):
    tree = base("ball")
    ports = write_robot_ports(tmp_path / "in", TinyRobot(tree, tree, Shapes(), Control()))
    with pytest.raises(StepError, match="joint `base` is") as raised:
        run_step(target, ports, tmp_path / "out")
    assert "split_joint: {joint: base}" in str(raised.value.hint)


def test_the_hinges_of_a_split_ball_stand_as_the_keyframe_says():
    turn = normalised_quat((0.9, 0.1, -0.3, 0.3))
    angles = angles_of(turn)
    axes = np.eye(3)
    made = (1.0, 0.0, 0.0, 0.0)
    for angle, axis in zip(angles, axes, strict=True):
        made = quat_multiply(made, (math.cos(angle / 2), *(math.sin(angle / 2) * axis)))
    assert made == pytest.approx(turn, abs=1e-12)
    tree = chains.split(base("ball"), frozenset({"base"}))
    stated = Keyframe("home", (("arm", 0.5),), None, (("base", turn),))
    (key,) = source_keyframes([stated], tree)
    assert dict(key.joints) == {
        "base_x": angles[0], "base_y": angles[1], "base_z": angles[2], "arm": 0.5
    }  # fmt: skip


CRANK = (0.03, 0.0, 0.1)
BY_ANCHOR = '<connect name="pin" body1="coupler" body2="rocker" anchor="0.2 0 0.03"/>'
BY_SITES = '<connect name="pin" site1="over" site2="under" solref="0.004 1"/>'
WELD = (
    '<weld name="pin" body1="coupler" body2="rocker" relpose="0.13 0 -0.1 1 0 .1 0" anchor=".1 0 0"'
)
LOOSE = f"{WELD} torquescale='2' solimp='.8 .9 .01 .5 2'/>"


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
    return written(four_bar(equality, base=base), folder)


def the_loop(done: Written) -> Loop:
    (loop,) = done.control.loops
    return loop


@pytest.mark.parametrize("equality", [BY_ANCHOR, BY_SITES, LOOSE, f"{WELD}/>"])
def test_the_linkage_moves_as_in_the_source(equality: str, tmp_path: Path):
    done = built(equality, tmp_path)
    assert the_loop(done).name == "pin"
    same_motion(four_bar(equality), done.xml)
    assert mujoco.MjModel.from_xml_path(str(done.xml)).neq == 1


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
    (said,) = [finding for finding in reading.findings if finding.rule == "mjcf.base_constrained"]
    assert said.severity == "warning"


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
    with pytest.raises(SourceError, match=r"not finite, or above 10000|a finite number") as refused:
        built(equality, tmp_path)
    assert refused.value.where is not None and refused.value.where.line == 14


def test_a_drive_that_the_source_locks_is_a_warning_and_its_gains_are_not_judged(tmp_path: Path):
    done = built('<weld name="pin" body1="crank" body2="base"/>', tmp_path)
    assert [f.subject for f in done.findings if f.rule == "loop.locked"] == ["joint crank"]
    assert run_step(Gains(integrator="Euler"), done.inputs, tmp_path / "gains") == []
