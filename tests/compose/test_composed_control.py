"""What MJCFs say beyond links and shapes, under prefixes; masks of two sources in one robot."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest
from compose.test_compose_parts import put
from mjcfs import Reading, hard_arm, read
from robot_files import run_step
from tiny import pendulum, tiny_quadruped

from assetbuild.compose.compose_parts import ComposeParts
from assetbuild.compose.composed_control import KeyOf, MountedPart, PartControl
from assetbuild.compose.composed_masks import meeting_masks, touch
from assetbuild.errors import RecipeError
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.files import SourceControl
from assetbuild.robot.model import Contact, Control, MjcfOnly, Tree
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.sections import At

FLOOR = (1, 1)
HEAD = '<mujoco><compiler angle="radian"/><worldbody>'


def parsed(item: MjcfOnly) -> ElementTree.Element:
    return ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it


def part(reading: Reading, prefix: str = "p_", **more) -> PartControl:
    on = MountedPart(prefix=prefix, at=At(link="trunk"), **more)
    return PartControl(on, reading.links, reading.source)


def test_every_reference_of_a_hard_robot_follows_its_name(tmp_path: Path):
    """Names are taken off again by their prefix alone: nothing else has changed."""
    arm = hard_arm(tmp_path)
    known = {body.name for body in arm.links.bodies} | {j.name for j in arm.links.joints}
    known |= {shape.name for shape in arm.shapes.shapes} | {"world"}
    after = part(arm).prefixed().control
    kept = [i for i in arm.control.mjcf_only if i.place not in ("option", "root", "freejoint")]
    assert len(after.mjcf_only) == len(kept)
    for before, now in zip(kept, after.mjcf_only, strict=True):
        of_world = before.place == "body" and not before.owner
        assert now.owner == (
            f"p_{before.owner or arm.links.root}" if before.owner or of_world else ""
        )
        for old, new in zip(parsed(before).iter(), parsed(now).iter(), strict=True):
            assert old.attrib.keys() == new.attrib.keys()
            for key, value in old.attrib.items():
                if of_world and key in ("pos", "dir"):
                    continue  # it moved from the world to the root
                if new.attrib[key] != value:
                    assert new.attrib[key] == f"p_{value}", (key, value)
                else:  # what is the same names nothing of the robot, but for the world
                    assert value not in known or value == "world", (old.tag, key, value)


def test_commands_of_joints_that_the_recipe_moves_are_left_out(tmp_path: Path):
    text = HEAD + (
        '<body name="b"><joint name="j"/><geom size=".1"/><body name="c"><joint name="k"/>'
        '<geom size=".1"/></body></body></worldbody><actuator><position name="dj" joint="j"/>'
        '<position name="dk" joint="k"/></actuator>'
        '<keyframe><key name="up" qpos="1 2" ctrl="1 2"/></keyframe></mujoco>'
    )
    arm = read(text, tmp_path)
    made = part(arm, keys=(KeyOf("home", "up", ("j",)), KeyOf("lie", "up"))).prefixed()
    assert dict(made.ctrl) == {"home": (("p_dk", 2.0),), "lie": (("p_dj", 1.0), ("p_dk", 2.0))}
    assert made.control.keyframes == ()


@pytest.mark.parametrize("loop", ['<weld body1="b"/>', '<connect body1="b" anchor="0 0 0"/>'])
def test_a_floating_part_that_is_held_to_the_world_is_refused(tmp_path: Path, loop: str):
    text = HEAD + '<body name="a"><freejoint/><geom size=".1"/><body name="b"><joint name="j"/>'
    text += f'<geom size=".1"/></body></body></worldbody><equality>{loop}</equality></mujoco>'
    with pytest.raises(RecipeError, match="to the world") as caught:
        part(read(text, tmp_path)).prefixed()
    assert caught.value.hint


def test_options_that_are_not_taken_are_named(tmp_path: Path):
    text = (
        '<mujoco><option timestep="0.01" integrator="RK4" density="1.2"><flag contact="disable"/>'
    )
    text += '</option><worldbody><body name="b"><geom size=".1"/></body></worldbody></mujoco>'
    said = part(read(text, tmp_path))
    keys = {"option timestep", "option integrator", "option density", "option flag contact"}
    assert set(said.left_out(None)) == keys
    assert said.left_out(said.source_control) == ()
    assert said.pose_in_root == IDENTITY


def test_two_drives_of_one_name_are_refused(tmp_path: Path):
    """A prefix makes names that the base may have already."""
    put(tmp_path / "base", tiny_quadruped(), MjcfOnly("tendon", '<fixed name="arm_t"/>'))
    put(tmp_path / "arm_", pendulum(), MjcfOnly("tendon", '<fixed name="t"/>'))
    on = MountedPart(prefix="arm_", at=At(link="trunk"))
    with pytest.raises(RecipeError, match="two parts have a tendon `arm_t`"):
        run_step(ComposeParts(parts=(on,)), tmp_path, tmp_path / "out")


def test_the_surface_that_most_shapes_of_a_part_have_comes_along(tmp_path: Path):
    put(tmp_path / "base", tiny_quadruped())
    put(tmp_path / "arm_", pendulum())
    slippery = Contact(friction=(0.1, 0.0, 0.0))
    said = SourceControl(Control(contact=slippery, contacts=(("bob", slippery),)))
    (tmp_path / "arm_" / "source_control.json").write_bytes(encode(said))
    on = MountedPart(prefix="arm_", at=At(link="trunk"))
    run_step(ComposeParts(parts=(on,)), tmp_path, tmp_path / "out")
    whole = decode(SourceControl, (tmp_path / "out" / "source_control.json").read_bytes())
    assert whole.surfaces == (("arm_", slippery),)
    assert whole.control.contacts == (("arm_bob", slippery),)


def test_a_part_that_floats_alone_is_held_and_its_place_in_its_world_told(tmp_path: Path):
    text = HEAD + '<body name="b" pos="0 0 0.4"><freejoint name="free"/><geom size=".1"/>'
    text += '<body name="c"><joint name="j"/><geom size=".1"/></body></body></worldbody></mujoco>'
    duck = read(text, tmp_path / "read")
    assert duck.links.base == "floating"
    put(tmp_path / "base", pendulum())
    shutil.copytree(duck.read, tmp_path / "duck_")
    (tmp_path / "duck_" / "source_map.json").write_text('{"file": "y", "lines": {}}')
    on = MountedPart(prefix="duck_", at=At(link="base"))
    findings = run_step(ComposeParts(parts=(on,)), tmp_path, tmp_path / "out")
    whole = decode(Tree, (tmp_path / "out" / "links.json").read_bytes())
    assert whole.base == "fixed"
    assert {joint.kind for joint in whole.joints} <= {"revolute", "continuous", "fixed"}
    said = decode(SourceControl, (tmp_path / "out" / "source_control.json").read_bytes())
    assert not {"freejoint", "root", "option"} & {i.place for i in said.control.mjcf_only}
    (told,) = [f for f in findings if f.rule == "compose.part"]
    assert "alone it floats" in told.message
    assert "(0, 0, 0.4) m" in told.message


# --- masks ----------------------------------------------------------------------------------


def source(*masks: tuple[int, int]) -> SourceControl:
    contacts = [(f"s{n}", Contact(contype=m, conaffinity=p)) for n, (m, p) in enumerate(masks)]
    return SourceControl(Control(contact=contacts[0][1], contacts=tuple(contacts)))


def masks_of(said: SourceControl) -> list[tuple[int, int]]:
    return [(contact.contype, contact.conaffinity) for _, contact in said.control.contacts]


ODD = [
    ((1, 1), (3, 2)),
    ((0, 1), (1, 0), (2, 2)),
    ((2, 0), (0, 2), (1, 0)),
    ((0, 1),),
    ((1, 0), (4, 6)),
    ((2**30, 2**30), (1, 1)),
]


def test_masks_within_a_source_and_on_the_floor_are_as_before_and_all_others_meet():
    for sides in itertools.permutations(ODD, 3):
        masks_are_as_before_and_all_others_meet(sides)


def masks_are_as_before_and_all_others_meet(sides: tuple[tuple[tuple[int, int], ...], ...]) -> None:
    made, _ = meeting_masks([(f"{n}_", source(*masks)) for n, masks in enumerate(sides)])
    after = [masks_of(said) for said in made]
    for before, now in zip(sides, after, strict=True):
        for i, j in itertools.product(range(len(before)), repeat=2):
            assert touch(now[i], now[j]) == touch(before[i], before[j])
        assert [touch(m, FLOOR) for m in now] == [touch(m, FLOOR) for m in before]
    for (a, now_a), (b, now_b) in itertools.combinations(zip(sides, after, strict=True), 2):
        for i, j in itertools.product(range(len(a)), range(len(b))):
            meet = touch(a[i], FLOOR) and touch(b[j], FLOOR)
            assert touch(now_a[i], now_b[j]) == meet


def test_plain_masks_stay_as_they_are_and_nothing_is_said():
    sides = [("", source((1, 1))), ("arm_", source((1, 1), (1, 0)))]
    made, findings = meeting_masks(sides)
    assert ([said for _, said in sides], []) == (made, findings)


def test_a_geom_that_only_mjcf_has_follows():
    geom = MjcfOnly("body", '<geom name="egg" type="ellipsoid" contype="2" conaffinity="2" />', "b")
    egg = SourceControl(Control(mjcf_only=(geom,)))
    (_, after), findings = meeting_masks([("", source((3, 3))), ("arm_", egg)])
    said = parsed(after.control.mjcf_only[0])
    masks = int(said.get("contype", "")), int(said.get("conaffinity", ""))
    assert not touch(masks, (3, 3))
    assert touch(masks, masks)
    assert [f.rule for f in findings] == ["compose.masks"]


def test_sources_that_need_more_bits_than_there_are_are_refused():
    full = [(1 << bit, 1 << bit) for bit in range(31)]
    with pytest.raises(RecipeError, match="more than 31 bits"):
        meeting_masks([("", source(*full)), ("arm_", source((2, 2)))])


def test_names_of_drives_sensors_and_cameras_are_prefixed(tmp_path: Path):
    arm = hard_arm(tmp_path)
    after = part(arm).prefixed().control
    assert [a.joint for a in after.actuators] == [f"p_{a.joint}" for a in arm.control.actuators]
    for old, new in zip(arm.control.sensors, after.sensors, strict=True):
        assert (new.name, new.kind) == (f"p_{old.name}", old.kind)
        assert new.at.name == (f"p_{old.at.name}" if old.at.name else "")
    for old, new in zip(arm.control.cameras, after.cameras, strict=True):
        assert (new.name, new.link) == (f"p_{old.name}", f"p_{old.link or arm.links.root}")


def test_where_the_world_is_the_root_it_is_the_root_of_the_part(tmp_path: Path):
    text = HEAD + '<body name="b"><joint name="j"/><geom size=".1"/></body></worldbody>'
    text += '<equality><weld name="w" body1="b"/></equality></mujoco>'
    made = part(read(text, tmp_path)).prefixed()
    (weld,) = made.control.loops
    assert (weld.kind, weld.a.body, weld.b.body) == ("weld", "p_b", "p_world")
