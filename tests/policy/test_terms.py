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


AN_IMU = (np.diag((-1.0, -1.0, 1.0)), np.array((0.0, 0.0, 2.0)))
"""Half a turn about z, and where it sits, m."""
VALUES = {
    # A base that is pitched nose down by a quarter turn has gravity ahead of it.
    "gravity": (
        Term("g", "projected_gravity"), now(seen(quat=(HALF, 0.0, HALF, 0.0))), (1.0, 0.0, 0.0)),
    # v = v0 + w x p, then turned into its frame.
    "an IMU": (
        Term("v", "imu_lin_vel"), now(seen(), AN_IMU), (-(1.0 + 0.4), -(2.0 - 0.2), 3.0)),
    "from the default pose": (
        Term("q", "joint_pos_rel", ("b", "a")), now(seen()), (-0.5, 0.0)),
    "in the term's order": (Term("q", "joint_pos", ("b", "a")), now(seen()), (-1.0, 0.5)),
    "a phase": (
        Term("p", "gait_phase", params={"period": 0.8}), now(seen(time=0.2)), (1.0, 0.0)),
}  # fmt: skip


@pytest.mark.parametrize("what", VALUES)
def test_a_term_is_what_its_formula_says(what: str):
    term, at, expected = VALUES[what]
    assert FUNCTIONS[term.function](at, term) == pytest.approx(np.array(expected))


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
