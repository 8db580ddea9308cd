"""The tables of a composite: each name is spoken of by its own robot's rows, and by one only."""

from __future__ import annotations

import re
from typing import Any

import pytest
import yaml
from composites import Named, members

from assetbuild.compose.merging import Composed, composed, left_out, pose_of, pose_rows
from assetbuild.errors import RecipeError
from assetbuild.pipeline.recipes import whole_model
from assetbuild.recipe.models import Recipe
from assetbuild.robot.ranges import first_match

DOG = Named(("FL_hip_joint", "FR_hip_joint", "tail"), ("trunk", "FL_foot", "FR_foot", "tail_link"))
ARM = Named(("joint1", "joint2"), ("base", "upper", "hand"))


def recipe(**more: Any) -> Recipe:
    head = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    return whole_model().model_validate(head | more)


def whole(dog: dict[str, Any], arm: dict[str, Any], **row: Any) -> Composed:
    base = Named(DOG.joints, DOG.links, dog)
    return composed(members(base, arm_=Named(ARM.joints, ARM.links, arm, row)))


def merged(dog: dict[str, Any], arm: dict[str, Any], **row: Any) -> Recipe:
    return whole(dog, arm, **row).recipe


def gains(made: Recipe) -> dict[str, list[float | None]]:
    joints = [*DOG.joints, *(f"arm_{joint}" for joint in ARM.joints)]
    return {j: [r.kp for r in made.actuators if re.fullmatch(r.joints, j)] for j in joints}


def test_a_row_of_the_base_that_names_joints_of_a_part_wins_over_the_part():
    rows = [{"joints": ".*_hip_joint", "kp": 80}, {"joints": "tail|arm_joint1", "kp": 33}]
    made = merged({"actuators": rows}, {"actuators": [{"joints": "joint.*", "kp": 20}]})
    assert gains(made)["tail"] == gains(made)["arm_joint1"] == [33]
    assert gains(made)["arm_joint2"] == [20]
    assert len(made.actuators) == 3, "a row stays one row, however many names it has"


def test_motors_come_with_the_part_and_keep_their_family():
    motors = {"m": {"gear": 9}, "big": {"extends": "m", "effort": 60}}
    drives = [{"joints": ".*", "kp": 1, "motor": "big"}]
    made = merged({"motors": {"m": {"gear": 6}}}, {"motors": motors, "actuators": drives})
    assert made.motors["m"].gear == 6
    assert made.motors["arm_m"].gear == 9
    assert made.motors["arm_big"].extends == "arm_m"
    assert made.actuators[0].motor == "arm_big"


