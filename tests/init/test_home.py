"""A home that `init` writes lies neither in the floor nor in itself, and a biped stands in it.

MuJoCo reads the source itself, without us, and says how deep its shapes lie in each other.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import pytest
import urdfs
from proposals import Proposed, proposed

LIMIT_M = 0.005


def link(name: str, mass: float, geometry: str, at: str = "0 0 0") -> str:
    """A link of one solid shape."""
    moment = mass * 0.01
    solid = urdfs.inertial(mass, urdfs.tensor(moment, moment, moment), at)
    return urdfs.link(name, solid, urdfs.shape("collision", geometry, at))


def joint(
    name: str, above: str, below: str, at: str, axis: str = "0 1 0", effort: float = 90
) -> str:
    """A hinge of nearly half a turn to both sides."""
    limit = f'<limit lower="-3" upper="3" effort="{effort}" velocity="9"/>'
    return urdfs.joint(name, above, below, content=limit, xyz=at, axis=axis)


BALL, ROD = '<sphere radius="0.05"/>', '<box size="0.04 0.04 0.3"/>'
KNEE = "0 0 -0.3"
LONG = '<box size="0.4 0.04 0.04"/>'
POST = urdfs.link("world", "") + urdfs.joint("fix", "world", "post", "fixed", "", xyz="0 0 0")


def arm(side: str, y: float, z: float, reach: str = "0.4 0 0", turned: str = "0 0 1") -> str:
    """A long box and a ball at its end, from a shoulder at height z."""
    return (
        joint(f"{side}_shoulder", "post", f"{side}_arm", f"0 {y} {z}", turned)
        + link(f"{side}_arm", 1.0, LONG, "0.25 0 0")
        + joint(f"{side}_wrist", f"{side}_arm", f"{side}_hand", reach)
        + link(f"{side}_hand", 0.3, BALL, "0.1 0 0")
    )


ROBOTS = {
    "an arm whose hand lies 30 mm in the floor": (
        POST + link("post", 5, ROD, "0 0 0.15") + arm("a", 0, 0.14, "0.4 0 -0.12", "0 1 0"),
        True,
    ),
    "an arm whose hand hangs 2 mm in the floor": (
        POST + link("post", 5, ROD, "0 0 0.15") + arm("a", 0, 0.14, "0.4 0 -0.092", "0 1 0"),
        False,
    ),
    "two arms whose hands meet": (
        POST + link("post", 5, ROD, "0 0 0.15") + arm("l", 0.04, 0.4) + arm("r", -0.04, 0.4),
        True,
    ),
    "two arms whose hands touch by 2 mm": (
        POST + link("post", 5, ROD, "0 0 0.15") + arm("l", 0.049, 0.4) + arm("r", -0.049, 0.4),
        False,
    ),
    "a hand folded into its post": (
        POST + link("post", 5, ROD, "0 0 0.15") + arm("a", 0.2, 0.25, "-0.1 -0.17 0"),
        True,
    ),
    "a hand above the floor and beside the post": (
        POST + link("post", 5, ROD, "0 0 0.15") + arm("a", 0.2, 0.25),
        False,
    ),
}


def home_of(made: Proposed, names: list[str]) -> dict[str, float]:
    """Joint values of the recipe's `home`."""
    stated = made.plain.get("keyframes", {}).get("home", {}).get("joints", {})
    found = dict.fromkeys(names, 0.0)
    for pattern, value in stated.items():
        found |= {name: value for name in names if re.fullmatch(pattern, name)}
    return found


def deepest(urdf: str, pose: dict[str, float]) -> float:
    """By MuJoCo's own reader of URDF, with a floor at z = 0, m."""
    spec = mujoco.MjSpec.from_string(urdf)
    floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1])
    floor.name = "floor"
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in pose.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    return max((-float(c.dist) for c in data.contact[: data.ncon]), default=0.0)


@pytest.mark.parametrize("name", ROBOTS)
def test_home_is_clear_of_the_floor_and_of_itself(name: str, tmp_path: Path):
    body, deep = ROBOTS[name]
    urdf = urdfs.robot(body)
    names = re.findall(r'joint name="(\w+)" type="rev', urdf)
    home = home_of(proposed(urdf, tmp_path), names)
    assert (deepest(urdf, dict.fromkeys(names, 0.0)) > LIMIT_M) is deep
    assert deepest(urdf, home) <= LIMIT_M
    assert any(home.values()) is deep


COLUMN = '<cylinder radius="0.05" length="0.6"/>'


@pytest.mark.parametrize(
    ("axis", "reach", "always"),
    [
        ("0 0 1", "0 0 0.3", True),  # a sleeve on the column, whatever turns
        ("0 1 0", "0 0 0.06", True),  # 60 mm from the axis of the column at most
        ("0 1 0", "-0.25 0 0.25", False),  # in the column at 0 only
        ("0 0 1", "0.098 0 0.3", False),  # 2 mm
        ("0 0 1", "0.3 0 0.3", False),
    ],
)
def test_bodies_that_are_made_to_lie_in_each_other_never_collide(
    axis: str, reach: str, always: bool, tmp_path: Path
):
    """A ball that a second hinge carries about the column below the first."""
    at = {"0 0 1": "0 0 0.1", "0 1 0": "0.25 0 0.1" if reach.startswith("-") else "0 0 0.3"}[axis]
    body = (
        POST
        + link("post", 5, COLUMN, "0 0 0.3")
        + joint("turn", "post", "cart", "0 0 0.1", "0 0 1")
        + link("cart", 0.5, '<sphere radius="0.01"/>')
        + joint("swing", "cart", "ball", at, axis)
        + link("ball", 0.5, BALL, reach)
    )
    said = proposed(urdfs.robot(body), tmp_path).plain
    pairs = [set(pair) for pair in said["collision"]["exclude"].get("pairs", [])]
    assert ({"post", "ball"} in pairs) is always


