"""A USD asset that breaks on the way is caught, by its validators or by the reader of facts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pxr
import pytest
from pxr import Sdf, Usd, UsdGeom
from robot_files import ranked, run_step, usd_inputs
from tiny import TinyRobot, pendulum, tiny_quadruped

from assetbuild.checks.usd_valid import UsdValid
from assetbuild.findings import Finding
from assetbuild.robot.shapes import Shapes

Spoil = Callable[[Usd.Stage], object]


def check(robot: TinyRobot, folder: Path, spoil: Spoil = lambda _: None) -> list[Finding]:
    """What is said about the asset after `spoil` has edited the layer of its main file."""
    inputs = usd_inputs(folder, robot, spoil)
    return run_step(UsdValid(robot="robot"), inputs, folder / "out")


def rules(findings: list[Finding]) -> set[str]:
    assert all(f.severity == "error" for f in findings)
    return {f.rule for f in findings}


BARE = replace(pendulum(), shapes=Shapes())


@pytest.mark.parametrize("robot", [tiny_quadruped(), pendulum(), BARE])
def test_what_we_write_is_valid(robot: TinyRobot, tmp_path: Path) -> None:
    assert check(robot, tmp_path) == []


def test_absolute_reference_is_caught_even_where_it_still_resolves(tmp_path: Path) -> None:
    outside = tmp_path / "outside.usda"
    other = Usd.Stage.CreateNew(str(outside))
    other.SetDefaultPrim(other.DefinePrim("/x", "Xform"))
    other.Save()

    def spoil(stage: Usd.Stage) -> None:
        stage.DefinePrim("/robot/tool").GetReferences().AddReference(str(outside))

    findings = check(tiny_quadruped(), tmp_path / "build", spoil)
    assert rules(findings) == {"usd.unresolved"}


def test_a_missing_layer_and_a_main_file_that_is_no_usd_are_caught(tmp_path: Path) -> None:
    inputs = usd_inputs(tmp_path, tiny_quadruped())
    (inputs / "usd/payloads/geometries.usdc").unlink()
    unresolved, *_ = run_step(UsdValid(robot="robot"), inputs, tmp_path / "out")
    assert (unresolved.rule, unresolved.severity) == ("usd.unresolved", "error")
    assert "geometries.usdc" in unresolved.message
    (inputs / "usd/robot.usda").write_text("#usda 1.0\ndef Xform {{{")
    assert rules(run_step(UsdValid(robot="robot"), inputs, tmp_path)) == {"usd.unreadable"}


def with_wide_extent(stage: Usd.Stage) -> None:
    """Twice as wide as the shape: renderers would still draw it, others lose it."""
    shapes = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    stated = (UsdGeom.Boundable(prim).GetExtentAttr() for prim in shapes)
    first = next(one for one in stated if one and one.Get() and one.GetPrim().IsA("Sphere"))
    first.Set([2.0 * corner for corner in first.Get()])


def with_scaled_calf(stage: Usd.Stage) -> None:
    """What the validators of USD say is passed on."""
    scaled = stage.GetPrimAtPath("/robot/FR_calf")
    scaled.CreateAttribute("xformOp:scale", Sdf.ValueTypeNames.Double3).Set((1, 2, 3))
    order = ["xformOp:translate", "xformOp:orient", "xformOp:scale"]
    scaled.GetAttribute("xformOpOrder").Set(order)


@pytest.mark.parametrize(
    ("spoil", "rule", "words"),
    [
        (lambda stage: stage.OverridePrim("/robot/Joints/no_joint"), "usd.undefined", "no_joint"),
        (lambda stage: stage.GetPrimAtPath("/robot/trunk/collisions").GetChildren()[0].GetAttribute(
            "extent").Block(), "usd.extent", "states no extent"),
        (lambda stage: stage.GetDefaultPrim().AddAppliedSchema("NewtonSceneAPI"),
         "usd.variant_engines", "`none` has schemas of ['Newton']"),
        (lambda stage: stage.GetRootLayer().__setattr__("customLayerData", {}),
         "usd.extent", "asset_extents"),
        (lambda stage: stage.GetDefaultPrim().GetAttribute("extentsHint").Clear(),
         "usd.extent", "Hint"),
        (with_wide_extent, "usd.extent", "off by"),
        (with_scaled_calf, "usd.validation", ""),
    ],
)  # fmt: skip
def test_prims_that_nobody_defines_and_bounds_that_are_not_stated_are_caught(
    spoil: Spoil, rule: str, words: str, tmp_path: Path
) -> None:
    findings = check(tiny_quadruped(), tmp_path, spoil)
    assert rules(findings) == {rule} and words in findings[0].subject + findings[0].message


def test_a_usd_core_without_validators_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As before 25.2: the module cannot be imported."""
    monkeypatch.delattr(pxr, "UsdValidation", raising=False)
    monkeypatch.setitem(sys.modules, "pxr.UsdValidation", None)
    assert ranked(check(pendulum(), tmp_path)) == [("usd.validation_skipped", "info")]
