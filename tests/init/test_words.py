"""Patterns match what they should, nothing else, and look as if a person wrote them."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from assetbuild.init.draft import LONGEST, patterns_of

DOG = [f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR") for part in ("hip", "thigh", "calf")]
ARM = [f"panda_joint{n}" for n in range(1, 8)]
ARMS = [f"arm_{side}_joint{n}" for side in ("left", "right") for n in range(1, 8)]


@pytest.mark.parametrize(
    ("group", "everything", "pattern"),
    [
        (DOG, DOG, ".*"),
        ([n for n in DOG if "calf" in n], DOG, ".*_calf_joint"),
        ([n for n in DOG if "calf" not in n], DOG, ".*_(hip|thigh)_joint"),
        (ARM[:4], ARM, ".*_joint[1-4]"),
        ([n for n in ARMS if n[-1] in "12"], ARMS, ".*_joint[12]"),
        ([n for n in ARMS if n[-1] in "12"], [*ARMS, "leg_a_joint1"], "arm_.*_joint[12]"),
        (["a.b"], ["a.b", "axb"], r"a\.b"),
        (["left_hip", "right_hip"], ["mid_hip", "left_hip", "right_hip"], "(left|right)_.*"),
        (["LeftHip", "RightHip"], ["LeftHip", "RightHip", "Hip"], "(Left|Right)Hip"),
        (["LHip", "RHip"], ["LHip", "RHip", "Hip"], "[LR]Hip"),
        (["waist", "wrist"], ["waist", "wrist", "hand"], "(waist|wrist)"),
        (["j10", "j11"], ["j1", "j10", "j11"], "j(10|11)"),
    ],
)
def test_the_pattern_a_person_would_write(group: list[str], everything: list[str], pattern: str):
    (found,) = patterns_of(group, everything)
    assert found == pattern
    assert {n for n in everything if re.fullmatch(found, n)} == set(group)


names = st.text("ab_.-1[]()", min_size=1, max_size=6)


@given(st.lists(names, min_size=1, max_size=8, unique=True), st.data())
def test_together_they_match_the_group_once_each(everything: list[str], data: st.DataObject):
    group = data.draw(st.lists(st.sampled_from(everything), min_size=1, unique=True), label="group")
    patterns = patterns_of(group, everything)
    for name in everything:
        hits = sum(re.fullmatch(pattern, name) is not None for pattern in patterns)
        assert hits == (name in group)


def test_a_very_large_group_is_split_over_several_patterns():
    everything = [f"{'x' * n}y{'z' * (60 - n)}" for n in range(50)]
    patterns = patterns_of(everything[::2], everything)
    assert len(patterns) > 1
    assert max(map(len, patterns)) <= LONGEST