def biped(ahead: float, ankle: float, foot: str = '<box size="0.2 0.08 0.04"/>') -> str:
    """30 kg on two legs of 0.8 m. ahead: of the trunk's mass before the hips, m; ankle: N m."""
    parts = [link("trunk", 20, '<box size="0.2 0.3 0.4"/>', f"{ahead} 0 0.25")]
    for side, y in (("left", 0.12), ("right", -0.12)):
        above = "trunk"
        for part, axis, down, effort in (
            ("hip_yaw", "0 0 1", 0.0, 90.0),
            ("hip_roll", "1 0 0", 0.05, 90.0),
            ("hip_pitch", "0 1 0", 0.05, 90.0),
            ("knee", "0 1 0", 0.35, 90.0),
            ("ankle_pitch", "0 1 0", 0.35, ankle),
            ("ankle_roll", "1 0 0", 0.02, ankle),
        ):
            at = f"0 {y if above == 'trunk' else 0} {-down}"
            parts.append(joint(f"{side}_{part}", above, f"{side}_{part}_link", at, axis, effort))
            above = f"{side}_{part}_link"
            shape = foot if part == "ankle_roll" else '<sphere radius="0.02"/>'
            at = "0.03 0 -0.04" if part == "ankle_roll" else "0 0 0"
            parts.append(link(above, 0.8, shape, at))
    return f'<robot name="biped">{"".join(parts)}</robot>'


def test_a_shank_without_a_foot_stands_on_its_lowest_point_below_the_hip(tmp_path: Path):
    """Thigh and shank are 0.3 m: at 0.75 of the leg's length, the thigh turns by acos(0.75)."""
    parts = [link("trunk", 8, '<box size="0.6 0.2 0.1"/>')]
    for name, place in {"a": "0.3 0.2", "b": "0.3 -0.2", "c": "-0.3 0.2", "d": "-0.3 -0.2"}.items():
        for part, above, at in (("thigh", "trunk", f"{place} 0"), ("shank", f"thigh_{name}", KNEE)):
            parts.append(joint(f"{part}_{name}", above, f"{part}_{name}", at))
            parts.append(link(f"{part}_{name}", 0.5, ROD, "0 0 -0.15"))
    joints = proposed(urdfs.robot(*parts), tmp_path).plain["keyframes"]["home"]["joints"]
    turn = math.acos(0.75)
    assert joints == pytest.approx({"thigh_.*": turn, "shank_.*": -2 * turn}, abs=0.1)


@pytest.mark.parametrize(
    ("ahead", "ankle", "foot", "stands"),
    [
        (0.03, 30.0, '<box size="0.2 0.08 0.04"/>', True),  # kp by effort: 100 N m/rad of 140
        pytest.param(  # and behind them
            -0.10, 60.0, '<box size="0.2 0.08 0.04"/>', True, marks=pytest.mark.slow
        ),
        (0.03, 30.0, '<sphere radius="0.02"/>', False),  # nothing stands on two points
    ],
)
def test_a_biped_gets_gains_and_a_home_in_which_it_stands(
    ahead: float, ankle: float, foot: str, stands: bool, tmp_path: Path
):
    text = proposed(biped(ahead, ankle, foot), tmp_path).text
    assert ("  stand: {keyframe: home" in text) is stands
    assert ("points that span no area" in text) is not stands


def crawler(count: int, reach: float) -> str:
    """A disc with legs of 0.2 and 0.2 m that lie level at the zero pose. reach: of the shank, m."""
    parts = [link("trunk", 6, '<cylinder radius="0.15" length="0.06"/>')]
    for leg in range(count):
        turn = 2.0 * math.pi * (leg + 0.5) / count
        x, y = math.cos(turn), math.sin(turn)
        above = "trunk"
        for part, out, axis, end in (
            ("coxa", 0.15, "0 0 1", 0.0),
            ("femur", 0.03, f"{-y} {x} 0", 0.0),
            ("tibia", 0.2, f"{-y} {x} 0", reach),
        ):
            name, at = f"{part}_{leg}", f"{out * x} {out * y} 0"
            parts.append(joint(name, above, name, at, axis))
            parts.append(link(name, 0.2, '<sphere radius="0.02"/>', f"{end * x} {end * y} 0"))
            above = name
    return urdfs.robot(*parts)


@pytest.mark.parametrize(("count", "reach"), [(6, 0.2), (4, -0.2)], ids=["sprawled", "folded"])
def test_legs_that_lie_level_at_zero_are_set_on_their_feet(
    count: int, reach: float, tmp_path: Path
):
    urdf = crawler(count, reach)
    names = re.findall(r'joint name="(\w+)"', urdf)
    made = proposed(urdf, tmp_path)
    model = mujoco.MjModel.from_xml_string(urdf)
    data = mujoco.MjData(model)
    for name, value in home_of(made, names).items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    feet = [data.geom_xpos[model.body(n).geomadr[0]] for n in names if n.startswith("tibia")]
    assert max(foot[2] for foot in feet) < min(foot[2] for foot in feet) + 0.002 < -0.15
    assert made.plain["validate"]["stand"]["feet"]
