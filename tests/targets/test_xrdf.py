"""The XRDF says which joints a planner moves, and covers each link by spheres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from robot_files import emit
from tiny import TinyRobot, box_obj, four_bar, pendulum, tiny_quadruped

from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Mesh, MeshAsset, Shape, Shapes, Sphere
from assetbuild.targets.xrdf import Xrdf
from assetbuild.targets.xrdf.covers import XrdfOptions

STATED: dict[str, Any] = {"acceleration": 10, "jerk": 100, "tool_frames": ["arm"]}
MIDDLE = Pose((0.1, 0.0, -0.2))
SIZE = (0.1, 0.08, 0.4)


def with_arm(*shapes: Shape, meshes: tuple[MeshAsset, ...] = ()) -> TinyRobot:
    """The pendulum, whose arm collides with these shapes."""
    return replace(pendulum(), shapes=Shapes(shapes, (), meshes))


def written(
    folder: Path, robot: TinyRobot, has_urdf: bool = True, **options: Any
) -> tuple[dict[str, Any], list[Finding]]:
    said = XrdfOptions.model_validate({**STATED, **options})
    findings = emit(Xrdf(robot="tiny", options=said, has_urdf=has_urdf), robot, folder)
    return yaml.safe_load((folder / "out/xrdf/tiny.xrdf").read_text()), findings


def spheres_of(stated: dict[str, Any], link: str) -> tuple[np.ndarray, np.ndarray]:
    """(centres, radii)."""
    rows = stated["geometry"][stated["collision"]["geometry"]]["spheres"][link]
    return np.array([r["center"] for r in rows]), np.array([r["radius"] for r in rows])


def rules(findings: list[Finding]) -> set[str]:
    return {f.rule for f in findings if f.severity != "info"}


def test_a_sphere_is_taken_as_it_is(tmp_path: Path):
    ball = Shape("ball", "arm", "collision", Sphere(0.0123456789), Pose((0.1, -0.2, 0.3)))
    stated, findings = written(tmp_path, with_arm(ball))
    centres, radii = spheres_of(stated, "arm")
    assert centres.tolist() == [[0.1, -0.2, 0.3]]
    assert radii.tolist() == [0.0123456789]
    assert rules(findings) == set()


@pytest.mark.parametrize("as_mesh", [False, True], ids=["box", "mesh"])
def test_spheres_lie_where_the_collision_is(as_mesh: bool, tmp_path: Path):
    """Points in a box of trimesh's, placed by hand, and their distance from it."""
    asset = MeshAsset("block", "block.obj", 8, 12, convex=True)
    solid = Mesh("block") if as_mesh else Box(SIZE)
    robot = with_arm(Shape("a", "arm", "collision", solid, MIDDLE), meshes=(asset,) * as_mesh)
    stated, findings = written(tmp_path, replace(robot, meshes={"block.obj": box_obj(SIZE)}))
    centres, radii = spheres_of(stated, "arm")
    block = trimesh.creation.box(SIZE, trimesh.transformations.translation_matrix(MIDDLE.xyz))
    points = trimesh.sample.volume_mesh(block, 20000)
    covered = (np.linalg.norm(points[:, None] - centres, axis=2) <= radii).any(axis=1).mean()
    (told,) = (f for f in findings if f.rule == "xrdf.spheres")
    assert told.data["coverage"] == pytest.approx(covered, abs=0.02)
    assert covered > 0.75
    around = trimesh.sample.sample_surface(trimesh.creation.icosphere(4), 2000, seed=0)[0]
    around /= np.linalg.norm(around, axis=1)[:, None]
    skin = (centres[:, None] + radii[:, None, None] * around).reshape(-1, 3)
    beyond = np.linalg.norm(
        np.maximum(np.abs(skin - MIDDLE.xyz) - np.array(SIZE) / 2, 0.0), axis=1
    ).max()
    assert beyond <= float(told.data["outside_m"]) + 1e-9
    assert beyond == pytest.approx(told.data["outside_m"], abs=1e-3)
    assert beyond <= 0.02 * np.linalg.norm(SIZE) + 2e-6


