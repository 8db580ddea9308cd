"""Every pair that may touch is judged by what MJX and mujoco_warp have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robot_files import check_inputs, checked, mjcf_inputs, rules, run_step
from tiny import TinyRobot, pendulum, tiny_quadruped, with_control

from assetbuild.checks.mjx_pairs import FAST_ON_WARP, KINDS, NOT_IN_MJX, MjxPairs, judge, pairs
from assetbuild.findings import Finding
from assetbuild.robot.model import Contact
from assetbuild.robot.shapes import Box
from assetbuild.targets.mjx import Mjx, MjxOptions


def tried(robot: TinyRobot, folder: Path, **said: object) -> tuple[list[Finding], dict]:
    target = Mjx(robot="robot", options=MjxOptions.model_validate(said))
    return checked(MjxPairs(), check_inputs(folder, robot, target, "mjx"), folder / "out")


def test_only_the_floor_is_touched_and_every_pair_is_fast(tmp_path: Path) -> None:
    findings, figures = tried(tiny_quadruped(), tmp_path)
    assert findings == []
    assert figures["pairs"] == figures["fast_on_warp"] == 17
    assert set(figures["by_kinds"]) == {"plane-box", "plane-cylinder", "plane-capsule", "plane-sphere"}  # fmt: skip # noqa: E501


def test_with_self_collision_a_cylinder_and_a_box_are_refused(tmp_path: Path) -> None:
    loose = with_control(tiny_quadruped(), excludes=())
    # Hips are cylinders on the trunk's box, but parent and child never touch: so no error yet.
    findings, figures = tried(loose, tmp_path / "a", self_collision=True)
    assert findings == []
    assert figures["pairs"] > figures["fast_on_warp"] >= 17
    box = Box((0.02, 0.02, 0.12))
    shapes = tuple(replace(s, geometry=box) if "calf" in s.name else s for s in loose.shapes.shapes)
    boxes = replace(loose, shapes=replace(loose.shapes, shapes=shapes))
    findings, _ = tried(boxes, tmp_path / "b", self_collision=True)
    assert "mjx.pair" in rules(findings)


def test_a_margin_on_a_mesh_is_refused(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    shapes = tuple(
        replace(s, geometry=robot.shapes.shapes[0].geometry) if s.name == "trunk_collision" else s
        for s in robot.shapes.shapes
    )
    bad = replace(robot, shapes=replace(robot.shapes, shapes=shapes))
    found, _ = tried(with_control(bad, contact=Contact(margin=0.001)), tmp_path)
    assert "mjx.margin" in rules(found)


def test_a_solver_that_mjx_lacks_is_refused(tmp_path: Path) -> None:
    inputs = mjcf_inputs(tmp_path, pendulum())
    model = mujoco.MjModel.from_xml_path(str(inputs / "mjcf/scene.xml"))
    model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
    assert [f.rule for f in judge(model)] == ["mjx.option", "mjx.option"]
    (inputs / "mjx").mkdir()
    (inputs / "mjx/scene_mjx.xml").write_text("<mujoco>")
    assert rules(run_step(MjxPairs(), inputs, tmp_path / "out")) == {"mjx.load"}


def test_the_pairs_are_those_that_mujoco_finds_in_a_heap(tmp_path: Path) -> None:
    """All geoms blown up to overlap: every contact is a pair of ours, and every pair touches."""
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    model = mujoco.MjModel.from_xml_path(str(inputs / "mjcf/scene.xml"))
    solid = (model.geom_contype != 0) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    model.geom_size[solid] = 3.0
    model.geom_rbound[solid] = 10.0
    model.geom_aabb[solid, 3:] = 10.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    found = {tuple(sorted(map(int, c.geom))) for c in data.contact[: data.ncon]}
    assert found == {tuple(sorted(pair)) for alike in pairs(model).values() for pair in alike}
    assert len(found) > 50
    assert np.isfinite(data.xpos).all()


def test_the_tables_are_those_of_the_engines() -> None:
    driver = pytest.importorskip("mujoco.mjx._src.collision_driver", reason="needs mujoco-mjx")
    for a in range(8):
        for b in range(max(a, 1), 8):
            known = driver.has_collision_fn(a, b)
            wanted = (KINDS[a], KINDS[b]) not in NOT_IN_MJX
            if (a, b) != (1, 1) and a != b != 1:
                assert known == wanted, (KINDS[a], KINDS[b])
    assert {kinds for kinds in FAST_ON_WARP if "mesh" in kinds} == {("plane", "mesh")}
