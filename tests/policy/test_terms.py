"""What a policy sees, against formulas."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from assetbuild.policy.stated import Policy, Term
from assetbuild.policy.terms import FUNCTIONS, Now, Observer, Seen, width

JOINTS = ("a", "b")
HALF = math.sqrt(0.5)


def seen(time: float = 0.0, q: float = 0.0, quat: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)) -> Seen:
    return Seen(
        time, np.zeros(3), np.array(quat), np.array((1.0, 2.0, 3.0)), np.array((0.1, 0.2, 0.3)),
        {"a": 0.5 + q, "b": -1.0}, {"a": 4.0, "b": 5.0},
    )  # fmt: skip


def now(state: Seen, imu: tuple[np.ndarray, np.ndarray] | None = None) -> Now:
    at = imu or (np.eye(3), np.zeros(3))
    return Now(state, np.array((7.0, 8.0, 9.0)), np.array((-1.0, 1.0)), {"a": 0.5, "b": -0.5}, at)


def policy(*terms: Term, **more: object) -> Policy:
    zero = dict.fromkeys(JOINTS, 0.0)
    return Policy(Path("p"), "test", None, JOINTS, JOINTS, zero, zero, zero, terms, 0.02, **more)


def test_gravity_is_seen_in_the_base_s_frame():
    """A base that is pitched nose down by a quarter turn has gravity ahead of it."""
    state = seen(quat=(HALF, 0.0, HALF, 0.0))
    assert FUNCTIONS["projected_gravity"](
        now(state), Term("g", "projected_gravity")
    ) == pytest.approx(np.array((1.0, 0.0, 0.0)))


def test_an_imu_moves_with_the_base_s_turning():
    """v = v0 + w x p, then turned into its frame: here by half a turn about z."""
    turn, place = np.diag((-1.0, -1.0, 1.0)), np.array((0.0, 0.0, 2.0))
    told = FUNCTIONS["imu_lin_vel"](now(seen(), (turn, place)), Term("v", "imu_lin_vel"))
    assert told == pytest.approx(np.array((-(1.0 + 0.4), -(2.0 - 0.2), 3.0)))


def test_joints_count_from_the_default_pose_and_in_the_term_s_order():
    term = Term("q", "joint_pos_rel", ("b", "a"))
    assert FUNCTIONS["joint_pos_rel"](now(seen()), term) == pytest.approx(np.array((-0.5, 0.0)))
    term = Term("q", "joint_pos", ("b", "a"))
    assert FUNCTIONS["joint_pos"](now(seen()), term) == pytest.approx(np.array((-1.0, 0.5)))


def test_a_phase_turns_once_in_its_period():
    term = Term("p", "gait_phase", params={"period": 0.8})
    assert FUNCTIONS["gait_phase"](now(seen(time=0.2)), term) == pytest.approx(np.array((1.0, 0.0)))


def test_it_clips_before_it_scales_unless_the_file_says_otherwise():
    term = Term("c", "velocity_commands", scale=(2.0, 1.0, 1.0), clip=(-8.0, 8.0))
    assert Observer(policy(term)).look(now(seen())) == pytest.approx(np.array((14.0, 8.0, 8.0)))
    first = Observer(policy(term, scale_first=True))
    assert first.look(now(seen())) == pytest.approx(np.array((8.0, 8.0, 8.0)))


def test_histories_begin_full_and_have_the_oldest_first():
    terms = Term("q", "joint_pos", ("a",), history=3), Term("a", "last_action", history=2)
    observer = Observer(policy(*terms))
    assert observer.look(now(seen())).tolist() == [0.5, 0.5, 0.5, -1.0, 1.0, -1.0, 1.0]
    assert observer.look(now(seen(q=1.0))).tolist()[:3] == [0.5, 0.5, 1.5]


def test_histories_step_by_step():
    terms = Term("q", "joint_pos", ("a",), history=2), Term("a", "last_action", history=2)
    observer = Observer(policy(*terms, by_time=True))
    observer.look(now(seen()))
    assert observer.look(now(seen(q=1.0))).tolist() == [0.5, -1.0, 1.0, 1.5, -1.0, 1.0]


@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_term_has_as_many_numbers_as_it_says(function: str):
    joints = JOINTS if function.startswith("joint_") else ()
    term = Term("t", function, joints, params={"period": 1.0})
    told = policy(term)
    assert len(Observer(told).look(now(seen()))) == width(term, told)
