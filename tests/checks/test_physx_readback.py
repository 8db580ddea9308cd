"""What PhysX holds is the robot; each loss on the way is caught by its own finding."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Gf, Usd, UsdPhysics
from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped

from assetbuild.checks.physx_readback import PhysxReadback, expected_joint
from assetbuild.findings import Finding
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.model import Joint, Limits
from assetbuild.robot.pose import Pose
from assetbuild.targets.usd import Usd as UsdTarget

pytest.importorskip("ovphysx", reason="needs the extra `physx`")
pytest.importorskip("warp", reason="needs the extra `physx`")

Spoil = Callable[[Usd.Stage], object]


def check(robot: TinyRobot, folder: Path, spoil: Spoil | None = None) -> list[Finding]:
    """Findings on the robot's asset after `spoil` has edited the main file's own layer."""
    inputs = check_inputs(folder, robot, UsdTarget(robot="robot"), "usd")
    if spoil is not None:
        stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
        spoil(stage)
        stage.Save()
        del stage
    return run_step(PhysxReadback(robot="robot", seconds=0.1), inputs, folder / "out")


def rules(findings: list[Finding]) -> set[str]:
    assert all(f.severity == "error" for f in findings)
    return {f.rule for f in findings}


def joints(stage: Usd.Stage) -> list[Usd.Prim]:
    return [p for p in stage.Traverse() if p.IsA(UsdPhysics.RevoluteJoint)]


def test_quadruped_is_what_it_was(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    counts = {k: figures[k] for k in ("articulations", "bodies", "dof", "shapes", "fixed_base")}
    assert counts == {
        "articulations": 1,
        "bodies": 13,
        "dof": 12,
        "shapes": 17,
        "fixed_base": False,
    }
    assert figures["mass_kg"] == pytest.approx(6.01 + 4 * (0.5 + 0.8 + 0.2), rel=1e-6)


def test_fixed_base_does_not_move(tmp_path: Path) -> None:
    assert check(pendulum(), tmp_path) == []


def test_kept_feet_are_bodies_on_fixed_joints(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    tree = replace(robot.links, bodies=robot.links.bodies)  # nothing merged: `keep_bodies` for all
    assert check(replace(robot, tree=tree), tmp_path) == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    assert (figures["bodies"], figures["dof"], figures["shapes"]) == (18, 12, 17)


def test_gains_in_the_wrong_unit_are_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        for prim in joints(stage):
            attribute = UsdPhysics.DriveAPI(prim, "angular").GetStiffnessAttr()
            attribute.Set(100.0)  # N m/rad where N m/deg belong: 57 times too stiff

    assert "equal.physx.kp" in rules(check(tiny_quadruped(), tmp_path, spoil))


def test_lost_armature_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        for prim in joints(stage):  # as a writer that knows the old spelling only
            prim.GetAttribute("physxJointAxis:angular:armature").Block()

    assert rules(check(tiny_quadruped(), tmp_path, spoil)) == {"equal.physx.armature"}


def test_welded_base_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        joint = UsdPhysics.FixedJoint.Define(stage, "/robot/Joints/root_joint")
        joint.CreateBody1Rel().SetTargets(["/robot/trunk"])
        UsdPhysics.ArticulationRootAPI.Apply(joint.GetPrim())
        root = stage.GetPrimAtPath("/robot/trunk")
        root.RemoveAPI(UsdPhysics.ArticulationRootAPI)

    assert "equal.physx.base" in rules(check(tiny_quadruped(), tmp_path, spoil))


def test_lost_collision_shape_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetPrimAtPath("/robot/trunk/collisions/trunk_collision").SetActive(False)

    assert rules(check(tiny_quadruped(), tmp_path, spoil)) == {"equal.physx.shapes"}


def test_inertia_that_is_not_positive_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        mass = UsdPhysics.MassAPI(stage.GetPrimAtPath("/robot/FR_hip"))
        mass.GetDiagonalInertiaAttr().Set(Gf.Vec3f(-1e-4, 1e-4, 1e-4))

    assert "equal.physx.inertia" in rules(check(tiny_quadruped(), tmp_path, spoil))


def test_unselected_variant_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        stage.GetDefaultPrim().GetVariantSet("Physics").ClearVariantSelection()

    assert "physx.articulation" in rules(check(tiny_quadruped(), tmp_path, spoil))


def test_start_outside_of_the_limits_is_caught(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        for prim in joints(stage):
            prim.GetAttribute("state:angular:physics:position").Set(0.0)

    found = check(tiny_quadruped(), tmp_path, spoil)
    assert "physx.start" in rules(found)


def test_recipe_decides() -> None:
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    asked = whole_model().model_validate(base | {"validate": {"simulators": ["mujoco", "physx"]}})
    assert PhysxReadback.configure(asked) == PhysxReadback(robot="r")
    assert PhysxReadback.configure(whole_model().model_validate(base)) is None


@pytest.mark.parametrize(
    ("stated", "held"), [(6.28, 6.28), (6.28319, 6.28319), (12.6, 2 * math.pi)]
)
def test_a_turn_that_was_rounded_up_is_no_clamped_limit(stated: float, held: float) -> None:
    """As UR's ±6.28319 of MuJoCo's Menagerie: PhysX holds it as it is."""
    limits = Limits(-stated, stated)
    joint = Joint("j", "revolute", "a", "b", Pose(), (0.0, 0.0, 1.0), limits)
    expected = expected_joint(joint, None)
    assert (expected["lower"], expected["upper"]) == (-held, held)
