"""Whether a stated up axis is true is told by the robot: collision shapes and centre of mass."""

from __future__ import annotations

from pathlib import Path

import pytest
from robot_files import run_step
from tiny import ball_inertial

from assetbuild.findings import Finding
from assetbuild.geometry.lint_meshes import LintDensity, LintMeshes, judge_up_axes, meshes_to_turn
from assetbuild.mesh.material import ConvertedMesh
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Body, Inertial, Joint, Tree
from assetbuild.robot.pose import Pose, Vec3, quat_of_rpy
from assetbuild.robot.shapes import Box, MeshFile, SourceGeometry, SourceShape, SourceShapes

LONG = ((-0.1, 0.0, -0.1), (0.1, 1.0, 0.1))
"""A rod of 1 m along y of the file: along z once Y_UP is honoured."""
UP = Box((0.2, 0.2, 1.0))
MIDDLE = Pose((0.0, 0.0, 0.5))


def lint(
    tmp_path: Path,
    *,
    says: str | None = "Y_UP",
    turned: bool = False,
    collision: tuple[SourceGeometry, Pose] | None = None,
    com: tuple[float, float, float] = (0.0, 0.0, 0.0),
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
    pose: Pose = Pose(),  # noqa: B008 # it is frozen
) -> list[Finding]:
    lower, upper = LONG if not turned else ((-0.1, -0.1, 0.0), (0.1, 0.1, 1.0))
    bounds = [sorted((a * s, b * s)) for a, b, s in zip(lower, upper, scale, strict=True)]
    low, high = (tuple(side[k] for side in bounds) for k in (0, 1))
    record = ConvertedMesh((), 12, low, high, 1.0, says, turned)
    shapes = [SourceShape("rod_visual", "rod", "visual", MeshFile("m/rod.dae", scale), pose)]
    if collision is not None:
        shapes.append(SourceShape("rod_collision", "rod", "collision", *collision))
    tree = Tree("r", "fixed", (Body("rod", ball_inertial(1.0, 0.1, com)),), ())
    inputs = tmp_path / "in"
    (inputs / "meshes").mkdir(parents=True)
    (inputs / "links.json").write_bytes(encode(tree))
    (inputs / "shapes.json").write_bytes(encode(SourceShapes(tuple(shapes))))
    (inputs / "meshes/0.json").write_bytes(encode(record))
    return run_step(LintMeshes(shapes=("rod_visual",)), inputs, tmp_path / "out")


def test_a_mesh_across_its_collision_shape_would_fit_turned(tmp_path: Path):
    (finding,) = lint(tmp_path, collision=(UP, MIDDLE))
    assert (finding.rule, finding.severity) == ("mesh.up_axis.fit", "error")
    assert "turned to Z" in finding.message
    assert finding.data["meshes"] == ("m/rod.dae",)


def test_one_that_was_turned_wrongly_would_fit_as_it_is(tmp_path: Path):
    along_y = (Box((0.2, 1.0, 0.2)), Pose((0.0, 0.5, 0.0)))
    (finding,) = lint(tmp_path, turned=True, collision=along_y)
    assert "taken as it is" in finding.message
    assert finding.hint == "leave it out of `source.honour_up_axis`"


def test_without_collision_the_centre_of_mass_tells(tmp_path: Path):
    (finding,) = lint(tmp_path, com=(0.0, 0.0, 0.5))
    assert "the centre of mass is off by 38 %" in finding.message  # 0.4 m of 1.04 m
    assert finding.severity == "warning"  # a centre of mass alone may be made up


@pytest.mark.parametrize(
    "robot",
    [
        {"says": None, "collision": (UP, MIDDLE)},
        {"turned": True, "collision": (UP, MIDDLE)},
        {"com": (0.0, 0.5, 0.0)},
        {"com": (0.0, 0.5, 0.0), "collision": (MeshFile("broken.stl"), MIDDLE)},
        {"com": (0.0, 0.0, 0.0)},  # what exporters write who know none
        {"collision": (UP, MIDDLE), "pose": Pose(quat=quat_of_rpy(1.5707963267948966, 0.0, 0.0))},
    ],
    ids=[
        "no axis",
        "honoured",
        "mass inside",
        "a mesh that is not built",
        "no mass",
        "turned by its origin",
    ],
)
def test_what_fits_is_not_told(tmp_path: Path, robot):
    assert lint(tmp_path, **robot) == []


