"""Every visual shape of the USD has a material: renderers disagree about shapes without one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pxr import Usd as UsdCore
from pxr import UsdGeom, UsdShade
from tiny import TinyRobot, check_inputs, run_step, tiny_quadruped

from assetbuild.facts.readers.usd import UsdReader
from assetbuild.robot.shapes import Material
from assetbuild.targets.usd import Usd


def bare(robot: TinyRobot) -> TinyRobot:
    """The robot whose own material is called `grey` and is on no shape."""
    shapes = tuple(replace(shape, material=None) for shape in robot.shapes.shapes)
    own = (Material("grey", (0.0, 0.0, 1.0, 1.0)),)
    return replace(robot, shapes=replace(robot.shapes, shapes=shapes, materials=own))


def test_a_shape_without_a_material_is_as_grey_as_in_mujoco(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, bare(tiny_quadruped()), Usd(robot="robot"), "usd")
    stage = UsdCore.Stage.Open(str(inputs / "usd/robot.usda"))
    seen = 0
    for prim in stage.Traverse(UsdCore.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Gprim) and UsdGeom.Imageable(prim).ComputePurpose() == "default":
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
            surface = material.ComputeSurfaceSource()[0]
            assert tuple(surface.GetInput("diffuseColor").Get()) == (0.5, 0.5, 0.5)
            seen += 1
    assert seen
    assert not run_step(UsdReader(robot="robot"), inputs, tmp_path / "out")
