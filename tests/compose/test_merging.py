"""The tables of a composite: each name is spoken of by its own robot's rows, and by one only."""

from __future__ import annotations

import re

import pytest

from assetbuild.compose.merging import (
    Mounted,
    anchored,
    composed,
    home_of_parts,
    left_out,
    poses_in_source_keys,
)
from assetbuild.recipe.models import Recipe
from assetbuild.robot.ranges import first_match

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


def test_feet_of_all_parts_are_feet_and_no_others():
    made = whole({"feet": {"links": ".*_foot"}}, {"feet": {"links": "pad"}})
    assert made.feet is not None
    found = [n for n in ("FL_foot", "arm_pad", "arm_foot") if re.fullmatch(made.feet.links, n)]
    assert found == ["FL_foot", "arm_pad"]
    assert whole({}, {}).feet is None


def test_the_imu_is_the_bases_and_that_of_a_part_keeps_its_prefix():
    made = whole({"imu": {"link": "trunk"}}, {"imu": {"link": "hand", "sensors": ["gyro"]}})
    assert made.imu is not None
    assert made.imu.link == "trunk"
    assert {n: (s.kind, s.link) for n, s in made.sensors.items()} == {
        "arm_imu_ang_vel": ("gyro", "arm_hand")
    }
    alone = whole({}, {"imu": {"link": "hand"}})
    assert alone.imu is not None
    assert (alone.imu.link, alone.sensors) == ("arm_hand", {})


def test_ranges_of_a_part_are_about_the_part():
    made = whole(
        {"randomize": {"links": {".*": {"com": 0.02}}, "friction": [0.4, 1]}},
        {
            "randomize": {
                "links": {".*": {"com": 0.001}},
                "payloads": [{"link": "hand", "mass": [0, 1], "size": [0.1, 0.1, 0.1]}],
            }
        },
    )
    assert made.randomize is not None
    shift = {n: first_match(made.randomize.links, n) for n in ("trunk", "arm_hand")}
    assert {n: row and row.com for n, row in shift.items()} == {"trunk": 0.02, "arm_hand": 0.001}
    assert made.randomize.payloads[0].link == "arm_hand"
    assert made.randomize.friction == (0.4, 1)


def test_what_only_one_can_decide_is_named():
    base, part = recipe(visual={"max_faces": 500}), recipe(visual={"max_faces": 900}, mjcf={})
    assert left_out(base, part) == ("visual",)
    assert left_out(base, recipe(visual={"max_faces": 500})) == ()


def test_of_a_part_from_mjcf_only_what_its_recipe_states_changes_its_surfaces():
    mjcf = {"source": {"path": ".", "mjcf": "arm.xml"}}
    made = whole({"contact": {"friction": [0.8, 0, 0]}}, mjcf)
    assert made.contact.links == {}
    made = whole({}, mjcf | {"contact": {"condim": 4, "links": {"hand": {"priority": 1}}}})
    said = {p: s.model_dump(exclude_none=True) for p, s in made.contact.links.items()}
    assert said == {
        anchored("arm_", "hand"): {"condim": 4, "priority": 1},
        anchored("arm_", ".*"): {"condim": 4},
    }


@pytest.mark.parametrize("merges", [(True, True), (True, False), (False, True), (False, False)])
def test_each_side_merges_its_fixed_joints_as_its_own_recipe_says(merges):
    base, arm = ({"fixed_joints": {"merge": merge}} for merge in merges)
    fixed = whole(base, arm).fixed_joints
    for link, merge in zip(("trunk", "arm_hand"), merges, strict=True):
        stays = not fixed.merge or any(re.fullmatch(p, link) for p in fixed.keep_bodies)
        assert stays != merge


def test_poses_of_a_source_hold_where_no_recipe_has_one():
    row = {"recipe": "arm.yaml", "as": "arm_", "at": {"link": "trunk"}, "home": {"joint2": 9}}
    base = recipe(compose=[row])
    poses = {"home": {"joint1": 1.0, "joint2": 2.0}, "up": {"joint1": 3.0, "joint2": 4.0}}
    arm = Mounted(base.compose[0], recipe(), ("arm_base",), ARM_JOINTS, poses)

    def values(pose: dict[str, float]) -> list[float]:
        return [v for joint in ARM_JOINTS for k, v in pose.items() if re.fullmatch(k, joint)]

    assert home_of_parts([arm]) is not None
    assert values(home_of_parts([arm]).joints) == [1, 9]
    added = poses_in_source_keys(base, [arm], ("home", "up", "lie"))
    assert {name: values(pose) for name, pose in added.items()} == {
        "home": [1, 9],
        "up": [3, 4],
        "lie": [1, 2],
    }
    said = recipe(keyframes={"home": {"joints": {"joint.*": 5}}})
    by_recipe = Mounted(base.compose[0], said, ("arm_base",), ARM_JOINTS, poses)
    assert [by_recipe.pose_key(name) for name in ("home", "up", "lie")] == [
        ("home", False),
        ("up", True),
        ("home", False),
    ]
    assert (
        home_of_parts([Mounted(recipe(compose=[row | {"home": {}}]).compose[0], recipe(), (), ())])
        is None
    )