def test_home_is_of_all_parts():
    made = merged(
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


def test_two_patterns_for_the_same_joints_are_an_error_at_the_second():
    poses = {"keyframes": {"home": {"joints": {"joint1": 0.5, "joint[1]": 0.6}}}}
    with pytest.raises(RecipeError, match="`joint1` matches joint `arm_joint1` too") as error:
        merged({"keyframes": {"home": {}}}, poses)
    assert error.value.where is not None
    assert error.value.where.file == "arm_.yaml"


def test_collision_and_surface_of_a_part_stay_its_own():
    made = merged(
        {"collision": {"links": {".*": {"method": "none"}}}, "contact": {"friction": [0.8, 0, 0]}},
        {"collision": {"default": {"method": "hull"}}, "contact": {"friction": [0.3, 0, 0]}},
        exclude=["trunk"],
        mount={"mass": 1, "size": [1, 1, 1]},
    )

    def first(table, name):
        return next(v for pattern, v in table.items() if re.fullmatch(pattern, name))

    assert first(made.collision.links, "trunk").method == "none"
    for link in ("arm_hand", "arm_mount_plate"):
        assert first(made.collision.links, link).method == "hull"
        assert first(made.contact.links, link).friction == (0.3, 0, 0)
    assert ("trunk", "arm_hand") in made.collision.exclude.pairs
    assert ("trunk", "arm_mount_plate") not in made.collision.exclude.pairs


def test_feet_of_all_parts_are_feet_and_no_others():
    made = merged({"feet": {"links": ".*_foot"}}, {"feet": {"links": "hand"}})
    assert made.feet is not None
    assert made.feet.links == "FL_foot|FR_foot|arm_hand"
    assert merged({}, {}).feet is None


def test_the_imu_is_the_bases_and_that_of_a_part_keeps_its_prefix():
    made = merged({"imu": {"link": "trunk"}}, {"imu": {"link": "hand", "sensors": ["gyro"]}})
    assert made.imu is not None
    assert made.imu.link == "trunk"
    sensors = {name: (sensor.kind, sensor.link) for name, sensor in made.sensors.items()}
    assert sensors == {"arm_imu_ang_vel": ("gyro", "arm_hand")}
    alone = merged({}, {"imu": {"link": "hand"}})
    assert alone.imu is not None
    assert (alone.imu.link, alone.sensors) == ("arm_hand", {})


def test_sensors_and_cameras_of_a_part_sit_on_the_part():
    arm = {
        "sensors": {"speed": {"kind": "framelinvel", "link": "hand", "relative_to": "base"}},
        "cameras": {"eye": {"link": "hand"}, "room": {}},
    }
    made = merged({}, arm)
    speed = made.sensors["arm_speed"]
    assert (speed.link, speed.relative_to) == ("arm_hand", "arm_base")
    assert {n: c.link for n, c in made.cameras.items()} == {"arm_eye": "arm_hand", "arm_room": None}


def test_ranges_of_a_part_are_about_the_part():
    payload = {"link": "hand", "mass": [0, 1], "size": [0.1, 0.1, 0.1]}
    arm = {"links": {".*": {"com": 0.001}}, "payloads": [payload]}
    dog = {"links": {".*": {"com": 0.02}}, "friction": [0.4, 1]}
    made = merged({"randomize": dog}, {"randomize": arm})
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
    made = merged({"contact": {"friction": [0.8, 0, 0]}}, mjcf)
    assert made.contact.links == {}
    made = whole({}, mjcf | {"contact": {"condim": 4, "links": {"hand": {"priority": 1}}}})
    links = made.recipe.contact.links
    assert {p: s.model_dump(exclude_none=True) for p, s in links.items()} == {
        "arm_hand": {"condim": 4, "priority": 1},
        "arm_base|arm_upper|arm_hand": {"condim": 4},
    }
    assert made.common_surfaces == ("arm_base|arm_upper|arm_hand",)


@pytest.mark.parametrize("merges", [(True, True), (True, False), (False, True), (False, False)])
def test_each_side_merges_its_fixed_joints_as_its_own_recipe_says(merges):
    base, arm = ({"fixed_joints": {"merge": merge}} for merge in merges)
    fixed = merged(base, arm).fixed_joints
    for link, merge in zip(("trunk", "arm_hand"), merges, strict=True):
        stays = not fixed.merge or any(re.fullmatch(p, link) for p in fixed.keep_bodies)
        assert stays != merge


def test_poses_of_a_source_hold_where_no_recipe_has_one():
    poses = {"home": {"joint1": 1.0, "joint2": 2.0}, "up": {"joint1": 3.0, "joint2": 4.0}}
    arm = Named(ARM.joints, ARM.links, row={"home": {"joint2": 9}}, poses=poses)
    found = members(DOG, arm_=arm)
    assert composed(found).recipe.keyframes["home"].joints == {"arm_joint2": 9, "arm_joint1": 1}
    stands = {name: pose_of(pose_rows(found, name)) for name in ("home", "up", "lie")}
    assert {name: (p["arm_joint1"], p["arm_joint2"]) for name, p in stands.items()} == {
        "home": (1, 9),
        "up": (3, 4),
        "lie": (1, 2),
    }
    said = {"keyframes": {"home": {"joints": {"joint.*": 5}}}}
    _, by_recipe = members(DOG, arm_=Named(ARM.joints, ARM.links, said, poses=poses))
    assert [by_recipe.pose_key(name) for name in ("home", "up", "lie")] == [
        ("home", False),
        ("up", True),
        ("home", False),
    ]
    assert composed(members(DOG, arm_=ARM)).recipe.keyframes == {}


def key_of(words: str) -> tuple[str | int, ...]:
    """`actuators 0 kp` as the path of a key."""
    return tuple(int(word) if word.isdigit() else word for word in words.split())


@pytest.mark.parametrize(
    ("key", "whose", "own"),
    [
        ("actuators 0 kp", "base.yaml", "actuators 0 kp"),
        ("actuators 1 kp", "arm_.yaml", "actuators 0 kp"),
        ("motors arm_m gear", "arm_.yaml", "motors m gear"),
        ("collision links arm_hand method", "arm_.yaml", "collision links hand method"),
        ("collision exclude pairs 1 0", "arm_.yaml", "collision exclude pairs 0 0"),
        ("sensors arm_turn link", "arm_.yaml", "sensors turn link"),
        ("keyframes home joints arm_joint1", "arm_.yaml", "keyframes home joints joint1"),
        ("keyframes home joints arm_joint2", "base.yaml", "compose 0 home joint2"),
        ("randomize links arm_upper com", "arm_.yaml", "randomize links upper com"),
        ("simulation timestep", "base.yaml", "simulation timestep"),
    ],
)
def test_a_row_keeps_the_line_where_it_is_written(key, whose, own):
    dog = yaml.safe_load("""
        actuators: [{joints: .*, kp: 80}]
        collision: {exclude: {pairs: [[trunk, FL_foot]]}}
        keyframes: {home: {joints: {tail: 1}}}
        simulation: {timestep: 0.004}
    """)
    arm = yaml.safe_load("""
        motors: {m: {gear: 9}}
        actuators: [{joints: .*, kp: 20}]
        collision: {links: {hand: {method: hull}}, exclude: {pairs: [[hand, base]]}}
        keyframes: {home: {joints: {joint1: 0.5, joint2: 0.1}}}
        sensors: {turn: {kind: gyro, link: upper}}
        randomize: {links: {upper: {com: 0.001}}}
    """)
    base = Named(DOG.joints, DOG.links, dog)
    found = members(base, arm_=Named(ARM.joints, ARM.links, arm, {"home": {"joint2": 0.7}}))
    recipes = {member.loaded.file: member.loaded for member in found}
    line = recipes[whose].where(key_of(own))
    assert composed(found).where(key_of(key)) == line != recipes[whose].where(key_of(own)[:-1])
