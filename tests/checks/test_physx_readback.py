"""What PhysX holds is the robot; each loss on the way is caught by its own finding."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdPhysics
from robot_files import about, figures, run_step, usd_inputs, write_robot_ports
from tiny import TinyRobot, box_inertial, pendulum, sprung, tiny_quadruped, with_kinds, with_mimic

from assetbuild.checks._physx import PhysxReadback, _judge_motion
from assetbuild.checks.urdf_kinematics import UrdfKinematics
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Body, Control, Joint, JointKind, Limits, Mimic, Tree
from assetbuild.robot.pose import IDENTITY, Pose, normalised_quat
from assetbuild.robot.shapes import Shapes
from assetbuild.robot.tree import held_by_world
from assetbuild.simulators.experiments import Experiment, Motion, Outcome, Setting
from assetbuild.simulators.stages import perform_on_stages
from assetbuild.targets.urdf import Urdf

Spoil = Callable[[Usd.Stage], object]


def need_physx() -> None:
    for module in ("ovphysx", "warp"):
        pytest.importorskip(module, reason="needs the extra `physx`")


def check(robot: TinyRobot, folder: Path, spoil: Spoil | None = None) -> list[Finding]:
    """Findings on the robot's asset after `spoil` has edited the main file's own layer."""
    need_physx()
    inputs = usd_inputs(folder, robot, spoil)
    return run_step(PhysxReadback(robot="robot", seconds=0.1), inputs, folder / "out")


def joints(stage: Usd.Stage) -> list[Usd.Prim]:
    return [p for p in stage.Traverse() if p.IsA(UsdPhysics.RevoluteJoint)]


def test_quadruped_is_what_it_was(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    found = figures(tmp_path / "out")
    counts = [found[k] for k in ("articulations", "bodies", "dof", "shapes", "fixed_base")]
    assert counts == [1, 13, 12, 17, False]
    assert found["mass_kg"] == pytest.approx(6.01 + 4 * (0.5 + 0.8 + 0.2), rel=1e-6)
    # Nothing merged, as with `keep_bodies` for all: feet are bodies on fixed joints.
    robot = tiny_quadruped()
    assert check(replace(robot, tree=robot.links), tmp_path / "kept") == []
    found = figures(tmp_path / "kept/out")
    assert (found["bodies"], found["dof"], found["shapes"]) == (18, 12, 17)


@pytest.mark.parametrize(
    ("base", "moved_m", "drifts"),
    [("fixed", 1e-6, [1e-6]), ("fixed", 0.0, []), ("floating", 1, [])],
)
def test_a_fixed_base_that_moves_is_an_error(base: str, moved_m: float, drifts: list[float]):
    root = np.array([[0.0, 0.0, 1.0], [0.0, moved_m, 1.0]])
    motion = Motion(np.array([0.0, 1.0]), {}, root, np.ones((2, 4)), root)
    tree = replace(pendulum().tree, base=base)
    found = list(_judge_motion(tree, Outcome(None, motion), "on a floor"))
    assert [f.data["drift_m"] for f in found if f.rule == "physx.drift"] == drifts
    lost = Outcome(None, motion, "it lost its numbers")
    (unstable,) = _judge_motion(tree, lost, "on a floor")
    assert unstable.rule == "physx.finite" and "on a floor: it lost" in unstable.message


def test_a_sprung_arm_settles_where_spring_and_weight_are_equal(tmp_path: Path) -> None:
    """m g r sin q = k (rest - q), by Newton's method; 1 kg, 0.25 m, 6 N m/rad, 0.5 rad."""
    need_physx()
    main = usd_inputs(tmp_path, sprung()) / "usd/robot.usda"
    run = Experiment("swing", Setting(0.002, (0.0, 0.0, -9.81)), steps=3000, every=100)
    motion = perform_on_stages(PhysxReadback.start, main, [run], 240.0)["swing"].motion
    assert motion is not None
    q = 0.0
    for _ in range(50):
        q -= (9.81 / 4 * math.sin(q) - 6 * (0.5 - q)) / (9.81 / 4 * math.cos(q) + 6)
    assert motion.joints["swing_joint"][-1] == pytest.approx(q, abs=1e-5)


