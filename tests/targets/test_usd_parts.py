"""Parts of the USD: metadata, materials, variants, surfaces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pxr import Sdf, Usd
from robot_files import check_inputs, emit, run_step
from tiny import TinyRobot, tiny_quadruped, with_control, with_mimic

from assetbuild.facts.readers._usd import UsdReader
from assetbuild.findings import Finding
from assetbuild.robot.model import Contact
from assetbuild.robot.sections import About
from assetbuild.robot.shapes import Material
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd as UsdTarget

ABOUT = About(author="A. Maker", vendor="Legs Ltd", description="It walks", tags=("dog", "toy"))
TARGET = UsdTarget(robot="robot", about_robot=ABOUT, licence="MIT", urdf="robots/quad.urdf")


def metadata(
    target: UsdTarget, folder: Path
) -> dict[str, Any]:  # Any: values of USD's dictionaries
    emit(target, tiny_quadruped(), folder)
    layer = Sdf.Layer.FindOrOpen(str(folder / "out/usd/robot.usda"))
    layer.Reload(force=True)
    return dict(layer.customLayerData["SimReady_Metadata"])


def test_it_says_what_the_recipe_says_of_the_robot(tmp_path: Path) -> None:
    said = metadata(TARGET, tmp_path)
    assert (said["author"], said["vendor"], said["tags"]) == ("A. Maker", "Legs Ltd", "dog, toy")
    assert (said["asset_license"], said["source_file"]) == ("MIT", "quad.urdf")
    assert said["usd_date_generated"].startswith("not recorded")
    assert all(side > 0.0 for side in said["asset_extents"])
    said = metadata(UsdTarget(robot="robot"), tmp_path / "unstated")
    assert not {"author", "vendor", "description", "asset_license", "source_file"} & set(said)


# --- materials -----------------------------------------------------------------------------------


def bare(robot: TinyRobot) -> TinyRobot:
    """The robot whose own material is called `grey` and is on no shape."""
    shapes = tuple(replace(shape, material=None) for shape in robot.shapes.shapes)
    own = (Material("grey", (0.0, 0.0, 1.0, 1.0)),)
    return replace(robot, shapes=replace(robot.shapes, shapes=shapes, materials=own))


def test_a_shape_without_a_material_is_as_grey_as_in_mujoco(tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, bare(tiny_quadruped()), UsdTarget(robot="robot"), "usd")
    assert not run_step(UsdReader(robot="robot"), inputs, tmp_path / "out")
    table = UsdReader(robot="robot").read(inputs / "usd/robot.usda")
    assert table.of("shape", "trunk_visual")["rgba"] == (0.5, 0.5, 0.5, 1.0)


# --- variants ------------------------------------------------------------------------------------


OWN = {"physx": ("physx",), "newton": ("newton", "mjc"), "mujoco": ("newton", "mjc")}
ENGINES = ("physx", "newton", "mjc")


def words(stage: Usd.Stage) -> set[str]:
    """Path and name of all that is authored on a stage."""
    return {
        f"{prim.GetPath()} {name}"
        for prim in stage.Traverse()
        for name in (*prim.GetPrimTypeInfo().GetAppliedAPISchemas(),
                     *prim.GetAuthoredPropertyNames())
    }  # fmt: skip


@pytest.mark.parametrize("variant", OWN)
def test_a_variant_has_the_words_of_its_engines_and_all_of_them(tmp_path: Path, variant: str):
    stage, _ = build(tiny_quadruped(), tmp_path)
    whole = words(stage)
    stage.GetDefaultPrim().GetVariantSet("Physics").SetVariantSelection(variant)
    left_out = tuple(engine for engine in ENGINES if engine not in OWN[variant])
    assert words(stage) == {
        word for word in whole if not word.partition(" ")[2].lower().startswith(left_out)
    }


# --- surfaces ------------------------------------------------------------------------------------

PLAIN = UsdOptions()


def build(
    robot: TinyRobot, folder: Path, options: UsdOptions = PLAIN
) -> tuple[Usd.Stage, list[Finding]]:
    found = emit(UsdTarget(robot="robot", options=options), robot, folder)
    return Usd.Stage.Open(str(folder / "out/usd/robot.usda")), found


def test_each_value_that_physx_cannot_hold_is_told_once(tmp_path: Path) -> None:
    words = {"friction": (0.8, 0.02, 0.01), "condim": 6, "priority": 1, "solref": (0.01, 1.0)}
    words |= {"solimp": (0.9, 0.95, 0.001, 0.5, 2.0), "margin": 0.001, "gap": 0.001}
    soft = Contact.model_validate(words)
    feet = ("FR_foot_collision", soft), ("FL_foot_collision", soft)
    robot = with_control(tiny_quadruped(), contacts=feet)
    _, found = build(robot, tmp_path)
    told = [f.data["value"] for f in found if f.rule == "usd.contact"]
    torsion = "torsional and rolling friction"
    assert told == ["condim", torsion, "priority", "solref", "solimp", "margin", "gap"]


def test_joints_without_a_home_start_inside_of_their_limits(tmp_path: Path) -> None:
    stage, found = build(with_control(tiny_quadruped(), keyframes=()), tmp_path)
    knee = stage.GetPrimAtPath("/robot/Joints/FR_calf_joint")
    at_limit = knee.GetAttribute("state:angular:physics:position").Get()
    assert at_limit == pytest.approx(knee.GetAttribute("physics:upperLimit").Get())
    assert len([f for f in found if f.rule == "usd.start"]) == 4
    assert not [f for f in build(tiny_quadruped(), tmp_path / "home")[1] if f.rule == "usd.start"]


def test_a_mimic_that_the_recipe_leaves_out_is_told(tmp_path: Path) -> None:
    robot = with_mimic(tiny_quadruped(), "FL_hip_joint", "FR_hip_joint", 1.0, 0.0)
    stage, found = build(robot, tmp_path, UsdOptions(mimics=False))
    assert not stage.GetPrimAtPath("/robot/Joints/FL_hip_joint").HasRelationship(
        "newton:mimicJoint"
    )
    assert [f.rule for f in found if f.subject == "joint FL_hip_joint"] == ["usd.mimic"]
