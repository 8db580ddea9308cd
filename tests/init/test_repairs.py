"""Edits that `init` writes: what they heal, and that the robot then builds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from proposals import proposed
from tiny import flat_obj
from urdfs import LIMIT, box, inertial, joint, link, mesh, robot, shape, tensor

from assetbuild.init.look import judge, look, turned
from assetbuild.init.repairs import mended, repairs
from assetbuild.init.source import find_source
from assetbuild.init.trial import staged
from assetbuild.pipeline.recipes import load_recipe


def chain(*links: str, limits: str = LIMIT) -> str:
    """A base and one link after another, each 0.3 m beyond the last, on a hinge."""
    parts = [link("base", inertial(5.0))]
    for i, content in enumerate(links):
        parent, axis = f"link{i - 1}" if i else "base", f"{i % 2} {1 - i % 2} 0"
        hinge = joint(f"joint{i}", parent, f"link{i}", content=limits, xyz="0 0 0.3", axis=axis)
        parts += [link(f"link{i}", content), hinge]
    return robot(*parts, name="bot")


def edits_for(urdf: str, folder: Path) -> list[dict[str, dict[str, object]]]:
    edits = proposed(urdf, folder).recipe.edits
    return [edit.model_dump(by_alias=True, exclude_unset=True) for edit in edits]


ZEROS, DUMMY = tensor(0.0, 0.0, 0.0), tensor(1e-6, 1e-6, 1e-6)
FLAT = inertial(1.0, tensor(0.01, 0.01, 0.03))
SEEN, SOLID = shape("visual", box()), shape("collision", box())
TRIFLE = inertial(1e-9, tensor(2e-12, 2e-12, 2e-12))
"""1 microgram of the tensor that a cube of 0.1 m has with it."""
SPECK = '<box size="1e-6 1e-6 1e-6"/>'
WATER = {"ixx": 7.14e-07, "iyy": 7.14e-07, "izz": 7.14e-07}
"""10 g of water: a ball of 1.337 cm, 0.4 m r² = 7.145e-7 kg m²."""


def from_shapes(link: str, mass: float, **more: object) -> dict[str, dict[str, object]]:
    return {"inertia_from_geometry": {"link": link, "mass": mass, "open": "hull", **more}}


def limits(words: str) -> str:
    """One sound link on a hinge with these limits."""
    return chain(inertial(1.0), limits=f"<limit {words}/>")


# A robot | the edits that heal it.
HEALED = {
    "a sound one": (chain(inertial(1.0)), []),
    "tensors beyond the triangle": (
        chain(FLAT, inertial(1.0), FLAT), [{"balance_inertia": {"link": "link[02]"}}]),
    "tensors of zeros": (
        chain(inertial(1.5, ZEROS) + SEEN, inertial(1.5, ZEROS) + SOLID),
        [from_shapes("link0", 1.5), from_shapes("link1", 1.5, **{"from": "collision"})]),
    # A ball of 0.7 mm radius: a touch of it ends in NaN in PhysX.
    "a dummy that is positive": (
        chain(inertial(5.0, DUMMY) + SEEN), [from_shapes("link0", 5.0)]),
    "a dummy of no size": (
        chain(inertial(0.01, tensor(1e-12, 1e-12, 1e-12)) + shape("collision", SPECK)),
        [{"set_inertia": {"link": "link0", "inertia": WATER}}]),
    "a dense link": (chain(inertial(5.0, tensor(1e-3, 1e-3, 1e-3)) + SEEN), []),
    # 1 kg m2 on 2 kg in a box of 10 cm is 67 times m r².
    "a placeholder without a twin": (
        chain(inertial(1.0), inertial(2.0, tensor(1, 1, 1)) + SEEN), [from_shapes("link1", 2.0)]),
    # 3 kg m2, and beyond the triangle besides: to balance it leaves it 200 times m r².
    "a placeholder beyond the triangle": (
        chain(inertial(1.0), inertial(2.0, tensor(1, 1, 3)) + SEEN), [from_shapes("link1", 2.0)]),
    "no shape at all": (
        chain(""),
        [{"set_inertia": {"link": "link0", "guessed": True, "mass": 0.01, "inertia": WATER}}]),
    "a link between joints": (chain("", inertial(1.0)), [{"share_mass": {"link": "link0"}}]),
    # urdfdom locks a hinge without a range at 0; one that says 0 itself stays locked.
    "a hinge without a range": (
        limits('effort="9" velocity="3"'),
        [{"set_limits": {"joint": "joint0", "unlimited": True}}]),
    "a locked hinge": (limits('lower="0" upper="0" effort="9"'), []),
    "hinges whose limits are all zero": (
        limits('lower="0" upper="0" effort="0" velocity="0"'),
        [{"set_limits": {"joint": "joint0", "unlimited": True}}]),
    "crossed limits": (
        limits('lower="1" upper="-0.5" effort="9" velocity="5"'),
        [{"set_limits": {"joint": "joint0", "lower": -0.5, "upper": 1.0}}]),
}  # fmt: skip


@pytest.mark.parametrize("case", HEALED)
def test_what_is_broken_gets_the_edit_that_heals_it(case: str, tmp_path: Path):
    text, edits = HEALED[case]
    assert edits_for(text, tmp_path) == edits


def test_a_turned_mesh_is_tried_as_it_is_turned(tmp_path: Path):
    """For the inertia that is computed from it, and for the hull that the drives are tried with."""
    rod = trimesh.creation.box((0.1, 1.0, 0.1))
    rod.apply_translation((0.0, 0.5, 0.0))
    rod.export(tmp_path / "rod.glb")  # whose Y is up
    zeros = inertial(1.0, tensor(0.0, 0.0, 0.0), xyz="0 0 0.5")
    (tmp_path / "bot.urdf").write_text(chain(zeros + shape("visual", mesh("rod.glb"))))
    read = judge(look(find_source(tmp_path / "bot.urdf", {})), "fixed")
    turn = turned(read)
    assert turn == {"rod.glb"}
    whole = mended(replace(read, turned=turn), repairs(read))
    rod_inertia = whole.links.by_body["link0"].inertial
    assert rod_inertia is not None
    assert rod_inertia.com_m == pytest.approx((0.0, 0.0, 0.5))
    with staged(whole, ["link0"]) as stage:
        (hull,) = (stage.ports.folder / "meshes").glob("*.obj")
        assert trimesh.load(hull).bounds[1] == pytest.approx((0.05, 0.05, 1.0))


MIMIC = "<mimic joint='joint0' multiplier='{}' offset='{}'/>"


def led(multiplier: float, offset: float, lower: float = -1.0, upper: float = 1.0) -> str:
    """A leader of -1 to 1 rad, and a follower with a range of its own."""
    limit = f"<limit lower='{lower}' upper='{upper}' effort='9' velocity='5'/>"
    head, _, tail = chain(inertial(1.0), inertial(1.0)).rpartition(LIMIT)
    return head + limit + MIMIC.format(multiplier, offset) + tail


@pytest.mark.parametrize(
    ("follower", "lower", "upper"),
    [
        (led(-2.0, 0.5), -0.25, 0.75),  # 0.5 - 2 q in -1 .. 1
        (led(1.0, 0.0, -0.5, 3.0), -0.5, 1.0),
        (led(-1.0, 0.0, -0.2, 0.6), -0.6, 0.2),
    ],
)
def test_a_leader_is_narrowed_and_no_stop_is_passed(
    follower: str, lower: float, upper: float, tmp_path: Path
):
    (edit,) = edits_for(follower, tmp_path)
    limits = edit["set_limits"]
    assert limits["joint"] == "joint0"
    assert (limits["lower"], limits["upper"]) == pytest.approx((lower, upper))


def test_a_follower_without_a_range_gets_the_one_that_it_is_led_to(tmp_path: Path):
    (edit,) = edits_for(led(-2.0, 0.5, 0.0, 0.0), tmp_path)
    assert edit == {"set_limits": {"joint": "joint1", "lower": -1.5, "upper": 2.5}}


def test_two_ranges_that_share_no_position_are_left_and_said_to_be(tmp_path: Path):
    assert edits_for(led(1.0, 0.0, 2.0, 3.0), tmp_path) == []
    text = (tmp_path / "recipe.yaml").read_text()
    assert "# NOT READY: joint joint1: mimics `joint0`" in text


# --- twins ------------------------------------------------------------------------------------

HIP = tensor(0.0004, 0.0005, 0.00045)
"""kg m2, of 0.6 kg in a box of 10 cm."""


def hips(right: str) -> str:
    """Two hips at mirrored places."""
    parts = [link("base", inertial(5.0))]
    for side, y, own in (("left", 0.1, HIP), ("right", -0.1, right)):
        name = f"{side}_hip"
        content = inertial(0.6, own) + shape("collision", box())
        hinge = joint(f"{name}_joint", "base", name, xyz=f"0.2 {y} 0", axis="1 0 0")
        parts += [link(name, content), hinge]
    return robot(*parts, name="bot")


@pytest.mark.parametrize(
    ("right", "is_wrong"),
    [
        (tensor(0.0004, 0.0005, 0.09), True),  # 200 times, and beyond A + B
        (tensor(0.08, 0.1, 0.09), True),  # valid, but beyond m r²
        (ZEROS, True),
        (tensor(0.0009, 0.001, 0.0009), False),  # twins within a factor of three
    ],
)
def test_a_tensor_that_the_shapes_rule_out_is_computed_from_them(
    right: str, is_wrong: bool, tmp_path: Path
):
    made = {"link": "right_hip", "mass": 0.6, "from": "collision", "open": "hull"}
    assert edits_for(hips(right), tmp_path) == [{"inertia_from_geometry": made}] * is_wrong


def test_a_tensor_that_a_larger_one_hid_is_computed_too(tmp_path: Path):
    """0.03 kg m2 of 0.3 kg in a box of 10 cm count for nothing below 100 kg m2."""
    wrong, absurd = (inertial(0.3, tensor(v, v, v)) + SOLID for v in (0.03, 100.0))
    (edit,) = edits_for(chain(wrong, absurd), tmp_path)
    assert edit["inertia_from_geometry"]["link"] == "link.*"


def test_a_frame_without_shapes_that_spoils_its_body_becomes_a_ball(tmp_path: Path):
    """1 g of water is a ball of 6.2 mm, and 2/5 m r² of it is 1.54e-8 kg m2."""
    parts = [
        link("base", inertial(5.0)),
        link("finger", inertial(0.6, HIP) + shape("collision", box())),
        link("tip", inertial(0.001, tensor(1, 1, 1))),
        joint("hinge", "base", "finger", axis="1 0 0"),
        joint("held", "finger", "tip", kind="fixed"),
    ]
    (edit,) = edits_for(robot(*parts, name="bot"), tmp_path)
    assert edit["set_inertia"]["link"] == "tip"
    radius = (3.0 * 0.001 / (4.0 * np.pi * 1000.0)) ** (1.0 / 3.0)
    assert edit["set_inertia"]["inertia"]["ixx"] == pytest.approx(0.4e-3 * radius**2, rel=2e-3)


@pytest.mark.parametrize("stated", ["", inertial(1e-9, tensor(1e-9, 1e-9, 1e-9)), TRIFLE])
def test_a_missing_mass_is_a_guess_that_says_so(stated: str, tmp_path: Path):
    (edit,) = edits_for(chain(shape("visual", box()) + stated), tmp_path)
    guess = {"link": "link0", "guessed": True, "density": 1000, "open": "hull"}
    assert edit == {"inertia_from_geometry": guess}
    assert "a guess, as the source states no real mass" in (tmp_path / "recipe.yaml").read_text()


def test_a_body_without_mass_gets_it_from_all_links_that_have_a_volume(tmp_path: Path):
    """Hull and tower weigh 1 kg each, as water would; the bare frame before them weighs nothing."""
    parts = [link("base", inertial(5.0)), link("frame", ""), link("hull", SEEN)]
    parts += [link("tower", SOLID), joint("hinge", "base", "frame", axis="1 0 0")]
    parts += [joint("a", "frame", "hull", "fixed", ""), joint("b", "hull", "tower", "fixed", "")]
    edits = edits_for(robot(*parts, name="bot"), tmp_path)
    assert [edit["inertia_from_geometry"]["link"] for edit in edits] == ["hull", "tower"]
    assert "# bot: 7 kg, 2 bodies" in (tmp_path / "recipe.yaml").read_text()


def test_a_guessed_mass_reads_the_buffers_of_a_gltf(tmp_path: Path):
    """Water in a box of 0.1 x 0.2 x 0.3 m weighs 6 kg, the base 5 kg."""
    for name, data in trimesh.creation.box((0.1, 0.2, 0.3)).export(file_type="gltf").items():
        (tmp_path / name).write_bytes(data)
    proposed(chain(shape("visual", mesh("model.gltf"))), tmp_path)
    assert "# bot: 11 kg, 2 bodies" in (tmp_path / "recipe.yaml").read_text()


def test_a_flat_picture_has_no_volume_to_weigh(tmp_path: Path):
    """The build would refuse `open: hull` of it: the collision shape is taken, or a ball."""
    (tmp_path / "sheet.obj").write_bytes(flat_obj())
    drawn = shape("visual", mesh("sheet.obj"))
    (edit,) = edits_for(chain(drawn + SOLID), tmp_path)
    told = {"link": "link0", "guessed": True, "density": 1000, "from": "collision", "open": "hull"}
    assert edit == {"inertia_from_geometry": told}
    (edit,) = edits_for(chain(drawn), tmp_path)
    assert edit["set_inertia"]["mass"] == 0.01


def test_a_base_on_slides_whose_weight_comes_by_a_fixed_joint_shares_that(tmp_path: Path):
    """The edit comes before merging, and takes the mass of what will be merged."""
    cart = chain("", "").replace(
        "</robot>",
        f"<link name='arm'>{inertial(2.0)}</link><joint name='bolt' type='fixed'>"
        "<parent link='link1'/><child link='arm'/></joint></robot>",
    )
    (edit,) = edits_for(cart.replace('"revolute"', '"prismatic"'), tmp_path)
    assert "share_mass" in str(edit)
    assert load_recipe(tmp_path / "recipe.yaml").recipe.targets == ("urdf", "mjcf", "usd")


@pytest.mark.parametrize(
    ("stated", "unknown"), [((), True), (("arm",), False), (("base", "arm", "hand"), False)]
)
def test_a_robot_of_which_no_mass_is_known_is_said_to_be_not_ready(
    stated: tuple[str, ...], unknown: bool, tmp_path: Path
):
    names, solid = ("base", "arm", "hand"), shape("collision", box())
    links = [link(name, inertial() if name in stated else "", solid) for name in names]
    joints = [joint("to_arm", "base", "arm"), joint("to_hand", "arm", "hand", xyz="0.3 0 0")]
    found = proposed(robot(*links, *joints), tmp_path).proposal.unmended
    assert any("masses" in sentence for sentence in found) is unknown


def test_a_body_without_a_joint_is_repaired_as_it_is_built(tmp_path: Path):
    """10 g within 43 mm have no 0.001 kg m2; merged with its arm the hand would be plausible."""
    text = """<mujoco model="arm"><worldbody><body name="base"><geom size=".1"/><body name="arm">
    <joint axis="1 0 0"/><geom type="box" size=".2 .02 .02" mass=".1"/>
    <body name="hand" pos=".2 0 0"><inertial pos="0 0 0" mass=".01" diaginertia=".001 .001 .001"/>
    <geom type="box" size=".025 .025 .025"/></body></body></body></worldbody></mujoco>"""
    (edit,) = proposed(text, tmp_path).recipe.edits
    assert edit.model_dump()["inertia_from_geometry"]["link"] == "hand"