def rods(tmp_path: Path, links: dict[str, tuple[bool, Vec3 | None]]) -> tuple[list[Finding], set]:
    """A chain of rods along z, each with its own mesh.

    links: name -> (was the mesh made along y of its file?, centre of mass).
    """
    bodies, joints, shapes, records = [], [], [], {}
    for name, (is_along_y, com) in links.items():
        inertial = None if com is None else ball_inertial(1.0, 0.1, com)
        bodies.append(Body(name, inertial))
        shapes.append(SourceShape(f"{name}_v", name, "visual", MeshFile(f"{name}.glb"), Pose()))
        low, high = LONG if is_along_y else ((-0.1, -0.1, 0.0), (0.1, 0.1, 1.0))
        records[f"{name}_v"] = ConvertedMesh((), 12, low, high, 1.0, "Y_UP")
        if len(bodies) > 1:
            above = bodies[-2].name
            pose = Pose((0.0, 0.0, 1.0))
            joints.append(Joint(f"{above}_{name}", "revolute", above, name, pose, (1.0, 0.0, 0.0)))
    tree = Tree("r", "fixed", tuple(bodies), tuple(joints))
    drawn = SourceShapes(tuple(shapes))
    return [*judge_up_axes(tree, drawn, records)], set(meshes_to_turn(tree, drawn, records))


TOP = (0.0, 0.0, 0.5)


def test_joints_and_mass_alike_are_sure_of_a_mesh(tmp_path: Path):
    (finding,), turn = rods(tmp_path, {"a": (True, TOP), "b": (False, TOP), "c": (False, TOP)})
    assert turn == {"a.glb"}
    assert finding.severity == "error"
    assert (finding.data["meshes"], finding.data["worse"]) == (("a.glb",), 2)


def test_what_says_nothing_of_itself_follows_most_of_its_format(tmp_path: Path):
    (finding,), turn = rods(tmp_path, {"a": (True, None), "b": (True, None), "tip": (True, None)})
    assert turn == {"a.glb", "b.glb", "tip.glb"}
    assert finding.severity == "warning"  # its joints alone
    assert finding.data["meshes"] == ("a.glb", "b.glb")


@pytest.mark.parametrize(("mass", "told"), [(0.008, True), (0.02, False)])
def test_links_of_the_density_of_no_material_are_told(mass: float, told: bool, tmp_path: Path):
    """Two closed cubes of 20 mm: 8 g at 1000 kg/m3."""
    inertial = Inertial(mass, (0.0, 0.0, 0.0), (1e-6, 1e-6, 1e-6, 0.0, 0.0, 0.0))
    joint = Joint("j", "revolute", "a", "b")
    tree = Tree("r", "fixed", (Body("a", inertial), Body("b", inertial)), (joint,))
    (tmp_path / "meshes").mkdir()
    shapes = []
    for index, link in enumerate("ab"):
        shapes.append(SourceShape(f"{link}_visual", link, "visual", MeshFile(f"{link}.stl")))
        mesh = ConvertedMesh((), 12, (0.0, 0.0, 0.0), (0.02, 0.02, 0.02), 8e-6)
        (tmp_path / f"meshes/{index}.json").write_bytes(encode(mesh))
    (tmp_path / "links.json").write_bytes(encode(tree))
    (tmp_path / "shapes.json").write_bytes(encode(SourceShapes(tuple(shapes), ())))
    found = run_step(LintDensity(shapes=("a_visual", "b_visual")), tmp_path, tmp_path)
    assert [finding.rule for finding in found] == ["inertia.default_density"] * told
