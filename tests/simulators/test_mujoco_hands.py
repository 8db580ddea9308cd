"""Hands are found by what they do: tips that one drive brings together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hands import COUPLED, JAW, PINCHER, robot

from assetbuild.errors import StepError
from assetbuild.simulators.mujoco import Model, name_of
from assetbuild.simulators.mujoco.grip import probe_of, with_object
from assetbuild.simulators.mujoco.hands import Hand, between_keys, find_hands


def found(path: Path) -> tuple[Model, list[Hand]]:
    model = with_object(path)
    return model, list(find_hands(model, probe_of(model)))


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
    text = path.read_text().replace('<body name="palm"', f'{wrist}<body name="palm"')
    path.write_text(text.replace("</body></body></worldbody>", "</body></body></body></worldbody>"))
    model, (hand,) = found(path)
    fingers = {name_of(model, "joint", joint) for joint in hand.fingers}
    assert fingers == {"left", "right", "rod"}


def test_what_turns_about_its_own_axis_is_no_hand(tmp_path: Path) -> None:
    flange = """<body name="flange" pos="0 0 .01"><joint name="roll" axis="0 0 1" range="-3 3"
    damping=".1"/><geom type="cylinder" size=".02 .02" mass=".05"/></body>"""
    assert found(robot(flange, ["roll"], tmp_path))[1] == []


def test_an_elbow_that_folds_is_no_hand(tmp_path: Path) -> None:
    """Its end comes near to the upper arm, but it is as long as an arm."""
    elbow = """<geom type="capsule" size=".02" fromto="0 0 0 0 0 .4" mass="1"/>
    <body name="forearm" pos="0 0 .45"><joint name="elbow" axis="1 0 0" range="0 3" damping=".1"/>
    <geom type="capsule" size=".02" fromto="0 0 .03 0 0 .4" mass=".5"/></body>"""
    assert found(robot(elbow, ["elbow"], tmp_path))[1] == []


def test_two_fingers_with_a_drive_each_are_a_hand(tmp_path: Path) -> None:
    _, (hand,) = found(robot(PINCHER, ["left", "right"], tmp_path))
    assert [drive.joint_name for drive in hand.drives] == ["left", "right"]
    np.testing.assert_allclose(hand.targets[[0, -1]], [[0.04, 0.04], [0.0, 0.0]])


def test_keyframes_say_how_a_hand_of_many_drives_closes(tmp_path: Path) -> None:
    keys = '<keyframe><key name="open" qpos=".04 .03"/><key name="shut" qpos="0 .01"/></keyframe>'
    model = with_object(robot(PINCHER, ["left", "right"], tmp_path, keys))
    hand = between_keys(model, probe_of(model), "open", "shut")
    assert [drive.joint_name for drive in hand.drives] == ["left", "right"]
    np.testing.assert_allclose(hand.targets[[0, -1]], [[0.04, 0.03], [0.0, 0.01]])
    with pytest.raises(StepError, match="no keyframe `fist`"):
        between_keys(model, probe_of(model), "open", "fist")
