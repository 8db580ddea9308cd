"""Robots that nobody expects: `init` writes a recipe that loads, or says one clear thing."""

# ruff: noqa: E501 # one robot per line reads better than wrapped XML

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from proposals import proposed
from tiny import stl
from urdfs import LIMIT, inertial, joint, link, mesh, robot, shape

from assetbuild.errors import AssetBuildError, SourceError
from assetbuild.init import propose

TRIANGLE = stl(np.array([[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]]))


def seen(file: str, role: str = "visual") -> str:
    """A link that weighs, with a mesh."""
    return inertial() + shape(role, mesh(file))


@pytest.mark.parametrize(
    ("kind", "limit", "becomes"),
    [("revolute", "", "continuous"), ("Revolute", LIMIT, "revolute")],
)
def test_a_type_that_no_build_takes_is_patched(kind: str, limit: str, becomes: str, tmp_path: Path):
    urdf = robot(link("base"), link("arm"), joint("j", "base", "arm", kind, limit))
    (patch,) = proposed(urdf, tmp_path).recipe.source.patches
    assert f'type="{kind}"' in str(patch.find)
    assert patch.replace == str(patch.find).replace(kind, becomes)


BARE = robot(link("base"), link("arm"), joint("j", "base", "arm"))
TWO = f'<?xml version="1.0"?>\n{BARE}'
STRANGE: dict[str, str | bytes] = {
    "words of YAML": robot(
        link("yes"), link("~"), link("- x: {y}"),
        joint("on", "yes", "~"), joint("#c", "~", "- x: {y}"), name="null",
    ),
    "names that are patterns": robot(
        link("a.*"), link("(b"), link("[c"), joint("j+", "a.*", "(b"), joint("k|\\d", "(b", "[c")
    ),
    "names beyond ASCII": robot(
        link("körper 1"), link("arm/链"), link("😀"),
        joint("ö j", "körper 1", "arm/链"), joint("🦾", "arm/链", "😀"), name="Rö bot/1",
    ),
    "names with quotes": robot(
        link("a&quot;b"), link("c&apos;d\\"), joint("&lt;j&gt;", "a&quot;b", "c&apos;d\\")
    ),
    "one link without anything": robot(link("only", "")),
    "followers in a row": robot(
        link("a"), link("b"), link("c"), joint("1", "a", "b", "continuous", ""),
        joint("2", "b", "c", content=LIMIT + '<mimic joint="1" multiplier="-2"/>'),
    ),
    "a byte order mark": b"\xef\xbb\xbf" + TWO.encode(),
    "UTF-16": b"\xff\xfe" + BARE.encode("utf-16-le"),
}  # fmt: skip


@pytest.mark.parametrize("name", STRANGE)
def test_a_strange_robot_gets_a_recipe_that_loads(name: str, tmp_path: Path):
    assert proposed(STRANGE[name], tmp_path).recipe.targets == ("urdf", "mjcf", "usd")


@pytest.mark.parametrize("kind", ["floating", "revolute"])
def test_a_target_that_cannot_hold_a_joint_is_left_out(kind: str, tmp_path: Path):
    above = joint("p", "a", "b", kind, "" if kind == "floating" else LIMIT)
    made = proposed(robot(link("a"), link("b"), link("c"), above, joint("j", "b", "c")), tmp_path)
    assert made.recipe.targets == (("urdf",) if kind == "floating" else ("urdf", "mjcf", "usd"))
    assert ("joint p is" in made.text) == (kind == "floating")


def test_a_planar_base_is_split_and_keeps_its_usd(tmp_path: Path):
    parts = joint("p", "a", "b", "planar"), joint("j", "b", "c")
    made = proposed(robot(link("a"), link("b"), link("c"), *parts), tmp_path)
    assert made.recipe.targets == ("urdf", "mjcf", "usd")
    assert "split_joint: {joint: p}" in made.text
    assert "share_mass: {link:" in made.text


def test_a_cart_that_joints_move_over_its_root_does_not_float_as_well(tmp_path: Path):
    """Else its light root would swing, and not the cart."""
    wheels = [link(f"wheel_{side}") for side in "lr"]
    rolls = [
        joint(f"w{side}", "cart", f"wheel_{side}", "continuous", axis="0 1 0") for side in "lr"
    ]
    plane = joint("p", "root", "cart", "planar")
    slides = [joint("x", "root", "rail", "prismatic"), joint("y", "rail", "cart", "prismatic")]
    for parts in ([plane], [*slides, link("rail", "")]):
        cart = robot(link("root", ""), link("cart"), *parts, *wheels, *rolls)
        assert proposed(cart, tmp_path).recipe.base == "fixed"
    rolling = robot(link("cart"), *wheels, *rolls)
    assert proposed(rolling, tmp_path).recipe.base == "floating"


