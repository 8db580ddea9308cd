"""The engine room of the MuJoCo checks."""

from __future__ import annotations

from pathlib import Path

import mujoco as engine
import numpy as np
import pytest
from hands import COUPLED, JAW, PINCHER, robot
from robot_files import edit, mjcf_inputs
from tiny import box_obj, tiny_quadruped

from assetbuild.errors import StepError
from assetbuild.simulators import mujoco, speed
from assetbuild.simulators.mujoco import Model, name_of
from assetbuild.simulators.mujoco.grip import with_object
from assetbuild.simulators.mujoco.hands import Hand, between_keys, find_hands

BALL = """<mujoco><worldbody><body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>"""


def test_mass_matrix_is_that_of_the_kinetic_energy(tmp_path: Path) -> None:
    model = mujoco.load(mjcf_inputs(tmp_path, tiny_quadruped()) / "mjcf/robot.xml").model
    model.opt.enableflags |= engine.mjtEnableBit.mjENBL_ENERGY
    data = engine.MjData(model)
    data.qvel[:] = np.linspace(-1, 1, model.nv)
    engine.mj_forward(model, data)
    M = mujoco.mass_matrix(model, data)
    assert data.qvel @ M @ data.qvel / 2 == pytest.approx(data.energy[1], rel=1e-12)
    assert np.array_equal(M, M.T)


def test_refusal_has_no_path_of_this_machine(tmp_path: Path) -> None:
    path = tmp_path / "bad.xml"
    path.write_text('<mujoco><asset><mesh file="gone.obj"/></asset></mujoco>')
    with pytest.raises(StepError) as refused:
        mujoco.load(path)
    assert "gone.obj" in refused.value.message
    assert str(tmp_path) not in refused.value.message


def test_warnings_are_caught_and_the_handler_is_put_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    model = engine.MjModel.from_xml_string(BALL)
    data = engine.MjData(model)
    before = engine.get_mju_user_warning()
    with mujoco.caught_warnings() as said:
        data.qvel[0] = np.nan
        engine.mj_step(model, data)
    assert len(said) == 1
    assert "QVEL" in said[0]
    assert engine.get_mju_user_warning() is before
    assert not list(tmp_path.iterdir()), "no MUJOCO_LOG.TXT"


WITH_VISUALS = """
<mujoco>
  <asset><mesh name="drawn" file="{file}"/></asset>
  <worldbody>
    <body pos="0 0 1">
      <freejoint/>
      {inertial}
      <geom name="drawn" type="mesh" mesh="drawn" contype="0" conaffinity="0"/>
      <geom name="hit" type="sphere" size="0.1" pos="0.2 0 0" mass="0"/>
    </body>
  </worldbody>
</mujoco>
"""
INERTIAL = '<inertial pos="0.1 0 0" mass="2" diaginertia="0.1 0.2 0.25"/>'


@pytest.mark.parametrize("inertial", [INERTIAL, ""])
def test_without_visuals_the_physics_stay(tmp_path: Path, inertial: str) -> None:
    """Also where the body has its mass from the visual mesh alone."""
    (tmp_path / "box.obj").write_bytes(box_obj((0.3, 0.2, 0.1)))
    path = tmp_path / "it.xml"
    path.write_text(WITH_VISUALS.format(file="box.obj", inertial=inertial))
    whole = mujoco.load(path).model
    bare = mujoco.load(path, visuals=False).model
    assert (whole.nmesh, bare.nmesh) == (1, 0)
    assert [mujoco.name_of(bare, "geom", i) for i in range(bare.ngeom)] == ["hit"]
    assert whole.body_mass[1] > 1.0
    assert bare.body_mass[1] == pytest.approx(whole.body_mass[1], rel=1e-12)
    assert bare.body_ipos[1] == pytest.approx(whole.body_ipos[1], abs=1e-12)
    assert mujoco.inertia_of(bare, 1) == pytest.approx(mujoco.inertia_of(whole, 1), rel=1e-12)
    (tmp_path / "box.obj").unlink()
    if inertial:
        assert mujoco.load(path, visuals=False).model.nmesh == 0, "their meshes are not read"


# --- speed ---------------------------------------------------------------------------------------


SCENE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 0.1"><freejoint/><geom name="a" type="sphere" size="0.1"/>
      <body pos="0.5 0 0"><joint type="slide"/><geom type="sphere" size="0.1"/>
        <body pos="-0.35 0 0"><joint type="slide"/><geom type="sphere" size="0.1"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_geoms_and_own_contacts_at_home_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(speed, "STEPS", 20)
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    found = speed.measure_speed(path)
    assert found.geoms == 3
    # The third ball is 0.15 m from the first, which is not its parent: 50 mm deep.
    assert found.self_contacts == 1
    assert found.deepest_mm == pytest.approx(50.0, abs=0.1)
    assert found.steps_per_s > 0.0
    assert (found.creep_mm_s, found.held) == (None, ""), "it lies there, and has no hand"