def test_options_bound_the_spheres(tmp_path: Path):
    robot = with_arm(Shape("a", "arm", "collision", Box(SIZE)))
    stated, findings = written(tmp_path, robot, max_spheres=3, margin=0)
    assert len(spheres_of(stated, "arm")[1]) == 3
    (short,) = (f for f in findings if f.severity == "warning")
    assert (short.rule, short.subject, short.data["spheres"]) == ("xrdf.spheres", "link arm", 3)
    assert short.data["outside_m"] < 2e-6
    _, findings = written(tmp_path / "b", robot, max_spheres=3, margin=0, min_coverage=0.1)
    assert rules(findings) == set()


def test_links_that_a_joint_connects_may_touch(tmp_path: Path):
    options = {"tool_frames": ["FR_foot"], "max_spheres": 1, "min_coverage": 0.0}
    stated, findings = written(tmp_path, tiny_quadruped(), **options)
    assert "FR_hip" in stated["self_collision"]["ignore"]["trunk"]
    assert {f.severity for f in findings if f.rule == "xrdf.spheres"} == {"info"}


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"acceleration": None}, "xrdf.limits"),
        ({"jerk": {"other": 3}}, "xrdf.limits"),
        ({"tool_frames": []}, "xrdf.tool_frames"),
        ({"has_urdf": False}, "xrdf.no_urdf"),
    ],
)
def test_what_nobody_states_is_an_error(options: dict[str, Any], rule: str, tmp_path: Path):
    ball = Shape("ball", "arm", "collision", Sphere(0.1))
    stated, findings = written(tmp_path, with_arm(ball), **options)
    (error,) = (f for f in findings if f.severity == "error")
    assert error.rule == rule and error.hint
    if rule == "xrdf.limits":
        assert len(stated["cspace"]) == 2


def test_a_closed_loop_is_an_error(tmp_path: Path):
    robot = four_bar()
    frames = [robot.links.bodies[-1].name]
    _, findings = written(tmp_path, robot, tool_frames=frames, max_spheres=1)
    assert "xrdf.loop" in rules(findings)


def test_overlapping_spheres_are_a_warning(tmp_path: Path):
    """The pendulum hangs 1 m above its base: a ball of 1.1 m around the base reaches the arm."""
    small = Shape("ball", "arm", "collision", Sphere(0.2))
    for name, radius, expected in (("a", 1.1, {"xrdf.overlap"}), ("b", 0.7, set())):
        large = Shape("base", "base", "collision", Sphere(radius))
        _, findings = written(tmp_path / name, with_arm(small, large))
        assert rules(findings) == expected


def planar() -> TinyRobot:
    robot = pendulum()
    tree = replace(robot.tree, joints=(replace(robot.tree.joints[0], kind="planar"),))
    return replace(robot, tree=tree, links=tree)


def open_mesh() -> TinyRobot:
    asset = MeshAsset("block", "block.obj", 8, 12)
    bent = with_arm(Shape("a", "arm", "collision", Mesh("block")), meshes=(asset,))
    return replace(bent, meshes={"block.obj": box_obj(SIZE)})


@pytest.mark.parametrize(
    ("robot", "options"),
    [
        (pendulum(), {"tool_frames": ["arn"]}),
        (pendulum(), {"joints": "swing"}),
        (planar(), {}),
        (open_mesh(), {}),
    ],
    ids=["unknown frame", "no joint", "planar", "open mesh"],
)
def test_what_cannot_be_said_is_refused(robot: TinyRobot, options: dict[str, Any], tmp_path: Path):
    with pytest.raises(StepError) as caught:
        written(tmp_path, robot, **options)
    assert caught.value.hint