def stiff(stage: Usd.Stage) -> None:
    """N m/rad where N m/deg belong: 57 times too stiff."""
    for prim in joints(stage):
        UsdPhysics.DriveAPI(prim, "angular").GetStiffnessAttr().Set(100.0)


def welded(stage: Usd.Stage) -> None:
    joint = UsdPhysics.FixedJoint.Define(stage, "/robot/Joints/root_joint")
    joint.CreateBody1Rel().SetTargets(["/robot/trunk"])
    UsdPhysics.ArticulationRootAPI.Apply(joint.GetPrim())
    stage.GetPrimAtPath("/robot/trunk").RemoveAPI(UsdPhysics.ArticulationRootAPI)


def without_a_shape(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath("/robot/trunk/collisions/trunk_collision").SetActive(False)


def unselected(stage: Usd.Stage) -> None:
    stage.GetDefaultPrim().GetVariantSet("Physics").ClearVariantSelection()


def outside_of_limits(stage: Usd.Stage) -> None:
    for prim in joints(stage):
        prim.GetAttribute("state:angular:physics:position").Set(0.0)


def negated_axis(stage: Usd.Stage) -> None:
    """Each half turn about a line across the axis: on the body's side and on the parent's."""
    joint = UsdPhysics.Joint(stage.GetPrimAtPath("/robot/Joints/FL_calf_joint"))
    for turn in (joint.GetLocalRot0Attr(), joint.GetLocalRot1Attr()):
        axis = str(joint.GetPrim().GetAttribute("physics:axis").Get())
        across = Gf.Quatf(0.0, 0.0, 1.0, 0.0) if axis != "Y" else Gf.Quatf(0.0, 1.0, 0.0, 0.0)
        turn.Set(turn.Get() * across)


@pytest.mark.parametrize(
    ("spoil", "rule", "subject"),
    [
        (stiff, "equal.physx.kp", "joint FR_hip_joint"),
        (welded, "equal.physx.base", "robot"),
        (without_a_shape, "equal.physx.shapes", "body trunk"),
        (unselected, "physx.articulation", "robot"),
        (outside_of_limits, "physx.start", "joint FR_calf_joint"),
        (negated_axis, "equal.physx.axis", "joint FL_calf_joint"),
    ],
)
def test_each_loss_is_caught(spoil: Spoil, rule: str, subject: str, tmp_path: Path) -> None:
    found = check(tiny_quadruped(), tmp_path, spoil)
    assert {f.severity for f in found} == {"error"}
    assert (rule, subject) in about(found)


def coupled() -> TinyRobot:
    """Two arms that hang side by side; `follow` = -0.5 `lead`, and both start at 0."""
    arm = box_inertial(1.0, (0.02, 0.02, 0.5), (0.0, 0.0, -0.25))
    limits = Limits(-2.0, 2.0, 50.0, 10.0)
    lead = Joint("lead", "revolute", "base", "one", Pose((0, 0, 1)), (0.0, 1.0, 0.0), limits)
    beside = Pose((0.0, 0.3, 1.0))
    follow = replace(
        lead, name="follow", child="two", X_parent_joint=beside, mimic=Mimic("lead", -0.5, 0.0)
    )
    tree = Tree("two", "fixed", (Body("base"), Body("one", arm), Body("two", arm)), (lead, follow))
    drives = (Actuator("lead", "pd", kp=200.0, kd=10.0, effort=50.0), Actuator("follow", "passive"))
    return TinyRobot(tree, tree, Shapes(), Control(drives))


@pytest.mark.parametrize("robot", [pendulum(), coupled(), sprung()])
def test_a_fixed_base_a_mimic_and_a_spring_are_what_they_were(
    robot: TinyRobot, tmp_path: Path
) -> None:
    assert check(robot, tmp_path) == []


@pytest.mark.parametrize(
    ("follower", "leader", "multiplier", "offset"),
    [
        ("prismatic", "revolute", -0.05, 0.03),
        ("revolute", "prismatic", 20.0, 0.1),
        ("continuous", "revolute", -3.0, 0.1),
    ],
)
def test_physx_couples_joints_of_any_two_kinds(
    follower: JointKind, leader: JointKind, multiplier: float, offset: float, tmp_path: Path
) -> None:
    robot = with_mimic(coupled(), "follow", "lead", multiplier, offset)
    tree = with_kinds(robot, lead=leader, follow=follower).tree
    short = Limits(-0.1, 0.1, 50.0, 10.0)
    joints = (replace(j, limits=short) if j.kind == "prismatic" else j for j in tree.joints)
    tree = replace(tree, joints=tuple(joints))
    assert check(replace(robot, tree=tree, links=tree), tmp_path) == []


@pytest.mark.parametrize("changed", ["multiplier", "offset", "lost"])
def test_a_mimic_that_physx_couples_otherwise_is_caught(tmp_path: Path, changed: str) -> None:
    """Both arms start at 0, where a flipped sign does not show before one of them moves."""

    def spoil(stage: Usd.Stage) -> None:
        follow = stage.GetPrimAtPath("/robot/Joints/follow")
        gearing, offset = (
            next(a for a in follow.GetAttributes() if a.GetName().endswith(word))
            for word in (":gearing", ":offset")
        )
        if changed == "multiplier":
            gearing.Set(-gearing.Get())
        elif changed == "offset":
            offset.Set(math.degrees(-0.2))
        else:
            schemas = follow.GetPrimTypeInfo().GetAppliedAPISchemas()
            name = next(s for s in schemas if s.startswith("PhysxMimic"))
            follow.RemoveAppliedSchema(name)
            for attribute in (gearing, offset):
                attribute.Block()

    found = {f.rule: f for f in check(coupled(), tmp_path, spoil)}
    rule, expected, value = {
        "multiplier": ("mimic_multiplier", -0.5, 0.5),
        "lost": ("mimic_multiplier", -0.5, 0.0),
        "offset": ("mimic_offset", 0.0, 0.2),
    }[changed]
    row = found[f"equal.physx.{rule}"]
    assert (row.subject, row.data["expected"]) == ("joint follow", expected)
    assert row.data["found"] == pytest.approx(value, abs=1e-3)
    assert changed != "offset" or len(found) == 1


# --- An arm on a wall or a ceiling: every format holds its root there ---


ON_THE_WALL = Pose((0.5, -0.2, 1.5), normalised_quat((1.0, 0.0, 1.0, 0.0)))
"""A quarter turn about y: the pendulum's rest, its -z, points along the world's -x."""


def hung() -> TinyRobot:
    robot = pendulum()
    tree = replace(robot.tree, X_world_root=ON_THE_WALL)
    return replace(robot, tree=tree, links=tree)


def test_the_robots_own_prim_holds_it_in_usd_and_the_link_stays_in_its_origin(
    tmp_path: Path,
) -> None:
    """Isaac Lab replaces the pose of that prim, and at a reset that of the root link."""
    stage = Usd.Stage.Open(str(usd_inputs(tmp_path, hung()) / "usd/robot.usda"))
    for path, place in (("/robot", ON_THE_WALL.xyz), ("/robot/base", (0.0, 0.0, 0.0))):
        found = stage.GetPrimAtPath(path).GetAttribute("xformOp:translate").Get()
        assert np.array(found) == pytest.approx(place)


def test_in_urdf_a_fixed_joint_holds_it_to_a_link_called_world(tmp_path: Path) -> None:
    inputs = write_robot_ports(tmp_path / "in", hung())
    (told,) = [f for f in run_step(Urdf(robot="bot"), inputs, inputs) if f.rule == "urdf.world"]
    assert "(0.5, -0.2, 1.5) m" in told.message
    assert run_step(UrdfKinematics(robot="bot"), inputs, tmp_path / "out") == []
    root = held_by_world(hung().tree).root
    named = replace(hung().tree.bodies[0], name="world")
    other = replace(hung().tree, bodies=(named, hung().tree.bodies[1]))
    assert (root, held_by_world(other).root) == ("world", "world_"), "names never clash"


def test_a_root_lost_in_physx_is_found(tmp_path: Path) -> None:
    def lose(stage: Usd.Stage) -> None:
        prim = stage.GetPrimAtPath("/robot")
        prim.GetAttribute("xformOp:translate").Set(Gf.Vec3d(*IDENTITY.xyz))
        prim.GetAttribute("xformOp:orient").Set(Gf.Quatd(*IDENTITY.quat))

    assert check(hung(), tmp_path / "same") == []
    (found,) = check(hung(), tmp_path / "lost", lose)
    assert (found.rule, found.severity) == ("equal.physx.base_pose", "error")
    assert found.data["found"] == (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