REFUSED = {
    "absent meshes": (robot(link("a", seen("x.stl")), link("b", seen("y.stl")), joint("j", "a", "b")), r"r\.urdf:2: link a: no file `x.stl` \(and 1 more: `y.stl`\)"),
    "an absent one of a series": (robot(link("a", seen("t1.stl")), link("b", seen("t.stl")), joint("j", "a", "b"), link("c", seen("t1.stl", "collision")), joint("k", "a", "c")), "no file `t1.stl`\nhint: the source holds no file `t1.stl`: copy or clone all of it"),
    "a mesh of no format": (robot(link("a", seen("t"))), "of no known format"),
    "a backslash": (robot(link("a", seen("m\\t.stl"))), "no file `m/t.stl`"),
    "undeclared Latin-1": (TWO.replace("base", "körper").encode("latin-1"), "state its encoding"),
    "a follower of a planar joint": (robot(link("a"), link("b"), link("c"), joint("1", "a", "b", "planar", ""), joint("2", "b", "c", content=LIMIT + '<mimic joint="1"/>')), "no single position"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "hint"),
    [(".", "r.urdf"), ("robot.tar.gz", "unpack"), ("hand.STL", "the description"),
     ("robot.usda", "validate"), ("https://example.org/r", "clone")],
)  # fmt: skip
def test_what_is_no_description_is_refused_with_the_way_on(name: str, hint: str, tmp_path: Path):
    (tmp_path / "r.urdf").touch()
    path = Path(name) if ":" in name else tmp_path / name
    with pytest.raises(SourceError) as caught:
        propose(path, None, {})
    assert hint in caught.value.hint


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(AssetBuildError, match=r"none\.urdf: there is no such file"):
        propose(tmp_path / "none.urdf", None, {})


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_one_clear_error(name: str, tmp_path: Path):
    text, says = REFUSED[name]
    (tmp_path / "r.urdf").write_bytes(text.encode() if isinstance(text, str) else text)
    (tmp_path / "t.stl").write_bytes(TRIANGLE)
    with pytest.raises(SourceError, match=says):
        propose(tmp_path / "r.urdf", None, {})


def _walker(*, last: str, down: float, names: tuple[str, str], limbs: int = 4) -> str:
    """Limbs of two hinges on a trunk. down: how far the shin reaches along -z; else along y."""
    parts = [link("trunk")]
    for i in range(limbs):
        above, side = "trunk", 0.3 if down else 0.0
        for name, kind in ((names[0], "revolute"), (names[1], last)):
            below, at = f"{name}_{i}", f"{i - 1.5} {0.3 - side} {-down}"
            parts.append(link(below))
            parts.append(joint(f"{name}_joint_{i}", above, below, kind, xyz=at))
            above = below
    return robot(*parts, name="bot")


@pytest.mark.parametrize(
    ("last", "down", "names", "base"),
    [
        ("revolute", 0.3, ("thigh", "shank"), "floating"),
        ("continuous", 0.3, ("thigh", "shank"), "floating"),  # MIT's Mini Cheetah
        ("continuous", 0.3, ("thigh", "roll"), "fixed"),
        ("continuous", 0.3, ("thigh", "toe_roll"), "floating"),  # Digit
        ("revolute", 0.0, ("upper_leg", "lower_leg"), "floating"),  # Laikago lies on its side
        ("revolute", 0.0, ("femur", "tibia"), "floating"),  # as the words of hexapods have it
        ("revolute", 0.0, ("upper_arm", "fore_arm"), "fixed"),
        ("revolute", 0.0, ("link_1", "link_2"), "fixed"),
    ],
)
def test_legs_are_known_by_where_they_reach_or_by_their_names(
    last: str, down: float, names: tuple[str, str], base: str, tmp_path: Path
):
    walker = _walker(last=last, down=down, names=names)
    assert proposed(walker, tmp_path).recipe.base == base


@pytest.mark.parametrize("down", [0.3, 0.0])
def test_what_is_bolted_to_the_world_does_not_stand(down: float, tmp_path: Path):
    """Its legs hang or point aside, and the recipe says how they would walk."""
    walker = _walker(last="revolute", down=down, names=("thigh", "shank"))
    bolt = link("world", "") + joint("bolt", "world", "trunk", "fixed", "")
    text = proposed(walker.replace("</robot>", f"{bolt}</robot>"), tmp_path).text
    assert "base: fixed   # the root link is called `world`; to let it walk on its 4 legs" in text
    assert "stand" not in text


def test_a_hexapod_walks_whatever_its_links_are_called(tmp_path: Path):
    limbs = _walker(last="revolute", down=0.0, names=("link_1", "link_2"), limbs=6)
    text = proposed(limbs.replace('"bot"', '"my_hexapod"'), tmp_path).text
    assert "base: floating   # link_2_0, link_2_1" in text


@pytest.mark.parametrize(("end", "base"), [("toe", "floating"), ("tip", "fixed")])
def test_what_ends_in_feet_by_their_names_walks(end: str, base: str, tmp_path: Path):
    """Spirit 40: its upper and lower links lie level at 0, and carry toes on fixed joints."""
    limbs = _walker(last="revolute", down=0.0, names=("upper", "lower"))
    for i in range(4):
        foot = link(f"{end}_{i}") + joint(
            f"{end}_joint_{i}", f"lower_{i}", f"{end}_{i}", "fixed", "", xyz="0 0.2 0"
        )
        limbs = limbs.replace("</robot>", f"{foot}</robot>")
    assert proposed(limbs, tmp_path).recipe.base == base


def test_a_floating_joint_below_an_empty_root_is_a_floating_base(tmp_path: Path):
    free = joint("f", "world", "base", "floating", "")
    arm = link("world", ""), link("base"), link("arm"), free, joint("j", "base", "arm")
    recipe = proposed(robot(*arm), tmp_path).recipe
    assert recipe.base == "floating"
    assert "mjcf" in recipe.targets
