"""The reader of facts of a URDF finds every planted fault, and none in what we write."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from gripper import gripper, picture
from hypothesis import HealthCheck, given, settings
from PIL import Image
from random_robots import examples
from random_robots import robots as random_robots
from robot_files import check_inputs, run_step, write_robot_ports
from tiny import TinyRobot, pendulum, tiny_quadruped

from assetbuild.errors import UsageError
from assetbuild.facts.compare import FLOAT32, Precision, differences
from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.surface import pixel_digest
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.shapes import Capsule, Shape
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.urdf import Urdf


def written(robot: TinyRobot, folder: Path) -> Path:
    """The ports of a robot, with its URDF below `urdf/`."""
    ports = write_robot_ports(folder, robot)
    (ports / "control.json").unlink()
    run_step(MeasureAssets(), ports, ports)
    run_step(Urdf(robot="bot"), ports, ports)
    return ports


def proved(ports: Path) -> list[Finding]:
    """What the reader says of it."""
    found = run_step(UrdfFacts(robot="bot"), ports, ports.parent / "out")
    return [finding for finding in found if finding.rule != "lost.urdf"]


def edited(robot: TinyRobot, folder: Path, *edits: tuple[str, str], file: str = "bot.urdf") -> Path:
    """The same with the first of each text replaced in one file."""
    ports = written(robot, folder)
    path = ports / "urdf" / file
    text = path.read_text()
    for old, new in edits:
        assert old in text, text
        text = text.replace(old, new, 1)
    path.write_text(text)
    return ports


# --- what we write ------------------------------------------------------------------------------


def test_what_we_write_is_the_robot(tmp_path: Path):
    """Meshes, a texture, a ball without length; other joints are in the contracts of readers."""
    robot = gripper()
    ball = Shape("ball", "b", "visual", Capsule(0.1, 0.0), material="red")
    shapes = replace(robot.shapes, shapes=(*robot.shapes.shapes, ball))
    assert proved(written(replace(robot, shapes=shapes), tmp_path / "in")) == []
    assert '"facts": 0' not in (tmp_path / "out/figures.json").read_text()


def test_damping_that_locks_a_joint_is_no_unlimited_one(tmp_path: Path):
    """MJCFs lock slides under a robot by a damping of 1e11; 1e9 is no limit of effort alone."""
    robot = pendulum()
    drive = replace(robot.control.actuators[0], damping=1e11)
    robot = replace(robot, control=replace(robot.control, actuators=(drive,)))
    assert proved(written(robot, tmp_path / "in")) == []


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(robot=random_robots())
def test_any_robot_reads_back(robot: TinyRobot, tmp_path_factory: pytest.TempPathFactory):
    tree = replace(robot.links, frames=())
    folder = tmp_path_factory.mktemp("any")
    assert proved(written(replace(robot, links=tree, tree=tree), folder / "in")) == []


def test_a_picture_that_nothing_can_read_is_the_same_picture(tmp_path: Path):
    robot = gripper()
    robot = replace(robot, meshes={**robot.meshes, "wood.png": b"no picture"})
    ports = written(robot, tmp_path / "in")
    assert proved(ports) == []
    (ports / "urdf/meshes/wood.png").write_bytes(picture())
    assert "equal.urdf.texture" in {f.rule for f in proved(ports)}


@pytest.mark.parametrize(
    ("quantity", "old", "new"),
    [("texture_corners", "vt 2 0", "vt 2.1 0"), ("mean_corner", "v 0 0 0", "v 0 0 0.0001")],
)
def test_one_other_number_of_a_mesh_is_found(quantity: str, old: str, new: str, tmp_path: Path):
    findings = proved(edited(gripper(), tmp_path / "in", (old, new), file="meshes/tile.obj"))
    named = {(f.rule, s) for f in findings for s in (f.subject, *f.data.get("subjects", ()))}
    assert (f"equal.urdf.{quantity}", "shape skin") in named


# --- planted faults -----------------------------------------------------------------------------

QUADRUPED_FAULTS = {
    "mass": ("body trunk", "mass", '<mass value="6.0"', '<mass value="6.06"'),
    "centre of mass": ("body FR_hip", "centre_of_mass", 'xyz="0.0 -0.005 0.0"', 'xyz="0 0 0"'),
    "inertia swapped": ("body trunk", "inertia", 'ixx="0.025', 'ixx="0.085'),
    "place": ("body FR_hip", "pose", 'xyz="0.18 -0.05 0.0"', 'xyz="0.182 -0.05 0.0"'),
    "axis": ("joint FR_hip_joint", "axis", '<axis xyz="1.0', '<axis xyz="-1.0'),
    "effort": ("joint FR_hip_joint", "effort", 'effort="24.0"', 'effort="2.0"'),
    "link": ("body imv", "mass", 'link name="imu"', 'link name="imv"'),
    "radius": ("shape FR_thigh_collision", "size", 'radius="0.015"', 'radius="0.016"'),
    "end of a capsule": ("shape FR_thigh_collision_top", "missing", "collision_top", "collision"),
    "material": ("shape trunk_visual", "material", '<material name="grey" />', ""),
    "mesh moved": ("shape trunk_visual", "mean_corner", "<geometry>",
                   '<origin xyz="0 0 0.03"/><geometry>'),
    "mesh lost": ("shape trunk_visual", "missing_mesh", "trunk_box.obj", "lost.obj"),
}  # fmt: skip


@pytest.mark.parametrize("fault", QUADRUPED_FAULTS)
def test_a_fault_is_named_with_subject_and_quantity(fault: str, tmp_path: Path):
    subject, quantity, old, new = QUADRUPED_FAULTS[fault]
    findings = proved(edited(tiny_quadruped(), tmp_path / "in", (old, new)))
    assert (f"equal.urdf.{quantity}", subject) in {(f.rule, f.subject) for f in findings}
    assert {f.severity for f in findings} == {"error"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</robot>", "", "not readable as XML"),
        ("<robot", "<!DOCTYPE robot><robot", "a DOCTYPE is not allowed"),
    ],
)
def test_a_file_that_is_no_urdf_is_one_error(old: str, new: str, message: str, tmp_path: Path):
    (found,) = proved(edited(tiny_quadruped(), tmp_path / "in", (old, new)))
    assert found.rule == "equal.unreadable"
    assert message in found.message
    with pytest.raises(UsageError, match="cannot read"):
        UrdfFacts(robot="x").read(tmp_path / "no.urdf")


def test_the_same_pixels_are_the_same_picture(tmp_path: Path):
    red = Image.new("RGB", (3, 2), (200, 10, 10))
    stored = {
        "plain.png": red, "opaque.png": red.convert("RGBA"), "palette.png": red.quantize(4),
        "other.bmp": red,
    }  # fmt: skip
    for name, stored_as in stored.items():
        stored_as.save(tmp_path / name)
    assert len({pixel_digest(tmp_path / name) for name in stored}) == 1


# --- copies of the robot's own files -------------------------------------------------------------


def test_a_copy_says_what_a_full_reading_says(tmp_path: Path) -> None:
    inputs = written(gripper(), tmp_path / "in")
    reference = Reference.of_ports(inputs, {})
    unknown = replace(reference, assets=replace(reference.assets, files=()))
    reader, file = UrdfFacts(robot="bot"), inputs / "urdf/bot.urdf"
    known, read = (reader.found(file, one) for one in (reference, unknown))
    assert reference.assets.files
    assert differences(read, known, Precision(FLOAT32)) == []
    stated = json.loads(reference.to_json())["assets"]
    assert stated["files"] == [], "a bundle states no bytes, so its files are read"


def test_mujoco_reads_every_file_of_the_full_model(tmp_path: Path) -> None:
    """What it makes of a file is compared with what the build measured, whatever its bytes are."""
    inputs = check_inputs(tmp_path, gripper(), Mjcf(robot="robot"), "mjcf")
    file = inputs / "assets.json"
    assets = decode(Assets, file.read_bytes())
    doubled = tuple((name, replace(own, area=2.0 * own.area)) for name, own in assets.surfaces)
    file.write_bytes(encode(replace(assets, surfaces=doubled, pixels=(("wood.png", "0" * 16),))))
    found = {f.rule for f in run_step(MjcfFacts(robot="robot"), inputs, tmp_path / "out")}
    assert {"equal.mjcf.area", "equal.mjcf.texture"} <= found
