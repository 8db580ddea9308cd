"""A USD asset that breaks on the way is caught, by its validators or by the reader of facts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pxr
import pytest
from pxr import Sdf, Usd, UsdPhysics
from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped

from assetbuild.checks.usd_valid import UsdValid
from assetbuild.facts.readers.usd import UsdReader
from assetbuild.findings import Finding
from assetbuild.robot.model import Body
from assetbuild.targets.usd import Usd as UsdTarget

Spoil = Callable[[Usd.Stage], object]


def spoilt(robot: TinyRobot, folder: Path, spoil: Spoil) -> Path:
    """Inputs of a check after `spoil` has edited the main file's own layer."""
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
    spoil(stage)
    stage.Save()
    del stage
    return inputs


def check(robot: TinyRobot, folder: Path, spoil: Spoil = lambda _: None) -> list[Finding]:
    return run_step(UsdValid(robot="robot"), spoilt(robot, folder, spoil), folder / "out")


def rules(findings: list[Finding]) -> set[str]:
    assert all(f.severity == "error" for f in findings)
    return {f.rule for f in findings}


@pytest.mark.parametrize("robot", [tiny_quadruped(), pendulum()])
def test_what_we_write_is_valid(robot: TinyRobot, tmp_path: Path) -> None:
    assert check(robot, tmp_path) == []


def test_missing_layer_is_caught(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot="robot"), "usd")
    (inputs / "usd/payloads/geometries.usdc").unlink()
    findings = run_step(UsdValid(robot="robot"), inputs, tmp_path / "out")
    unresolved, *_ = findings
    assert (unresolved.rule, unresolved.severity) == ("usd.unresolved", "error")
    assert "geometries.usdc" in unresolved.message


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


# --- what a stage loses is missed by the reader of facts


def no_variant(stage: Usd.Stage) -> None:
    stage.GetDefaultPrim().GetVariantSet("Physics").ClearVariantSelection()


def variant_without_physics(stage: Usd.Stage) -> None:
    stage.GetDefaultPrim().GetVariantSet("Physics").SetVariantSelection("none")


def welded_base(stage: Usd.Stage) -> None:
    joint = UsdPhysics.FixedJoint.Define(stage, "/robot/Joints/root_joint")
    joint.CreateBody1Rel().SetTargets(["/robot/trunk"])


def second_articulation(stage: Usd.Stage) -> None:
    UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath("/robot/FR_calf"))


def no_drive(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath("/robot/Joints/FR_hip_joint").RemoveAPI(UsdPhysics.DriveAPI, "angular")


def base_that_drifts(stage: Usd.Stage) -> None:
    joint = stage.GetPrimAtPath("/robot/Joints/root_joint")
    joint.RemoveAPI(UsdPhysics.ArticulationRootAPI)
    UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath("/robot/base"))


def without(path: str) -> Spoil:
    return lambda stage: stage.GetPrimAtPath(path).SetActive(False)


@pytest.mark.parametrize(
    ("robot", "spoil", "rule", "subject"),
    [
        (tiny_quadruped(), no_variant, "missing", "joint FR_hip_joint"),
        (tiny_quadruped(), variant_without_physics, "missing", "joint FR_hip_joint"),
        (tiny_quadruped(), welded_base, "base", "robot"),
        (tiny_quadruped(), second_articulation, "articulation_root", "robot"),
        (tiny_quadruped(), no_drive, "kp", "joint FR_hip_joint"),
        (tiny_quadruped(), without("/robot/trunk/visuals/trunk_visual"), "missing",
         "shape trunk_visual"),
        (tiny_quadruped(), without("/robot/trunk/collisions/trunk_collision"), "missing",
         "shape trunk_collision"),
        (tiny_quadruped(), without("/robot/Joints/FR_calf_joint"), "missing",
         "joint FR_calf_joint"),
        (tiny_quadruped(), without("/robot/Looks/grey"), "rgba", "shape trunk_visual"),
        (pendulum(), lambda stage: stage.ClearDefaultPrim(), "statement", "stage"),
        (pendulum(), base_that_drifts, "articulation_root", "robot"),
        (pendulum(), without("/robot/Joints/root_joint"), "base", "robot"),
    ],
)  # fmt: skip
def test_a_loss_is_found_by_the_reader(
    robot: TinyRobot, spoil: Spoil, rule: str, subject: str, tmp_path: Path
) -> None:
    found = run_step(UsdReader(robot="robot"), spoilt(robot, tmp_path, spoil), tmp_path / "out")
    told = {(f.rule.rpartition(".")[2], f.subject) for f in found if f.severity == "error"}
    assert (rule, subject) in told, told
