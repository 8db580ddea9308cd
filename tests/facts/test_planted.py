"""One thing changed in a text that we write: its reader names subject, quantity and both values."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from gripper import gripper, picture
from hypothesis import given, settings
from PIL import Image
from random_robots import examples, robots
from robot_files import about, check_inputs, checked, ranked, rules, run_step
from tiny import TinyRobot, pendulum, tiny_quadruped, with_drives, with_mimic

from assetbuild.errors import UsageError
from assetbuild.facts.compare import FLOAT32, Precision, differences
from assetbuild.facts.reader import Reader
from assetbuild.facts.readers._mjcf import BareFacts, MjcfFacts, MjxFacts
from assetbuild.facts.readers._usd import UsdReader
from assetbuild.facts.readers.scene import SceneFacts
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.readers.xrdf import Xrdf as XrdfFacts
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import pixel_digest
from assetbuild.facts.table import pair_name, pair_of
from assetbuild.findings import Finding
from assetbuild.plugin_types import Target
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Body, Inertial, Joint, Limits
from assetbuild.robot.shapes import Capsule, Shape
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.mjlab import Mjlab
from assetbuild.targets.mjx import Mjx
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.usd import Usd
from assetbuild.targets.xrdf import Xrdf
from assetbuild.targets.xrdf.covers import XrdfOptions

SPHERES = XrdfOptions(
    acceleration={"FR_.*": 7.0, ".*": 9.0}, jerk=100, tool_frames=("FR_foot", "imu"), max_spheres=2
)


def xrdf_facts(options: XrdfOptions) -> XrdfFacts:
    return XrdfFacts(robot="robot", options={"xrdf": options.model_dump(mode="json")})


FORMS: dict[str, tuple[Reader, Target, str]] = {
    "mjcf": (MjcfFacts(robot="robot"), Mjcf(robot="robot"), "mjcf/robot.xml"),
    "mjx": (MjxFacts(robot="robot"), Mjx(robot="robot"), "mjx/robot_mjx.xml"),
    "bare": (BareFacts(robot="robot"), Mjlab(robot="robot"), "mjlab/mjcf/robot_bare.xml"),
    "scene": (SceneFacts(robot="robot"), Mjcf(robot="robot"), "mjcf/scene.xml"),
    "urdf": (UrdfFacts(robot="robot"), Urdf(robot="robot"), "urdf/robot.urdf"),
    "usd": (UsdReader(robot="robot"), Usd(robot="robot"), "usd/robot.usda"),
    "xrdf": (xrdf_facts(SPHERES), Xrdf(robot="robot", options=SPHERES), "xrdf/robot.xrdf"),
}
"""Reader, target and main file of each form."""


def written(robot: TinyRobot, folder: Path, form: str) -> Path:
    _, target, file = FORMS[form]
    inputs = check_inputs(folder, robot, target, file.partition("/")[0])
    if form == "urdf":  # a build gives its reader the ratings alone
        (inputs / "control.json").unlink()
    return inputs


def proved(form: str, inputs: Path) -> list[Finding]:
    """What the reader says of it, but for what a URDF goes without."""
    found = run_step(FORMS[form][0], inputs, inputs.parent / "out")
    return [finding for finding in found if finding.rule != "lost.urdf"]


def respell(path: Path, pattern: str, new: str) -> None:
    """Replaces the first match of a pattern."""
    changed, count = re.subn(pattern, new, path.read_text(), count=1)
    assert count == 1, f"{pattern} is not in the file"
    path.write_text(changed)


def check(
    robot: TinyRobot, folder: Path, form: str, pattern: str = "", new: str = ""
) -> list[Finding]:
    """What is said of a robot, in whose main file one thing may have been changed."""
    inputs = written(robot, folder, form)
    respell(inputs / FORMS[form][2], pattern, new)
    return proved(form, inputs)


# --- what we write ------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["mjcf", "urdf", "usd"])
@settings(max_examples=examples(40), deadline=None)
@given(robot=robots())
def test_every_random_tree_is_equal(form: str, robot: TinyRobot) -> None:
    if form == "urdf":  # a frame is a link there
        tree = replace(robot.tree, frames=())
        robot = replace(robot, tree=tree, links=tree)
    with TemporaryDirectory() as folder:
        assert check(robot, Path(folder), form) == []


def test_a_scale_of_1_may_be_stated(tmp_path: Path):
    assert check(tiny_quadruped(), tmp_path, "urdf", "<mesh ", '<mesh scale="1 1.0 1" ') == []


@pytest.mark.parametrize("joints", [".*", "FR_.*"])
def test_a_joint_that_follows_or_that_the_recipe_leaves_out_is_not_planned(
    joints: str, tmp_path: Path
):
    options, robot = SPHERES.model_copy(update={"joints": joints}), tiny_quadruped()
    tree, links = (
        with_mimic(replace(robot, tree=one), "FR_thigh_joint", "FR_calf_joint", -2.0, 0.1).tree
        for one in (robot.tree, robot.links)
    )
    target = Xrdf(robot="robot", options=options)
    inputs = check_inputs(tmp_path, replace(robot, tree=tree, links=links), target, "xrdf")
    findings, figures = checked(xrdf_facts(options), inputs, tmp_path / "out")
    assert findings == []
    assert figures["facts"] > 0


def test_a_body_that_resists_turning_though_it_has_no_mass_is_compared(tmp_path: Path):
    """`mass="0" diaginertia="1e-4 1e-4 1e-4"`: MuJoCo takes the tensor, so it counts."""
    robot = pendulum()
    leg = Body("leg", Inertial(0.0, (0.0, 0.0, -0.05), (1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0)))
    joint = Joint("held", "fixed", robot.tree.root, "leg")
    tree = replace(robot.tree, bodies=(*robot.tree.bodies, leg), joints=(*robot.tree.joints, joint))
    robot = replace(robot, tree=tree, links=tree)
    assert check(robot, tmp_path / "same", "mjcf") == []
    (found,) = check(robot, tmp_path / "turned", "mjcf", r'"0.0001 0.0001 0.0001"', '"1 1 1"')
    assert (found.rule, found.subject) == ("equal.mjcf.inertia", "body leg")


def test_a_ball_is_a_capsule_without_length(tmp_path: Path):
    robot = gripper()
    ball = Shape("ball", "b", "visual", Capsule(0.1, 0.0), material="red")
    shapes = replace(robot.shapes, shapes=(*robot.shapes.shapes, ball))
    assert check(replace(robot, shapes=shapes), tmp_path, "urdf") == []
    assert '"facts": 0' not in (tmp_path / "out/figures.json").read_text()


def test_damping_that_locks_a_joint_is_no_unlimited_one(tmp_path: Path):
    """MJCFs lock slides under a robot by a damping of 1e11; 1e9 is no limit of effort alone."""
    assert check(with_drives(pendulum(), damping=1e11), tmp_path, "urdf") == []


def test_a_locked_joint_is_held_where_its_limits_meet(tmp_path: Path) -> None:
    robot = pendulum()
    joint = replace(robot.tree.joints[0], limits=Limits(0.0, 0.0, 5.0, 1.0))
    locked = replace(robot, tree=replace(robot.tree, joints=(joint,)))
    assert check(locked, tmp_path / "a", "mjcf") == []
    found = check(locked, tmp_path / "b", "mjcf", 'polycoef="0 0', 'polycoef="0.1 0')
    assert rules(found) == {"equal.mjcf.lower", "equal.mjcf.upper"}


def test_bodies_with_spaces_in_their_names_make_pairs_of_two(tmp_path: Path) -> None:
    """One body is called `world`, which MuJoCo keeps for itself: then names are exchanged."""
    robot, names = tiny_quadruped(), {"trunk": "world", "FR_hip": "hip FR", "FR_thigh": "FR"}

    def renamed(part):
        text = encode(part).decode()
        for old, new in names.items():
            text = text.replace(f'"{old}"', f'"{new}"')
        return decode(type(part), text.encode())

    tree, shapes, control = (renamed(part) for part in (robot.tree, robot.shapes, robot.control))
    renamed_robot = replace(robot, tree=tree, shapes=shapes, control=control)
    assert check(renamed_robot, tmp_path, "mjcf") == []


def test_a_pair_is_not_taken_for_another_whose_names_are_cut_elsewhere() -> None:
    pairs = [("a b", "c"), ("a", "b c"), ("a", "c"), ('"a', "b"), ("", "a\\ b")]
    assert len({pair_name(*pair) for pair in pairs}) == len(pairs)
    for one, other in pairs:
        names = pair_of(pair_name(one, other)), pair_of(pair_name(other, one))
        assert names == (tuple(sorted((one, other))),) * 2


# --- planted faults -----------------------------------------------------------------------------

HIP, CALF = "joint FR_hip_joint", "joint FR_calf_joint"
IN_A_QUADRUPED = [
    ("mjcf", "mass", "body FR_hip", r'mass="0.5"', 'mass="0.500000001"'),
    ("mjcf", "pose", "body FR_hip", r'pos="0.18 -0.05 0"', 'pos="0.18 -0.05000001 0"'),
    ("mjcf", "axis", HIP, r'axis="1 0 0"', 'axis="1 0.00001 0"'),
    ("mjcf", "upper", HIP, r'range="-0.86 0.86"', 'range="-0.86 0.87"'),
    ("mjcf", "effort_range", CALF, r'forcerange="-36 36"', 'forcerange="-35 36"'),
    ("mjcf", "kp", HIP, r'kp="100"', 'kp="90"'),
    ("mjcf", "missing", "frame imu", r'<site name="imu"[^>]*/>', ""),
    ("mjcf", "role", "shape trunk_visual", r'class="visual" mesh',
     'class="collision" type="mesh" mesh'),
    ("mjcf", "friction", "shape trunk_collision", r'friction="0.8 ', 'friction="0.7 '),
    ("mjcf", "target", "keyframe home/RL_calf_joint", r' 0 0.8 -1.6"/>', ' 0 0.8 -1.7"/>'),
    ("mjcf", "timestep", "simulation", r'timestep="0.005"', 'timestep="0.004"'),
    ("mjcf", "filtered", "pair RL_thigh trunk", r"</mujoco>",
     '<contact><exclude body1="RL_thigh" body2="trunk"/></contact></mujoco>'),
    # What MJCF alone says, of which the vocabulary does not know.
    ("mjcf", "solmix", "shape trunk_collision", r'<geom name="trunk_collision"',
     r'\g<0> solmix="3"'),
    ("mjcf", "extra", "loop equality 0", r"</mujoco>",
     '<equality><weld body1="FR_hip" body2="FL_hip"/></equality></mujoco>'),
    ("urdf", "mass", "body trunk", '<mass value="6.0"', '<mass value="6.06"'),
    ("urdf", "centre_of_mass", "body FR_hip", 'xyz="0.0 -0.005 0.0"', 'xyz="0 0 0"'),
    ("urdf", "inertia", "body trunk", 'ixx="0.025', 'ixx="0.085'),
    ("urdf", "pose", "body FR_hip", 'xyz="0.18 -0.05 0.0"', 'xyz="0.182 -0.05 0.0"'),
    ("urdf", "axis", HIP, '<axis xyz="1.0', '<axis xyz="-1.0'),
    ("urdf", "effort", HIP, 'effort="24.0"', 'effort="2.0"'),
    ("urdf", "mass", "body imv", 'link name="imu"', 'link name="imv"'),
    ("urdf", "size", "shape FR_thigh_collision", 'radius="0.015"', 'radius="0.016"'),
    ("urdf", "missing", "shape FR_thigh_collision_top", "collision_top", "collision"),
    ("urdf", "material", "shape trunk_visual", '<material name="grey" />', ""),
    ("urdf", "mean_corner", "shape trunk_visual", "<geometry>",
     '<origin xyz="0 0 0.03"/><geometry>'),
    ("urdf", "missing_mesh", "shape trunk_visual", "trunk_box.obj", "lost.obj"),
    ("urdf", "scale", "shape trunk_visual", "<mesh ", '<mesh scale="1 2 1" '),
    ("xrdf", "place", HIP, r"\[FR_hip_joint, FR_thigh_joint", "[FR_thigh_joint, FR_hip_joint"),
    ("xrdf", "acceleration", HIP, r"limits: \[7.0", "limits: [7.1"),
    ("xrdf", "jerk", HIP, r"limits: \[100.0", "limits: [101.0"),
    ("xrdf", "default", "joint FR_thigh_joint", "FR_thigh_joint: 0.8", "FR_thigh_joint: 0.9"),
    ("xrdf", "ignored", "pair FR_calf FR_thigh", r"(FR_thigh: \[)FR_calf(, )?", r"\1"),
]  # fmt: skip
IN_A_GRIPPER = [
    ("mjcf", "mean_corner", "shape skin", r'pos="0.01 0.02 0.03"', 'pos="0.04 0.02 0.03"'),
    ("mjcf", "mimic_multiplier", "joint b_joint", r'polycoef="0.25 -1.5', 'polycoef="0.25 1.5'),
    ("mjcf", "between", "equality b_joint_copy", r'(<joint name="b_joint)("[^>]* polycoef[^>]*/>)',
     r"\1\2\1_copy\2"),
    ("scene", "type", "shape floor_copy", r'(<geom name="floor)("[^>]*/>)', r"\1\2\1_copy\2"),
    ("mjx", "iterations", "simulation", r' iterations="20"', ' iterations="40"'),
    ("bare", "mass", "body base", r' mass="1"', ' mass="3"'),
    ("scene", "friction", "floor", r' friction="[^"]*"', ' friction="3 0 0"'),
    ("scene", "centre", "view", r'center="[^"]*"', 'center="0 0 9"'),
    ("scene", "extent", "view", r' extent="[^"]*"', ' extent="9"'),
    ("scene", "lights", "view", r"<light [^>]*/>", ""),
    ("scene", "timestep", "simulation", r"<statistic", '<option timestep="0.1"/><statistic'),
]  # fmt: skip


@pytest.mark.parametrize(
    ("robot", "form", "rule", "subject", "pattern", "new"),
    [(tiny_quadruped(), *row) for row in IN_A_QUADRUPED]
    + [(gripper(), *row) for row in IN_A_GRIPPER],
)
def test_a_planted_change_is_found(
    tmp_path: Path, robot: TinyRobot, form: str, rule: str, subject: str, pattern: str, new: str
) -> None:
    found = check(robot, tmp_path, form, pattern, new)
    assert (f"equal.{form}.{rule}", subject) in about(found)
    assert {f.severity for f in found} == {"error"}
    if (rule, form) == ("mass", "bare"):
        (mass,) = found
        assert (mass.data["expected"], mass.data["found"]) == (1.0, 3.0)
        assert "3 kg in the" in mass.message and ", 1 kg in the robot" in mass.message


TURNED, EXCHANGED = r"(?m)^(f) (\S+) (\S+)", r"(?m)^(v) (\S+) (\S+)"


@pytest.mark.parametrize(
    ("form", "mesh", "pattern", "new", "quantity"),
    [
        ("urdf", "tile", "vt 2 0", "vt 2.1 0", "texture_corners"),
        ("urdf", "tile", "v 0 0 0", "v 0 0 0.0001", "mean_corner"),
        ("mjcf", "block", TURNED, r"\1 \3 \2", "volume"),
        ("bare", "block", TURNED, r"\1 \3 \2", "volume"),
        ("mjcf", "block", EXCHANGED, r"\1 \3 \2", "mean_corner"),
        ("bare", "block", EXCHANGED, r"\1 \3 \2", "mean_corner"),
    ],
)
def test_one_line_of_a_mesh_is_found(
    form: str, mesh: str, pattern: str, new: str, quantity: str, tmp_path: Path
) -> None:
    """A face that is turned over; a corner of which two numbers are exchanged."""
    inputs = written(gripper(), tmp_path, form)
    respell(next((inputs / FORMS[form][2]).parent.rglob(f"{mesh}*.obj")), pattern, new)
    assert f"equal.{form}.{quantity}" in rules(proved(form, inputs))


@pytest.mark.parametrize(
    ("form", "old", "new", "message"),
    [
        ("mjcf", "<option ", "<option wings='2' ", "wings"),
        ("urdf", "</robot>", "", "not readable as XML"),
        ("urdf", "<robot", "<!DOCTYPE robot><robot", "a DOCTYPE is not allowed"),
        ("xrdf", r"(?s).*", "[", "not readable as YAML"),
        ("xrdf", r"(?s).*", "", "the XRDF"),
    ],
)
def test_a_file_that_its_format_refuses_is_one_error(
    form: str, old: str, new: str, message: str, tmp_path: Path
):
    (found,) = check(tiny_quadruped(), tmp_path, form, old, new)
    assert ranked([found]) == [("equal.unreadable", "error")]
    assert message in found.message
    with pytest.raises(UsageError, match="cannot read"):
        UrdfFacts(robot="x").read(tmp_path / "no.urdf")


# --- pictures, and copies of the robot's own files ------------------------------------------------


def test_a_picture_that_nothing_can_read_is_the_same_picture(tmp_path: Path):
    robot = replace(gripper(), meshes={**gripper().meshes, "wood.png": b"no picture"})
    inputs = written(robot, tmp_path, "urdf")
    assert proved("urdf", inputs) == []
    (inputs / "urdf/meshes/wood.png").write_bytes(picture())
    assert "equal.urdf.texture" in rules(proved("urdf", inputs))


def test_the_same_pixels_are_the_same_picture(tmp_path: Path):
    red = Image.new("RGB", (3, 2), (200, 10, 10))
    stored = {
        "plain.png": red, "opaque.png": red.convert("RGBA"), "palette.png": red.quantize(4),
        "other.bmp": red,
    }  # fmt: skip
    for name, stored_as in stored.items():
        stored_as.save(tmp_path / name)
    assert len({pixel_digest(tmp_path / name) for name in stored}) == 1


def test_a_copy_says_what_a_full_reading_says(tmp_path: Path) -> None:
    inputs = written(gripper(), tmp_path, "urdf")
    reference = Reference.of_ports(inputs, {})
    unknown = replace(reference, assets=replace(reference.assets, files=()))
    reader, file = UrdfFacts(robot="robot"), inputs / "urdf/robot.urdf"
    known, read = (reader.found(file, one) for one in (reference, unknown))
    assert reference.assets.files
    assert differences(read, known, Precision(FLOAT32)) == []
    stated = json.loads(reference.to_json())["assets"]
    assert stated["files"] == [], "a bundle states no bytes, so its files are read"


def test_mujoco_reads_every_file_of_the_full_model(tmp_path: Path) -> None:
    """What it makes of a file is compared with what the build measured, whatever its bytes are."""
    inputs = written(gripper(), tmp_path, "mjcf")
    file = inputs / "assets.json"
    assets = decode(Assets, file.read_bytes())
    doubled = tuple((name, replace(own, area=2.0 * own.area)) for name, own in assets.surfaces)
    file.write_bytes(encode(replace(assets, surfaces=doubled, pixels=(("wood.png", "0" * 16),))))
    assert {"equal.mjcf.area", "equal.mjcf.texture"} <= rules(proved("mjcf", inputs))
