"""The reader of facts of a URDF finds every planted fault, and none in what we write."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from PIL import Image
from tiny import (
    TinyRobot,
    box_obj,
    examples,
    pendulum,
    robots,
    run_step,
    tiny_quadruped,
    write_robot_ports,
)

from assetbuild.errors import UsageError
from assetbuild.facts.readers.urdf import UrdfFacts
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets
from assetbuild.robot.pose import Pose, normalised_quat
from assetbuild.robot.shapes import Capsule, Material, Mesh, Shape, Shapes
from assetbuild.targets.urdf import Urdf

TURNED = Pose((0.1, -0.2, 0.3), normalised_quat((0.5, 0.1, -0.7, 0.2)))


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


# --- robots -------------------------------------------------------------------------------------


def picture(colour: str) -> bytes:
    held = io.BytesIO()
    Image.new("RGB", (2, 2), colour).save(held, "PNG")
    return held.getvalue()


def textured() -> TinyRobot:
    """One mesh that is seen with two textures, a ball without length, a material nobody wears."""
    robot = tiny_quadruped()
    lines = box_obj((0.4, 0.2, 0.1)).decode().splitlines()
    corners = [line for line in lines if line.startswith("v")]
    faces = [
        " ".join(f"{n}/{n}/{n}" if n != "f" else n for n in line.split()) for line in lines[8:]
    ]
    uv = [f"vt {n / 8!r} {n / 16!r}" for n in range(8)]
    normals = [f"vn {n / 8!r} 0.6 -0.8" for n in range(8)]
    mesh = "\n".join([*corners, *uv, *normals, *faces, ""]).encode()
    shapes = Shapes(
        (
            Shape("a", "trunk", "visual", Mesh("trunk_box"), material="wood"),
            Shape("b", "imu", "visual", Mesh("trunk_box"), TURNED, "stone"),
            Shape("c", "trunk", "collision", Mesh("trunk_box"), TURNED),
            Shape("ball", "FR_foot", "visual", Capsule(0.1, 0.0), TURNED, "plain"),
            Shape("bare", "FR_hip", "visual", Capsule(0.1, 0.2), TURNED),
        ),
        (
            Material("wood", (1.0, 0.9, 0.8, 1.0), "wood.png"),
            Material("stone", (1.0, 1.0, 1.0, 0.5), "stone.png"),
            Material("plain", (0.1, 0.2, 0.3, 1.0)),
            Material("unworn", (0.3, 0.2, 0.1, 1.0), "wood.png"),
        ),
        robot.shapes.meshes,
    )
    pictures = {"wood.png": picture("brown"), "stone.png": picture("grey")}
    return replace(robot, shapes=shapes, meshes={"trunk_box.obj": mesh, **pictures})


# --- what we write ------------------------------------------------------------------------------


def test_what_we_write_is_the_robot(tmp_path: Path):
    """Robots of other joints and without meshes are in the contracts of all readers."""
    assert proved(written(textured(), tmp_path / "in")) == []
    assert '"facts": 0' not in (tmp_path / "out/figures.json").read_text()


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(robot=robots())
def test_any_robot_reads_back(robot: TinyRobot, tmp_path_factory: pytest.TempPathFactory):
    tree = replace(robot.links, frames=())
    folder = tmp_path_factory.mktemp("any")
    assert proved(written(replace(robot, links=tree, tree=tree), folder / "in")) == []


def test_a_source_s_effort_stays_where_the_drive_has_no_limit(tmp_path: Path):
    robot = pendulum()
    free = replace(robot.control.actuators[0], effort=None, velocity=None)
    robot = replace(robot, control=replace(robot.control, actuators=(free,)))
    ports = written(robot, tmp_path / "in")
    assert 'effort="5.0" velocity="10.0"' in (ports / "urdf/bot.urdf").read_text()
    assert proved(ports) == []


def test_a_picture_that_nothing_can_read_is_the_same_picture(tmp_path: Path):
    robot = textured()
    robot = replace(robot, meshes={**robot.meshes, "stone.png": b"no picture"})
    ports = written(robot, tmp_path / "in")
    assert proved(ports) == []
    (ports / "urdf/meshes/stone.png").write_bytes(picture("grey"))
    assert "equal.urdf.texture" in {f.rule for f in proved(ports)}


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
    ("file", "subject", "quantity", "old", "new"),
    [
        ("meshes/trunk_box_2.obj", "shape b", "texture_corners", "vt 0.125", "vt 0.25"),
        ("meshes/trunk_box.obj", "shape a", "mean_corner", "v -0.2", "v -0.21"),
        ("bot.urdf", "shape a", "texture", "meshes/wood.png", "meshes/stone.png"),
    ],
)  # fmt: skip
def test_textures_and_meshes_are_compared(
    file: str, subject: str, quantity: str, old: str, new: str, tmp_path: Path
):
    findings = proved(edited(textured(), tmp_path / "in", (old, new), file=file))
    rule = f"equal.urdf.{quantity}"
    told = {(f.rule, f.subject) for f in findings}
    others = {(f.rule, s) for f in findings for s in f.data.get("subjects", ())}  # type: ignore[union-attr] # a tuple
    assert (rule, subject) in told | others


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


def test_a_file_that_is_not_there_is_one_error(tmp_path: Path):
    with pytest.raises(UsageError, match="cannot read"):
        UrdfFacts(robot="x").read(tmp_path / "no.urdf")
