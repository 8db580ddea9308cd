"""A USD asset that lost something on the way is caught, each loss by its own finding."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pxr
import pytest
from hypothesis import given, settings
from pxr import Sdf, Usd, UsdPhysics
from tiny import TinyRobot, check_inputs, examples, pendulum, robots, run_step, tiny_quadruped

from assetbuild.checks.usd_valid import UsdValid
from assetbuild.findings import Finding
from assetbuild.robot.model import Body
from assetbuild.targets.usd import Usd as UsdTarget

Spoil = Callable[[Usd.Stage], object]


def check(robot: TinyRobot, folder: Path, spoil: Spoil | None = None) -> list[Finding]:
    """Findings on the robot's asset after `spoil` has edited the main file's own layer."""
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    if spoil is not None:
        stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
        spoil(stage)
        stage.Save()
        del stage
    return run_step(UsdValid(robot="robot"), inputs, folder / "out")


def rules(findings: list[Finding]) -> set[str]:
    assert all(f.severity == "error" for f in findings)
    return {f.rule for f in findings}


def test_quadruped_is_whole_and_counted(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    counts = {key: figures[key] for key in figures if key != "bytes"}
    assert counts == {
        "bodies": 13,
        "joints": 12,
        "drives": 12,
        "colliders": 17,
        "visuals": 2,
        "materials": 2,
    }


def test_fixed_base_is_whole(tmp_path: Path) -> None:
    assert check(pendulum(), tmp_path) == []


@settings(max_examples=examples(10), deadline=None)
@given(robots())
def test_every_random_tree_is_whole(robot: TinyRobot) -> None:
    with TemporaryDirectory() as folder:
        assert check(robot, Path(folder)) == []


def test_unselected_variant_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetDefaultPrim().GetVariantSet("Physics").ClearVariantSelection()

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert {"usd.variant", "usd.count.bodies", "usd.articulation"} <= rules(findings)


def test_variant_without_physics_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetDefaultPrim().GetVariantSet("Physics").SetVariantSelection("none")

    assert "usd.variant" in rules(check(tiny_quadruped(), tmp_path, spoil))


def test_missing_layer_is_caught(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot="robot"), "usd")
    (inputs / "usd/payloads/geometries.usdc").unlink()
    findings = run_step(UsdValid(robot="robot"), inputs, tmp_path / "out")
    assert {"usd.unresolved", "usd.count.visuals"} <= rules(findings)
    assert "geometries.usdc" in next(f.message for f in findings if f.rule == "usd.unresolved")


def test_main_file_copied_alone_is_caught(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot="robot"), "usd")
    (inputs / "usd/payloads").rename(tmp_path / "left_behind")
    findings = run_step(UsdValid(robot="robot"), inputs, tmp_path / "out")
    unresolved = [f.message for f in findings if f.rule == "usd.unresolved"]
    assert len(unresolved) == 5


def test_absolute_reference_is_caught_even_where_it_still_resolves(tmp_path: Path) -> None:
    outside = tmp_path / "outside.usda"
    other = Usd.Stage.CreateNew(str(outside))
    other.SetDefaultPrim(other.DefinePrim("/x", "Xform"))
    other.Save()

    def spoil(stage: Usd.Stage) -> None:
        stage.DefinePrim("/robot/tool").GetReferences().AddReference(str(outside))

    findings = check(tiny_quadruped(), tmp_path / "build", spoil)
    assert rules(findings) == {"usd.unresolved"}


def test_main_file_that_is_no_usd_is_caught(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, pendulum(), UsdTarget(robot="robot"), "usd")
    (inputs / "usd/robot.usda").write_text("#usda 1.0\ndef Xform {{{")
    findings = run_step(UsdValid(robot="robot"), inputs, tmp_path / "out")
    assert rules(findings) == {"usd.unreadable"}


def test_welded_base_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        joint = UsdPhysics.FixedJoint.Define(stage, "/robot/Joints/root_joint")
        joint.CreateBody1Rel().SetTargets(["/robot/trunk"])

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert rules(findings) == {"usd.base"}
    assert "`root_joint` welds the floating base" in findings[0].message


def test_fixed_base_that_would_drift_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        joint = stage.GetPrimAtPath("/robot/Joints/root_joint")
        joint.RemoveAPI(UsdPhysics.ArticulationRootAPI)
        UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath("/robot/base"))

    assert "usd.base" in rules(check(pendulum(), tmp_path, spoil))


def test_fixed_base_without_its_joint_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetPrimAtPath("/robot/Joints/root_joint").SetActive(False)

    assert "usd.articulation" in rules(check(pendulum(), tmp_path, spoil))


def test_second_articulation_root_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath("/robot/FR_calf"))

    assert "usd.articulation" in rules(check(tiny_quadruped(), tmp_path, spoil))


def test_lost_drive_is_caught_by_name(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetPrimAtPath("/robot/Joints/FR_hip_joint").RemoveAPI(UsdPhysics.DriveAPI, "angular")

    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert rules(findings) == {"usd.drive", "usd.count.drives"}
    assert "actuator FR_hip_joint" in {f.subject for f in findings}


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/robot/trunk/visuals/trunk_visual", "visuals"),
        ("/robot/trunk/collisions/trunk_collision", "colliders"),
        ("/robot/Joints/FR_calf_joint", "joints"),
    ],
)
def test_lost_prim_is_counted(path: str, kind: str, tmp_path: Path) -> None:
    findings = check(tiny_quadruped(), tmp_path, lambda s: s.GetPrimAtPath(path).SetActive(False))
    (finding,) = [f for f in findings if f.rule == f"usd.count.{kind}"]
    assert finding.data["found"] == finding.data["expected"] - 1


def test_lost_material_is_caught_twice(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetPrimAtPath("/robot/Looks/grey").SetActive(False)

    assert {"usd.count.materials", "usd.material_binding"} <= rules(
        check(tiny_quadruped(), tmp_path, spoil)
    )


def test_missing_default_prim_is_caught(tmp_path: Path) -> None:
    findings = check(pendulum(), tmp_path, lambda stage: stage.ClearDefaultPrim())
    assert "usd.default_prim" in {f.rule for f in findings}


def test_what_the_validators_of_usd_say_is_passed_on(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        scaled = stage.GetPrimAtPath("/robot/FR_calf")
        scaled.CreateAttribute("xformOp:scale", Sdf.ValueTypeNames.Double3).Set((1, 2, 3))
        order = ["xformOp:translate", "xformOp:orient", "xformOp:scale"]
        scaled.GetAttribute("xformOpOrder").Set(order)

    assert rules(check(tiny_quadruped(), tmp_path, spoil)) == {"usd.validation"}


def test_a_usd_core_without_validators_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As before 25.2: the module cannot be imported."""
    monkeypatch.delattr(pxr, "UsdValidation", raising=False)
    monkeypatch.setitem(sys.modules, "pxr.UsdValidation", None)
    found = check(pendulum(), tmp_path)
    assert [(f.rule, f.severity) for f in found] == [("usd.validation_skipped", "info")]


def test_inertia_that_is_not_positive_is_caught(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    hip = robot.tree.bodies[1]
    assert hip.inertial is not None
    wrong = replace(hip.inertial, inertia_com_kg_m2=(1e-3, -1e-3, 1e-3, 0.0, 0.0, 0.0))
    bodies = (robot.tree.bodies[0], Body(hip.name, wrong), *robot.tree.bodies[2:])
    findings = check(replace(robot, tree=replace(robot.tree, bodies=bodies)), tmp_path)
    assert rules(findings) == {"usd.validation"}
    assert "Inertia" in findings[0].message
