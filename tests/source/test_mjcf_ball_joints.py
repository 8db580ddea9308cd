"""Ball joints of an MJCF stay ball joints, with all that brakes and holds them."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcfs import read, write
from tiny import TinyRobot, box_inertial, run_step, write_robot_ports

from assetbuild.checks.mjcf_source import MjcfSource
from assetbuild.control.source_control import joined_keyframes
from assetbuild.errors import StepError
from assetbuild.kinds import Target
from assetbuild.robot import chains
from assetbuild.robot.chains import angles_of
from assetbuild.robot.model import Body, Control, Joint, JointKind, Keyframe, Tree
from assetbuild.robot.pose import Pose, normalised_quat, quat_multiply
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


def source(joint: str = 'damping=".2" armature=".01" frictionloss=".05" stiffness="2"') -> str:
    return SOURCE.format("radian", joint)


def test_it_moves_as_in_the_source(tmp_path: Path):
    """200 steps under random commands, from the keyframe."""
    text = source()
    done = write(read(text, tmp_path / "read"), tmp_path / "out")
    a = mujoco.MjModel.from_xml_string(text)
    b = mujoco.MjModel.from_xml_path(str(done.xml))
    one, other = mujoco.MjData(a), mujoco.MjData(b)
    mujoco.mj_resetDataKeyframe(a, one, 0)
    mujoco.mj_resetDataKeyframe(b, other, 0)
    random = np.random.default_rng(1)
    drives = [b.actuator(a.actuator(i).name).id for i in range(a.nu)]
    for _ in range(200):
        one.ctrl[:] = random.uniform(-1.0, 1.0, a.nu)
        other.ctrl[drives] = one.ctrl
        mujoco.mj_step(a, one)
        mujoco.mj_step(b, other)
    np.testing.assert_allclose(other.qpos, one.qpos, rtol=1e-6, atol=1e-9)
    assert run_step(MjcfSource(robot="robot"), done.inputs, tmp_path / "compared") == []


@pytest.mark.parametrize(
    ("angle", "joint"),
    [
        ("degree", 'range="0 40" solreflimit=".01 1"'),
        ("radian", 'limited="false"'),
        ("radian", 'damping=".2 .1 0" actuatorgravcomp="true"'),
        ("radian", ""),
    ],
)
def test_every_word_is_compared_with_the_source(angle: str, joint: str, tmp_path: Path):
    done = write(read(SOURCE.format(angle, joint), tmp_path / "read"), tmp_path / "out")
    assert run_step(MjcfSource(robot="robot"), done.inputs, tmp_path / "compared") == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('type="ball" armature="0.01"', 'type="ball" armature="0.012"'),
        ('name="b" class="main" type="ball"', 'name="b" class="main" type="hinge"'),
        ("0.9", "0.8"),
    ],
)
def test_a_changed_ball_joint_is_found(old: str, new: str, tmp_path: Path):
    done = write(read(source(), tmp_path / "read"), tmp_path / "out")
    text = done.xml.read_text()
    if old == "0.9":  # in the keyframe, normalised
        start = text.index('qpos="') + 6
        text = text[:start] + text[start:].replace("0.", "0.1", 1)
    else:
        assert old in text, text
        text = text.replace(old, new)
    done.xml.write_text(text)
    found = run_step(MjcfSource(robot="robot"), done.inputs, tmp_path / "compared")
    assert any(f.severity == "error" for f in found)


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
    (key,) = joined_keyframes((), [stated], tree, {})
    assert dict(key.joints) == {
        "base_x": angles[0], "base_y": angles[1], "base_z": angles[2], "arm": 0.5
    }  # fmt: skip
