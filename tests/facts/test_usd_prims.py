"""Every prim of a USD, its type, its schemas and the declarations of its attributes are facts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from gripper import gripper
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics
from tiny import TinyRobot, check_inputs, run_step, tiny_quadruped

from assetbuild.facts.readers.usd import UsdReader
from assetbuild.findings import Finding
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd as UsdTarget

JOINTS = "/robot/Joints"
HIP = f"{JOINTS}/FR_hip_joint"
FOOT = "/robot/FR_calf/collisions/FR_foot_collision"
Spoil = Callable[[Usd.Stage], object]


def check(robot: TinyRobot, folder: Path, spoil: Spoil, layer: str) -> list[Finding]:
    """Findings about a USD of which one layer was changed."""
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    stage = Usd.Stage.Open(str(inputs / "usd" / layer))
    spoil(stage)
    stage.Save()
    del stage
    reader = UsdReader(robot="robot", options={"usd": UsdOptions().model_dump(mode="json")})
    return run_step(reader, inputs, folder / "out")


def rename(path: str, name: str) -> Spoil:
    return lambda stage: stage.GetRootLayer().GetPrimAtPath(path).__setattr__("name", name)


def copy(path: str) -> Spoil:
    def spoil(stage: Usd.Stage) -> None:
        layer = stage.GetRootLayer()
        Sdf.CopySpec(layer, path, layer, f"{path}_copy")

    return spoil


BASE, PHYSICS, PHYSX, LOOKS = (
    f"payloads/{name}.usda" for name in ("base", "physics", "physx", "materials")
)


@pytest.mark.parametrize(
    ("word", "path", "layer", "spoil"),
    [
        ("type", "/robot/eye", "robot.usda", lambda s: s.DefinePrim("/robot/eye", "Camera")),
        ("type", f"{JOINTS}/more", PHYSICS, lambda s: s.DefinePrim(f"{JOINTS}/more", "Xform")),
        ("type", "/robot/over", "robot.usda", lambda s: s.OverridePrim("/robot/over")),
        ("type", "/class", "robot.usda", lambda s: s.CreateClassPrim("/class")),
        ("type", "/other", "robot.usda", lambda s: s.DefinePrim("/other", "Camera")),
        ("type", "/robot/FR_hip", BASE,
         lambda s: s.GetPrimAtPath("/robot/FR_hip").SetActive(False)),
        ("type", "/robot/trunk_copy", BASE, copy("/robot/trunk")),
        ("type", "/robot/trunk_copy", PHYSICS, copy("/robot/trunk")),
        ("type", "/robot/Looks", LOOKS, rename("/robot/Looks", "Colours")),
        ("type", "/robot/Looks/red", LOOKS, rename("/robot/Looks/red", "crimson")),
        ("type", "/robot/Looks/red/surface_copy", LOOKS, copy("/robot/Looks/red/surface")),
        ("type", "/robot/trunk/visuals", "payloads/instances.usda",
         lambda s: s.GetPrimAtPath("/robot/trunk/visuals").ClearTypeName()),
        ("schema_unheardapi", HIP, PHYSICS,
         lambda s: s.GetPrimAtPath(HIP).AddAppliedSchema("UnheardAPI")),
        ("linear", HIP, PHYSICS,
         lambda s: UsdPhysics.DriveAPI.Apply(s.GetPrimAtPath(HIP), "linear")),
        ("schema_materialbindingapi", FOOT, PHYSICS,
         lambda s: s.GetPrimAtPath(FOOT).RemoveAppliedSchema("MaterialBindingAPI")),
        ("viscousfrictioncoefficient", HIP, PHYSX,
         lambda s: s.GetPrimAtPath(HIP).RemoveProperty(
             "physxJointAxis:angular:viscousFrictionCoefficient")),
        ("enabledselfcollisions", "/robot/trunk", PHYSX,
         lambda s: s.GetPrimAtPath("/robot/trunk").RemoveProperty(
             "physxArticulation:enabledSelfCollisions")),
        ("body0", HIP, PHYSICS,
         lambda s: s.GetRelationshipAtPath(f"{HIP}.physics:body0").SetMetadata(
             "variability", Sdf.VariabilityVarying)),
        ("orient", "/robot/FR_hip", BASE,
         lambda s: s.GetAttributeAtPath("/robot/FR_hip.xformOp:orient").Set(
             Gf.Quatd(1.0, 0.0, 0.0, 0.01))),
    ],
)  # fmt: skip
def test_every_prim_is_named_typed_and_has_its_schemas(
    word: str, path: str, layer: str, spoil: Spoil, tmp_path: Path
) -> None:
    findings = check(tiny_quadruped(), tmp_path, spoil, layer=layer)
    (found,) = (f for f in findings if f.rule.endswith(word) and f.subject == f"prim {path}")
    assert found.rule.startswith("equal.usd.")
    assert found.data["expected"] != found.data["found"]


@pytest.mark.parametrize("typed", ["tokenx outputs:surface\n", "float outputs:surface\n"])
def test_the_output_of_a_shader_has_its_type(typed: str, tmp_path: Path) -> None:
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot="robot"), "usd")
    path = inputs / "usd" / LOOKS
    path.write_text(path.read_text().replace("token outputs:surface\n", typed, 1))
    findings = run_step(UsdReader(robot="robot"), inputs, tmp_path / "out")
    (found,) = findings
    assert (found.data["expected"], found.data["found"]) == ("token", typed.split()[0])


def test_one_face_that_is_turned_over_is_found(tmp_path: Path) -> None:
    """Both values say where it is, as it stands there."""

    def turn(stage: Usd.Stage) -> None:
        (mesh,) = (p for p in stage.Traverse() if str(p.GetPath()).endswith("block/mesh"))
        indices = UsdGeom.Mesh(mesh).GetFaceVertexIndicesAttr()
        first, second, *others = indices.Get()
        indices.Set([second, first, *others])

    findings = check(gripper(), tmp_path, turn, layer="payloads/geometries.usdc")
    found = next(f for f in findings if f.rule == "equal.usd.triangles_of_the_file")
    values = [str(found.data[side]) for side in ("expected", "found")]
    assert all(value.startswith("12, one at (") for value in values)
    assert sorted(values[0].split()) == sorted(values[1].split())


def test_a_layer_that_is_no_usd_is_one_finding(tmp_path: Path) -> None:
    """With the prim, the statement as it stands there, and where."""
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot="robot"), "usd")
    path = inputs / "usd" / BASE
    path.write_text(path.read_text().replace("quatd xformOp:orient", "xformOp:orient", 1))
    (found,) = run_step(UsdReader(robot="robot"), inputs, tmp_path / "out")
    assert (found.rule, found.subject) == ("equal.usd.statement", "prim /robot/trunk")
    assert str(found.data["found"]).startswith("xformOp:orient = ")
    assert str(found.where).startswith("payloads/base.usda:")
