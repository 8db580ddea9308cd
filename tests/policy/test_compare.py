"""Wiring faults that a file states are named: which numbers, of which joints, in which order."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from policies import bundle_of, deployed, write_policy

from assetbuild.findings import Finding
from assetbuild.policy.compare import compare
from assetbuild.policy.opening import open_policy
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy, Term


@pytest.fixture(scope="module")
def bot(tmp_path_factory: pytest.TempPathFactory) -> Bot:
    """Legs with other gains and another pose at each joint, the same on both sides."""
    bot = bundle_of(tmp_path_factory.mktemp("bundle"))
    gains = {"hip": (20.0, 0.5), "thigh": (40.0, 1.0), "calf": (60.0, 1.5)}
    rows = tuple(
        replace(row, kp=gains[row.joint.split("_")[1]][0] + (5.0 if row.joint[0] == "R" else 0.0),
                kd=gains[row.joint.split("_")[1]][1])
        for row in bot.control.actuators
    )  # fmt: skip
    return replace(bot, control=replace(bot.control, actuators=rows))


def policy_of(bot: Bot, folder: Path, spoil: Callable[[dict[str, Any]], object]) -> Policy:
    said = deployed(bot)
    spoil(said)
    return open_policy(write_policy(folder, said), bot)


def found(bot: Bot, folder: Path, spoil: Callable[[dict[str, Any]], object]) -> list[Finding]:
    return [f for f in compare(policy_of(bot, folder, spoil), bot) if f.severity != "info"]


def swap(row: list[float], one: int, other: int) -> None:
    row[one], row[other] = row[other], row[one]


def reorder(said: dict[str, Any], key: str, places: list[int]) -> None:
    said[key] = [said[key][place] for place in places]


def test_an_untouched_policy_fits(bot: Bot, tmp_path: Path):
    assert found(bot, tmp_path / "p", lambda said: None) == []


FAULTS: dict[str, tuple[Callable[[dict[str, Any]], object], str, str]] = {
    "gains of two joints": (
        lambda said: swap(said["stiffness"], 0, 1), "policy.gains",
        "kp of `FL_hip_joint` and `FL_thigh_joint` is exchanged",
    ),
    "gains in the policy's order": (
        lambda said: reorder(said, "stiffness", said["joint_ids_map"]), "policy.gains", "order",
    ),
    "gains in degrees": (
        lambda said: said.update(stiffness=[v * math.pi / 180 for v in said["stiffness"]]),
        "policy.gains", "kp of all joints is 57.3 times too small",
    ),
    "half the damping": (
        lambda said: said.update(damping=[v / 2 for v in said["damping"]]),
        "policy.gains", "kd of all joints is 0.5 times that of the bundle",
    ),
    "one gain": (
        lambda said: said["stiffness"].__setitem__(7, 99.0), "policy.gains",
        "kp differs from the bundle: `RL_thigh_joint` 99, 45 of the bundle",
    ),
    "the pose's sign": (
        lambda said: said["default_joint_pos"].__setitem__(5, -said["default_joint_pos"][5]),
        "policy.position", "of `FR_thigh_joint` has the opposite sign",
    ),
    "a pose out of reach": (
        lambda said: said["default_joint_pos"].__setitem__(8, 0.0), "policy.position",
        "its default position 0 is outside of its limits, -2.8 to -0.9",
    ),
    "a gait without a period": (
        lambda said: said["observations"].update(gait_phase={"params": {}, "scale": [1.0, 1.0]}),
        "policy.term", "the period of its gait is not stated",
    ),
    "actions from 0": (
        lambda said: said["actions"]["JointPositionAction"].update(offset=[0.0] * 12),
        "policy.offset", "offset of the action",
    ),
    "an action's sign": (
        lambda said: said["actions"]["JointPositionAction"]["scale"].__setitem__(4, -0.25),
        "policy.scale", "action scale of `FL_thigh_joint` is negative",
    ),
    "a joint twice as fast": (
        lambda said: said["actions"]["JointPositionAction"]["scale"].__setitem__(0, 0.5),
        "policy.scale", "not the same on both sides: `FL_hip_joint` 0.5, `FR_hip_joint` 0.25",
    ),
    "two motors": (
        lambda said: swap(said["joint_ids_map"], 0, 1), "policy.order",
        "no engine's order; Isaac Lab's, but for `FR_hip_joint`, `FL_hip_joint`",
    ),
    "twice as often": (
        lambda said: said.update(step_dt=said["step_dt"] / 2), "policy.timestep", "it acts every",
    ),
    "an observation that nobody knows": (
        lambda said: said["observations"].update(height_scan={"params": {}, "scale": [1.0]}),
        "policy.term", "`height_scan` is not known",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named(name: str, bot: Bot, tmp_path: Path):
    spoil, rule, words = FAULTS[name]
    findings = found(bot, tmp_path / "p", spoil)
    assert [f for f in findings if f.rule == rule and words in f.message], findings


def test_places_on_a_bus_of_no_known_order_are_a_guess(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path / "p", lambda said: said["joint_ids_map"].reverse())
    found = compare(policy, replace(bot, bundle=tmp_path))
    (order,) = (finding for finding in found if finding.rule == "policy.order")
    assert "whose order the bundle does not state" in order.message
    assert "bus_order" in order.hint


def test_gains_of_one_s_own_are_no_fault(bot: Bot, tmp_path: Path):
    """A policy that was trained with other motors in mind says so, and drives with its own."""
    policy = policy_of(
        bot, tmp_path / "p", lambda said: said.update(stiffness=[30.0, 33.0, 37.0] * 4)
    )
    told = [f for f in compare(policy, bot) if f.rule == "policy.gains"]
    assert [f.severity for f in told] == ["info"] and "kp of 12 of 12 joints" in told[0].message


def test_what_the_network_takes_is_compared_with_the_observations(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path / "p", lambda said: said["observations"].pop("base_ang_vel"))
    told = [f for f in compare(policy, bot, (45, 12)) if f.rule == "policy.shape"]
    assert "takes 45 numbers, the observations are 42" in told[0].message
    told = [f for f in compare(policy, bot, (42, 11)) if f.rule == "policy.shape"]
    assert "gives 11 numbers, the actions move 12 joints" in told[0].message


def test_joints_that_the_robot_lacks_are_named(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path / "p", lambda said: None)
    strange = replace(policy, joints=("FL_hip_joit", *policy.joints[1:]), follows="mujoco")
    told = [f for f in compare(strange, bot) if f.rule == "policy.joints"]
    assert told[0].subject == "joint FL_hip_joit" and "FL_hip_joint" in told[0].hint


def test_an_upright_start_in_the_other_order_of_a_quaternion_is_named(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path / "p", lambda said: None)
    turned = replace(policy, start_quat=(0.0, 0.0, 0.0, 1.0))
    assert "policy.quaternion" in {f.rule for f in compare(turned, bot)}
    upright = replace(policy, start_quat=(1.0, 0.0, 0.0, 0.0))
    assert "policy.quaternion" not in {f.rule for f in compare(upright, bot)}


def test_what_a_policy_does_not_state_is_told(bot: Bot, tmp_path: Path):
    """The bundle's gains and rhythm hold then, which is information."""
    policy = policy_of(bot, tmp_path / "p", lambda said: None)
    silent = replace(policy, kp={}, step_s=None)
    told = {f.rule: f.message for f in compare(silent, bot) if f.severity == "info"}
    assert "does not state the gains" in told["policy.gains"]
    assert "does not state how often it acts" in told["policy.timestep"]


def test_an_imu_that_moves_against_the_base_is_named(bot: Bot, tmp_path: Path):
    policy = policy_of(bot, tmp_path / "p", lambda said: None)
    seen = replace(policy, terms=(Term("v", "imu_lin_vel"),))
    assert "policy.term" not in {f.rule for f in compare(seen, replace(bot, imu="imu"))}
    told = [f for f in compare(seen, replace(bot, imu="FL_calf")) if f.rule == "policy.term"]
    assert told[0].message == "the IMU `FL_calf` moves against the base"
