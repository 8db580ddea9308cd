"""Wiring faults that a file states are named: which numbers, of which joints, in which order."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from policies import bundle_of, deployed, write_policy

from assetbuild.policy.compare import compare
from assetbuild.policy.opening import open_policy
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy, Term


@pytest.fixture(scope="module")
def bot(tmp_path_factory: pytest.TempPathFactory) -> Bot:
    """Legs with other gains and another pose at each joint, the same on both sides."""
    bot = bundle_of(tmp_path_factory.mktemp("bundle"))
    gains = {"hip": (20.0, 0.5), "thigh": (40.0, 1.0), "calf": (60.0, 1.5)}
    rows = []
    for row in bot.control.actuators:
        kp, kd = gains[row.joint.split("_")[1]]
        rows.append(replace(row, kp=kp + 5.0 * (row.joint[0] == "R"), kd=kd))
    return replace(bot, control=replace(bot.control, actuators=tuple(rows)))


Change = Callable[[Any], object]


def policy_of(
    bot: Bot, folder: Path, key: str = "step_dt", change: Change = lambda value: value
) -> Policy:
    """A policy that fits, but for the value of one key, whose parts have dots between them."""
    said = deployed(bot)
    *above, last = key.split(".")
    inside = functools.reduce(dict.__getitem__, above, said)
    inside[last] = change(inside[last])
    return open_policy(write_policy(folder, said), bot)


def swapped(one: int, other: int) -> Change:
    return lambda row: [row[{one: other, other: one}.get(n, n)] for n in range(len(row))]


def put(place: int, value: float) -> Change:
    return lambda row: [*row[:place], value, *row[place + 1 :]]


def times(factor: float) -> Change:
    return lambda row: [factor * value for value in row]


def with_term(name: str, scale: list[float]) -> Change:
    return lambda terms: terms | {name: {"params": {}, "scale": scale}}


def test_an_untouched_policy_fits(bot: Bot, tmp_path: Path):
    assert [f for f in compare(policy_of(bot, tmp_path), bot) if f.severity != "info"] == []


SCALE = "actions.JointPositionAction.scale"
FAULTS: dict[str, tuple[str, Change, str, str]] = {
    "gains of two joints": (
        "stiffness", swapped(0, 1), "policy.gains",
        "kp of `FL_hip_joint` and `FL_thigh_joint` is exchanged"),
    "gains in the policy's order, hips first": (
        "stiffness", lambda row: [*row[::3], *row[1::3], *row[2::3]], "policy.gains", "order"),
    "gains in degrees": (
        "stiffness", times(math.pi / 180), "policy.gains",
        "kp of all joints is 57.3 times too small"),
    "half the damping": (
        "damping", times(0.5), "policy.gains", "kd of all joints is 0.5 times that of the bundle"),
    "kp and kd": (
        "stiffness", times(1e-3), "policy.gains", "kd is above kp at every joint"),
    "one gain": (
        "stiffness", put(7, 99.0), "policy.gains",
        "kp differs from the bundle: `RL_thigh_joint` 99, 45 of the bundle"),
    "the pose's sign": (
        "default_joint_pos", lambda row: put(5, -row[5])(row), "policy.position",
        "of `FR_thigh_joint` has the opposite sign"),
    "a pose out of reach": (
        "default_joint_pos", put(8, 0.0), "policy.position",
        "its default position 0 is outside of its limits, -2.8 to -0.9"),
    "a gait without a period": (
        "observations", with_term("gait_phase", [1.0, 1.0]), "policy.term",
        "the period of its gait is not stated"),
    "actions from 0": (
        "actions.JointPositionAction.offset", times(0.0), "policy.offset", "offset of the action"),
    "an action's sign": (
        SCALE, put(4, -0.25), "policy.scale", "action scale of `FL_thigh_joint` is negative"),
    "a joint twice as fast": (
        SCALE, put(0, 0.5), "policy.scale",
        "not the same on both sides: `FL_hip_joint` 0.5, `FR_hip_joint` 0.25"),
    "two motors": (
        "joint_ids_map", swapped(0, 1), "policy.order",
        "no engine's order; Isaac Lab's, but for `FR_hip_joint`, `FL_hip_joint`"),
    "twice as often": ("step_dt", lambda step: step / 2, "policy.timestep", "it acts every"),
    "gravity that points up": (
        "observations", with_term("projected_gravity", [-1.0]), "policy.scale", "its scale is -1"),
    "an observation that nobody knows": (
        "observations", with_term("height_scan", [1.0]), "policy.term",
        "`height_scan` is not known"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named(name: str, bot: Bot, tmp_path: Path):
    key, change, rule, words = FAULTS[name]
    found = compare(policy_of(bot, tmp_path, key, change), bot)
    wrong = [f for f in found if f.severity != "info"]
    assert [f for f in wrong if f.rule == rule and words in f.message], wrong


def test_places_on_a_bus_of_no_known_order_are_a_guess(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path / "p", "joint_ids_map", lambda places: places[::-1])
    found = compare(policy, replace(bot, bundle=tmp_path))
    (order,) = (finding for finding in found if finding.rule == "policy.order")
    assert "whose order the bundle does not state" in order.message
    assert "bus_order" in order.hint


def test_gains_of_one_s_own_are_no_fault(bot: Bot, tmp_path: Path):
    """A policy that was trained with other motors in mind says so, and drives with its own."""
    policy = policy_of(bot, tmp_path, "stiffness", lambda row: [30.0, 33.0, 37.0] * 4)
    told = [f for f in compare(policy, bot) if f.rule == "policy.gains"]
    assert [f.severity for f in told] == ["info"] and "kp of 12 of 12 joints" in told[0].message


def test_a_pose_of_one_s_own_may_be_0_at_most_joints(bot: Bot, tmp_path: Path, monkeypatch):
    """Bent knees against straight legs, as mjlab's G1 has them: all that differs, not a few."""
    policy = policy_of(bot, tmp_path)
    pose = {name: value if "calf" in name else 0.0 for name, value in policy.position.items()}
    monkeypatch.setattr(Bot, "position", dict.fromkeys(pose, 0.0))
    bent = replace(policy, position=pose, offset=pose)
    told = [f for f in compare(bent, bot) if "of 12 joints" in f.message]
    assert [f.severity for f in told] == ["info"], told