# --- Hands are found by what they do: tips that one drive brings together ---


def found(path: Path) -> tuple[Model, list[Hand]]:
    model = with_object(path)
    return model, list(find_hands(model))


def test_two_fingers_that_follow_each_other_are_a_hand(tmp_path: Path) -> None:
    model, (hand,) = found(robot(PINCHER, ["left"], tmp_path, COUPLED))
    assert name_of(model, "body", hand.palm) == "palm"
    assert {name_of(model, "joint", joint) for joint in hand.fingers} == {"left", "right"}
    assert abs(hand.across[0] @ (0.0, 1.0, 0.0)) == pytest.approx(1.0)
    assert hand.along[0] @ (0.0, 0.0, 1.0) == pytest.approx(1.0)
    assert hand.targets[0] == pytest.approx(0.04)  # open first
    assert hand.targets[-1] == pytest.approx(0.0)


def test_a_jaw_that_closes_on_its_palm_is_a_hand(tmp_path: Path) -> None:
    model, (hand,) = found(robot(JAW, ["jaw"], tmp_path))
    sides = [{name_of(model, "body", body) for body in side} for side in hand.sides]
    assert sides[0] == {"jaw"}
    assert "palm" in sides[1]
    assert abs(hand.across[:, 0]).max() < 1e-6  # all in the plane in which the jaw moves


def test_a_loop_takes_no_joint_of_the_arm_into_the_hand(tmp_path: Path) -> None:
    """The right finger follows the left one through a rod; the wrist above both is no finger."""
    rod = """<body name="rod" pos="0 0 .01"><joint name="rod" type="slide" axis="0 1 0"
    damping="5"/><geom size=".002" mass=".01" contype="0" conaffinity="0"/></body>"""
    wrist = '<body name="wrist"><joint name="wrist" axis="0 0 1" range="-1 1"/>'
    holds = (
        '<equality><joint joint1="rod" joint2="left" polycoef="0 -1 0 0 0"/>'
        '<connect body1="rod" body2="right" anchor="0 0 0"/></equality>'
    )
    path = robot(PINCHER + rod, ["left", "wrist"], tmp_path, holds)
    palm, end = '<body name="palm"', "</worldbody>"
    edit(path, (palm, wrist + palm), (end, f"</body>{end}"))
    model, (hand,) = found(path)
    fingers = {name_of(model, "joint", joint) for joint in hand.fingers}
    assert fingers == {"left", "right", "rod"}


FLANGE = """<body name="flange" pos="0 0 .01"><joint name="roll" axis="0 0 1" range="-3 3"
damping=".1"/><geom type="cylinder" size=".02 .02" mass=".05"/></body>"""
"""It turns about its own axis."""
ELBOW = """<geom type="capsule" size=".02" fromto="0 0 0 0 0 .4" mass="1"/>
<body name="forearm" pos="0 0 .45"><joint name="elbow" axis="1 0 0" range="0 3" damping=".1"/>
<geom type="capsule" size=".02" fromto="0 0 .03 0 0 .4" mass=".5"/></body>"""
"""Its end comes near to the upper arm, but it is as long as an arm."""


@pytest.mark.parametrize(("inside", "joint"), [(FLANGE, "roll"), (ELBOW, "elbow")])
def test_a_flange_or_an_elbow_is_no_hand(inside: str, joint: str, tmp_path: Path) -> None:
    assert found(robot(inside, [joint], tmp_path))[1] == []


def test_two_fingers_with_a_drive_each_are_a_hand_that_keyframes_may_close(tmp_path: Path) -> None:
    keys = '<keyframe><key name="open" qpos=".04 .03"/><key name="shut" qpos="0 .01"/></keyframe>'
    model, (hand,) = found(robot(PINCHER, ["left", "right"], tmp_path, keys))
    keyed = between_keys(model, "open", "shut")
    for one in (hand, keyed):
        assert [drive.joint_name for drive in one.drives] == ["left", "right"]
    np.testing.assert_allclose(hand.targets[[0, -1]], [[0.04, 0.04], [0.0, 0.0]])
    np.testing.assert_allclose(keyed.targets[[0, -1]], [[0.04, 0.03], [0.0, 0.01]])

    with pytest.raises(StepError, match="no keyframe `fist`"):
        between_keys(model, "open", "fist")
