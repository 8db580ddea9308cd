"""Whether a stated up axis is true is told by the robot: collision shapes and centre of mass."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny import ball_inertial, run_step

from assetbuild.findings import Finding
from assetbuild.geometry.lint_meshes import LintMeshes
from assetbuild.kinds import ConvertedMesh
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Body, Tree
from assetbuild.robot.pose import Pose, quat_of_rpy
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
    record = ConvertedMesh((), 12, 1.0, low, high, True, 1.0, says, turned)
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
    assert (finding.rule, finding.severity) == ("mesh.up_axis.fit", "warning")
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


def test_a_mirrored_mesh_in_millimetres_is_judged_in_its_own_axes(tmp_path: Path):
    down = (Box((0.0002, 0.0002, 0.001)), Pose((0.0, 0.0, 0.0005)))
    (finding,) = lint(tmp_path, collision=down, scale=(0.001, 0.001, 0.001))
    assert finding.data["better"] == 1