def test_the_last_bits_of_a_number_are_no_difference(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path)
    offset = {name: value + 1e-7 for name, value in policy.offset.items()}
    still = replace(policy, offset=offset, digits=(0.0, 0.0))
    assert "policy.offset" not in {f.rule for f in compare(still, bot)}


def test_what_the_network_takes_is_compared_with_the_observations(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path, "observations", lambda terms: dict(list(terms.items())[1:]))
    told = [f for f in compare(policy, bot, (45, 12)) if f.rule == "policy.shape"]
    assert "takes 45 numbers, the observations are 42" in told[0].message
    told = [f for f in compare(policy, bot, (42, 11)) if f.rule == "policy.shape"]
    assert "gives 11 numbers, the actions move 12 joints" in told[0].message


def test_joints_that_the_robot_lacks_are_named(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path)
    strange = replace(policy, joints=("FL_hip_joit", *policy.joints[1:]), follows="mujoco")
    told = [f for f in compare(strange, bot) if f.rule == "policy.joints"]
    assert told[0].subject == "joint FL_hip_joit" and "FL_hip_joint" in told[0].hint


def test_a_joint_without_a_drive_is_named(bot: Bot, tmp_path: Path):
    rows = bot.control.actuators
    limp = replace(bot.control, actuators=(replace(rows[0], model="passive"), *rows[1:]))
    told = list(compare(policy_of(bot, tmp_path), replace(bot, control=limp)))
    assert [f.subject for f in told if f.severity == "error"] == [f"joint {rows[0].joint}"]


def test_an_upright_start_in_the_other_order_of_a_quaternion_is_named(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path)
    turned = replace(policy, start_quat=(0.0, 0.0, 0.0, 1.0))
    assert "policy.quaternion" in {f.rule for f in compare(turned, bot)}
    upright = replace(policy, start_quat=(1.0, 0.0, 0.0, 0.0))
    assert "policy.quaternion" not in {f.rule for f in compare(upright, bot)}


def test_what_a_policy_does_not_state_is_told(bot: Bot, tmp_path: Path):
    """The bundle's gains and rhythm hold then, which is information."""
    policy = policy_of(bot, tmp_path)
    silent = replace(policy, kp={}, step_s=None)
    told = {f.rule: f.message for f in compare(silent, bot) if f.severity == "info"}
    assert "does not state the gains" in told["policy.gains"]
    assert "does not state how often it acts" in told["policy.timestep"]


def test_an_imu_that_moves_against_the_base_is_named(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path)
    seen = replace(policy, terms=(Term("v", "imu_lin_vel"),))
    assert "policy.term" not in {f.rule for f in compare(seen, replace(bot, imu="imu"))}
    told = [f for f in compare(seen, replace(bot, imu="FL_calf")) if f.rule == "policy.term"]
    assert told[0].message == "the IMU `FL_calf` moves against the base"
