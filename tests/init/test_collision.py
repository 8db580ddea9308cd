"""What `init` writes for links whose collision no simulator could use, or that have none."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest
import trimesh
from proposals import proposed
from tiny import flat_obj
from urdfs import LIMIT, box, inertial, joint, link, mesh, robot, shape, tensor

PLATE, BOX = mesh("plate.obj"), box()


def rules_of(folder: Path, *shapes: str) -> dict[str, dict[str, str]]:
    """`collision.links` of an arm whose last link has these shapes."""
    (folder / "plate.obj").write_bytes(flat_obj())
    turns = joint("j", "world", "tip", axis="0 0 1")
    links = link("world", shape("collision", BOX)), link("tip", inertial(), *shapes)
    return dict(proposed(robot(*links, turns), folder).plain["collision"].get("links", {}))


@pytest.mark.parametrize(
    ("shapes", "rule"),
    [
        ([("visual", BOX), ("collision", PLATE)], {"method": "auto", "from": "visual"}),
        ([("visual", PLATE), ("collision", PLATE)], {"method": "none"}),
    ],
)
def test_a_flat_mesh_is_no_collision_shape(
    shapes: list[tuple[str, str]], rule: dict[str, str], tmp_path: Path
):
    assert rules_of(tmp_path, *(shape(*one) for one in shapes)) == {"tip": rule}


def test_a_box_needs_no_rule_of_its_own(tmp_path: Path):
    assert rules_of(tmp_path, shape("visual", PLATE), shape("collision", BOX)) == {}


@pytest.mark.parametrize(("width", "ball"), [(0.04, True), (0.005, False)])
def test_a_foot_that_is_a_thin_disc_is_no_sphere(
    width: float, ball: bool, robots: Path, tmp_path: Path
):
    trimesh.creation.box((0.04, width, 0.04)).export(tmp_path / "foot.stl")
    text = (robots / "four_legs.urdf").read_text()
    text = text.replace('<sphere radius="0.02"/>', '<mesh filename="foot.stl"/>')
    assert ("links" in proposed(text, tmp_path).plain["collision"]) is ball


def dog_on_air(robots: Path, folder: Path, *, drawn: bool) -> dict[str, Any]:  # Any: YAML
    """The recipe of a dog whose calves and feet hit nothing; drawn: whether feet are seen."""
    lines = []
    for line in (robots / "four_legs.urdf").read_text().splitlines():
        if ("_foot" in line or "_calf" in line) and "<collision>" in line:
            start, end = line.index("<collision>"), line.index("</collision>")
            ball = line[start + len("<collision>") : end]
            seen = f"<visual>{ball}</visual>" if drawn and "_foot" in line else ""
            line = line[:start] + seen + line[end + len("</collision>") :]
        lines.append(line)
    return proposed("\n".join(lines), folder).plain


def test_feet_without_collision_get_what_is_drawn_of_them_and_the_dog_stands(
    robots: Path, tmp_path: Path
):
    recipe = dog_on_air(robots, tmp_path, drawn=True)
    assert list(recipe["collision"]["links"].values()) == [{"method": "auto", "from": "visual"}]
    assert recipe["validate"]["stand"]["keyframe"] == "home"


def test_a_dog_with_no_feet_at_all_is_not_asked_to_stand(robots: Path, tmp_path: Path):
    recipe = dog_on_air(robots, tmp_path, drawn=False)
    assert "stand" not in recipe["validate"]


def test_bodies_around_three_joints_at_one_point_do_not_collide(tmp_path: Path):
    """Pelvis and thigh at a ball joint of three; the shank is as near, but at another point."""
    names = ("pelvis", "a", "b", "thigh", "shank")
    links = "".join(map(link, names))
    joints = "".join(
        joint(f"j{i}", above, below, xyz="0 0 -0.01" if below == "shank" else "0 0 0", axis=axis)
        for i, (above, below, axis) in enumerate(
            zip(names, names[1:], ("1 0 0", "0 1 0", "0 0 1", "0 1 0"), strict=False)
        )
    )
    far = link("far") + joint("j", "pelvis", "far", xyz="1 0 0")
    pairs = proposed(robot(links, joints, far), tmp_path).plain["collision"]["exclude"]["pairs"]
    assert ["pelvis", "thigh"] in pairs
    assert ["pelvis", "shank"] not in pairs


def test_links_that_one_drive_turns_side_by_side_do_not_collide(tmp_path: Path):
    """The knuckles of a parallel gripper; the fingers that face each other do."""

    def knuckle(name: str, y: str, mimic: str = "") -> str:
        at = {"xyz": f"0 {y} 0.05", "axis": "1 0 0"}
        turns = joint(f"{name}_j", "palm", name, content=LIMIT + mimic, **at)
        return link(name, inertial(), shape("collision", BOX)) + turns

    def led(share: int) -> str:
        return f'<mimic joint="left_outer_j" multiplier="{share}"/>'

    hand = robot(
        link("palm", inertial(), shape("collision", BOX)),
        knuckle("left_outer", "0.05"),
        knuckle("left_inner", "0.02", led(1)),
        knuckle("right_outer", "-0.05", led(-1)),
        knuckle("right_inner", "-0.02", led(-1)),
    )
    pairs = proposed(hand, tmp_path).plain["collision"]["exclude"]["pairs"]
    assert pairs[:2] == [["left_outer", "left_inner"], ["right_outer", "right_inner"]]
    assert ["left_outer", "right_outer"] not in pairs


def test_what_a_finger_holds_by_a_fixed_joint_gets_its_surface_and_shape(tmp_path: Path):
    """As in an OrcaHand, whose moving links have no geometry of their own."""

    def finger(name: str, y: str) -> str:
        at = {"xyz": f"0 {y} 0.03", "axis": "1 0 0"}
        turns = joint(f"{name}_j", "palm", f"{name}_body", content=LIMIT, **at)
        tip = link(f"{name}_tip", light, shape("collision", box(0.02)))
        fixed = joint(f"{name}_fixed", f"{name}_body", f"{name}_tip", "fixed", xyz="0 0 0.02")
        return link(f"{name}_body", light) + turns + tip + fixed

    light = inertial(0.02, tensor(1e-5, 1e-5, 1e-5))
    palm = link("palm", inertial(), shape("collision", BOX))
    hand = robot(palm, *(finger(f"finger_{n}", f"0.0{3 * n}") for n in range(1, 4)))
    recipe = proposed(hand, tmp_path).plain
    (pattern,) = recipe["contact"]["links"]
    assert recipe["collision"]["preset"] == "locomotion"
    assert recipe["collision"]["links"] == {pattern: {"preset": "manipulation"}}
    links = ["palm", *(f"finger_{n}_{part}" for n in range(1, 4) for part in ("body", "tip"))]
    named = [name for name in links if re.fullmatch(pattern, name)]
    assert named == ["palm", "finger_1_tip", "finger_2_tip", "finger_3_tip"]


def crowd(turn: float, more: str = "") -> str:
    """Two balls of 50 mm on hinges: 40 mm deep in each other at 0, 100 mm apart at a half turn."""
    side = """<body name="{}" pos="{} 0 0"><joint name="{}_joint" axis="0 0 1"
    range="-180 180"/><geom pos="{} 0 0" size="0.05" mass="1"/></body>"""
    bodies = side.format("left", -0.1, "left", 0.07) + side.format("right", 0.1, "right", -0.07)
    return f"""<mujoco model="crowd"><worldbody><body name="base"><geom pos="0 0 -1" size="0.01"/>
    {bodies}</body></worldbody>
    <actuator><position joint="left_joint" kp="10"/><position joint="right_joint" kp="10"/>
    </actuator><keyframe><key name="home" qpos="{turn} 0"/></keyframe>{more}</mujoco>"""


BALL = """<worldbody><body name="ball" pos="-0.17 0 0"><joint name="ball_joint" axis="0 0 1"/>
<geom size="0.05" mass="1"/></body></worldbody>"""


@pytest.mark.parametrize(
    ("turn", "more", "pairs"),
    [
        (0.0, "", (("left", "right"),)),
        (math.pi, "", ()),
        (0.0, '<contact><exclude body1="left" body2="right"/></contact>', ()),
        (math.pi, BALL, ()),
    ],
    ids=["in each other", "apart", "excluded", "a ball to push"],
)
def test_bodies_that_lie_in_each_other_where_the_source_starts_pass(
    turn: float, more: str, pairs: tuple[tuple[str, str], ...], tmp_path: Path
):
    made = proposed(crowd(turn, more), tmp_path)
    assert made.recipe.collision.exclude.pairs == pairs
    assert ("# left in right: 40 mm" in made.text) == bool(pairs)
