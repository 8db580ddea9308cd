"""Two engines that simulate the same robot agree; each difference is a row of its own."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdPhysics
from tiny import (
    TinyRobot,
    kept_feet,
    models,
    run_step,
    spoil_stage,
    tiny_quadruped,
    write_robot_ports,
)

from assetbuild.alignment.moved import Compared, FloorLimits, stand_rows
from assetbuild.alignment.row import Row, findings_of
from assetbuild.alignment.touching import Pairs, touching_in_usd, touching_row
from assetbuild.checks._physx import OFF, Alignment
from assetbuild.facts.readers.usd import UsdReader
from assetbuild.findings import Finding
from assetbuild.report.summary import WITHHELD, public_message
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import Motion, Outcome, Swing, load
from assetbuild.simulators.free_fall import Fall

Spoil = Callable[[Usd.Stage], object]
LOST = Outcome(None, None, "it lost its numbers (NaN) after 0.1 s")
needs_physx = pytest.mark.skipif(
    importlib.util.find_spec("ovphysx") is None, reason="needs the extra `physx`"
)


def check(robot: TinyRobot, folder: Path, spoil: Spoil = lambda stage: None) -> list[Finding]:
    inputs = models(folder, robot)
    spoil_stage(inputs / "usd/robot.usda", spoil)
    short = Swing(frequency=4.0, seconds=0.75, tolerance=0.02)
    return run_step(Alignment(robot="robot", sine=short), inputs, folder / "out")


def rows_of(folder: Path) -> list[dict[str, object]]:
    rows = json.loads((folder / "out/figures.json").read_text())["rows"]
    assert isinstance(rows, list)
    return rows


@needs_physx
def test_quadruped_is_the_same_in_both(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    rows = rows_of(tmp_path)
    assert {row["verdict"] for row in rows} == {"ok", "told"}
    ranks = [row["rank"] for row in rows]
    assert ranks == sorted(ranks, key=("HIGH", "MEDIUM").index)
    landing = next(row for row in rows if row["row"] == "landing_s")
    assert landing["physx"] == pytest.approx(math.sqrt(2 / 9.81), rel=0.01)


@needs_physx
@pytest.mark.slow  # seven experiments in two engines
def test_gains_in_the_wrong_unit_are_a_row(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        for prim in stage.Traverse():
            if prim.IsA(UsdPhysics.RevoluteJoint):
                drive = UsdPhysics.DriveAPI(prim, "angular")
                drive.GetDampingAttr().Set(3.0)  # N m s/rad where N m s/deg belong

    found = {f.rule: f for f in check(tiny_quadruped(), tmp_path, spoil)}
    row = found["alignment.physx.sine"]
    assert (row.severity, row.data["rank"]) == ("error", "HIGH")
    assert public_message(row) == WITHHELD


def test_mjcf_that_does_not_load_is_skipped(tmp_path: Path) -> None:
    inputs = write_robot_ports(tmp_path / "inputs", tiny_quadruped())
    (inputs / "mjcf").mkdir()
    (inputs / "mjcf/robot.xml").write_text("<mujoco>")
    found = run_step(Alignment(robot="robot"), inputs, tmp_path / "out")
    assert found == [], "`mjcf.load` reports it"
    assert "skipped" in json.loads((tmp_path / "out/figures.json").read_text())


def standing(height: float, tilt: float) -> Motion:
    """A root that ends at a height (m), tilted about y (rad)."""
    root, turn = np.zeros((2, 3)), np.zeros((2, 4))
    root[:, 2] = height
    turn[:, 0], turn[:, 2] = math.cos(tilt / 2), math.sin(tilt / 2)
    return Motion(np.array([0.0, 2.0]), {}, root, turn, root)


def test_heights_are_compared_only_of_what_stands() -> None:
    robot = tiny_quadruped()
    both = Compared(
        robot.tree, robot.control, Swing(), Fall(), FloorLimits(), 1, lambda _: LOST, {}, {}
    )
    asked = load(robot.control)

    def verdict(ours: Motion, theirs: Motion) -> str:
        (row,) = stand_rows(both, asked, ours, theirs)
        return row.verdict

    fallen = standing(0.1, 1.5)
    assert verdict(standing(0.3, 0.1), fallen) == "error"
    assert verdict(standing(0.3, 0.1), standing(0.301, 0.1)) == "ok"
    assert verdict(standing(0.2, 0.6), fallen) == "told"


ROW = Row("kp", "HIGH", "joint a", 1.0, 1.0, 0.0, 0.1, 0.2)


def test_rows_are_judged_by_two_limits_and_a_reason_makes_an_error_a_warning() -> None:
    for off, verdict, known in (
        (0.0, "ok", "ok"),
        (0.15, "warning", "warning"),
        (0.3, "error", "warning"),
        (math.nan, "error", "warning"),
        (None, "told", "told"),
    ):
        row = replace(ROW, off=off)
        assert (row.verdict, replace(row, because="soft").verdict) == (verdict, known)
    assert replace(ROW, because="soft").shown("PhysX")["because"] == "soft"


def test_a_kind_of_row_is_one_finding_about_its_worst() -> None:
    """A row without a reason weighs more than a larger one with a reason."""
    worse, known = replace(ROW, subject="joint b", off=0.3), replace(ROW, off=0.4, because="soft")
    (found,) = findings_of([known, ROW, worse, replace(ROW, off=0.15)], OFF, "PhysX")
    assert (found.rule, found.severity) == ("alignment.physx.kp", "error")
    assert (found.subject, found.data["rows"]) == ("joint b", 3)


def in_usd(inputs: Path, tree: Tree) -> Pairs:
    return touching_in_usd(UsdReader(robot="robot").read(inputs / "usd/robot.usda"), tree)


FILTERS = "/robot/FL_foot.physics:filteredPairs"
TOUCHES: dict[str, tuple[Spoil, str]] = {
    "nothing": (lambda stage: None, "ok"),
    "forgets a pair": (lambda stage: stage.GetRelationshipAtPath(FILTERS).SetTargets([]), "error"),
    "filters one too many": (
        lambda stage: stage.GetRelationshipAtPath(FILTERS).AddTarget("/robot/FR_foot"), "error"),
    "none": (
        lambda stage: stage.GetPrimAtPath("/robot/trunk").GetAttribute(
            "physxArticulation:enabledSelfCollisions").Set(False), "error"),
}  # fmt: skip


@pytest.mark.parametrize("does", TOUCHES)
def test_a_touch_that_one_engine_alone_has_is_an_error(tmp_path: Path, does: str) -> None:
    spoil, verdict = TOUCHES[does]
    robot = kept_feet()
    inputs = models(tmp_path, robot)
    spoil_stage(inputs / "usd/robot.usda", spoil)
    model = mujoco.load(inputs / "mjcf/robot.xml").model
    row = touching_row(model, in_usd(inputs, robot.tree), robot.tree, "PhysX")
    assert row.verdict == verdict
    assert (does == "forgets a pair") == ("`FL_foot` and `FL_thigh`" in str(row.theirs))
    assert (does == "filters one too many") == ("`FL_foot` and `FR_foot`" in str(row.mujoco))


def test_that_physx_has_no_contacts_of_a_joint_is_a_warning(tmp_path: Path) -> None:
    """MuJoCo has: a body collides with a parent that is bolted to the world."""
    robot = tiny_quadruped()
    tree, keys = replace(robot.tree, base="fixed"), robot.control.keyframes
    control = replace(robot.control, excludes=(), keyframes=tuple(
        replace(key, base=None) for key in keys))  # fmt: skip
    bolted = replace(robot, tree=tree, links=replace(robot.links, base="fixed"), control=control)
    inputs = models(tmp_path, bolted)
    model = mujoco.load(inputs / "mjcf/robot.xml").model
    row = touching_row(model, in_usd(inputs, tree), tree, "PhysX")
    assert (row.verdict, row.off) == ("warning", 4.0)
