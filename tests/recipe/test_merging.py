"""The tables of a composite: each name is spoken of by its own robot's rows, and by one only."""

from __future__ import annotations

import re

import pytest

from assetbuild.recipe.merging import Mounted, anchored, composed
from assetbuild.recipe.models import Recipe

BASE_JOINTS = ("FL_hip_joint", "FR_hip_joint", "tail")
ARM_JOINTS = ("arm_joint1", "arm_joint2")


def recipe(**more) -> Recipe:
    head = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    return Recipe.model_validate(head | more)


def whole(base: dict, arm: dict, **part) -> Recipe:
    row = {"recipe": "arm.yaml", "as": "arm_", "at": {"link": "trunk"}} | part
    base_recipe = recipe(compose=[row], **base)
    links = ("arm_base", "arm_hand")
    mounted = Mounted(base_recipe.compose[0], recipe(**arm), links, ARM_JOINTS)
    return composed(base_recipe, [mounted])


def rows_of(made: Recipe, joint: str) -> list[float | None]:
    return [row.kp for row in made.actuators if re.fullmatch(row.joints, joint)]


def test_each_robot_keeps_its_own_rows_however_wide_their_patterns():
    made = whole(
        {"actuators": [{"joints": ".*", "kp": 80}]}, {"actuators": [{"joints": ".*", "kp": 20}]}
    )
    assert [rows_of(made, joint) for joint in BASE_JOINTS] == [[80]] * 3
    assert [rows_of(made, joint) for joint in ARM_JOINTS] == [[20]] * 2


def test_a_row_of_the_base_that_names_the_prefix_wins_over_the_part():
    made = whole(
        {"actuators": [{"joints": ".*", "kp": 80}, {"joints": "arm_joint1", "kp": 33}]},
        {"actuators": [{"joints": "joint.*", "kp": 20}]},
    )
    assert rows_of(made, "arm_joint1") == [33]
    assert rows_of(made, "arm_joint2") == [20]


def test_motors_come_with_the_part_and_keep_their_family():
    made = whole(
        {"motors": {"m": {"gear": 6}}},
        {
            "motors": {"m": {"gear": 9}, "big": {"extends": "m", "effort": 60}},
            "actuators": [{"joints": ".*", "kp": 1, "motor": "big"}],
        },
    )
    assert made.motors["m"].gear == 6
    assert made.motors["arm_m"].gear == 9
    assert made.motors["arm_big"].extends == "arm_m"
    assert made.actuators[0].motor == "arm_big"


def test_home_is_of_all_parts():
    made = whole(
        {"keyframes": {"home": {"joints": {".*_hip_joint": 0.1}}}},
        {"keyframes": {"home": {"joints": {"joint.*": 0.5}}}},
        home={"joint2": 1.5},
    )
    pose = made.keyframes["home"].joints

    def value(joint: str) -> list[float]:
        return [v for pattern, v in pose.items() if re.fullmatch(pattern, joint)]

    assert value("FL_hip_joint") == [0.1]
    assert value("arm_joint1") == [0.5]
    assert value("arm_joint2") == [1.5]
    assert value("tail") == []


def test_collision_and_surface_of_a_part_stay_its_own():
    made = whole(
        {"collision": {"links": {".*": {"method": "none"}}}, "contact": {"friction": [0.8, 0, 0]}},
        {"collision": {"default": {"method": "hull"}}, "contact": {"friction": [0.3, 0, 0]}},
        exclude=["trunk"],
    )

    def first(table, name):
        return next(v for pattern, v in table.items() if re.fullmatch(pattern, name))

    assert first(made.collision.links, "trunk").method == "none"
    assert first(made.collision.links, "arm_hand").method == "hull"
    assert first(made.contact.links, "arm_hand").friction == (0.3, 0, 0)
    assert ("trunk", "arm_hand") in made.collision.exclude.pairs


@pytest.mark.parametrize("pattern", ["a|b", ".*", "x(1|2)?"])
def test_an_anchored_pattern_matches_what_the_part_would(pattern):
    for name in ("a", "b", "x", "x1", "ab"):
        alone = re.fullmatch(pattern, name) is not None
        assert (re.fullmatch(anchored("arm_", pattern), f"arm_{name}") is not None) == alone
        assert re.fullmatch(anchored("arm_", pattern), name) is None
