"""Joints are split, and massless links get too little mass for motion to show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from robot_files import check_inputs
from tiny import TinyRobot, ball_inertial, box_inertial

from assetbuild.edits.share_mass import ShareMass
from assetbuild.edits.split_joint import SplitJoint
from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding
from assetbuild.robot.model import Body, Control, Joint, JointKind, Limits, Tree
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.robot.shapes import Shapes, SourceShapes
from assetbuild.targets.mjcf import Mjcf

TILTED = vec3(np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9]))


def base(kind: JointKind, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Tree:
    """A car on a joint of several coordinates, with an arm."""
    X = Pose((0.1, 0.2, 0.3), normalised_quat((0.9, 0.1, -0.2, 0.3)))
    joints = (
        Joint("base", kind, "floor", "car", X, axis),
        Joint("arm", "continuous", "car", "arm", Pose((0.1, 0.0, 0.2)), (0.0, 1.0, 0.0)),
    )
    bodies = (
        Body("floor"),
        Body("car", box_inertial(10.0, (0.6, 0.4, 0.2), (0.1, 0.05, 0.1))),
        Body("arm", box_inertial(2.0, (0.1, 0.1, 0.5), (0.0, 0.0, 0.25))),
    )
    return Tree("car", "fixed", bodies, joints)


def edited(tree: Tree, edit: SplitJoint | ShareMass) -> tuple[Tree, tuple[Finding, ...]]:
    done = edit.edit(tree, SourceShapes(), Files(Path(), Path()))
    return done.tree, done.findings


def split(tree: Tree) -> tuple[Tree, tuple[Finding, ...]]:
    return edited(tree, SplitJoint(joint="base"))


def compiled(tree: Tree, folder: Path) -> mujoco.MjModel:
    robot = TinyRobot(tree, tree, Shapes(), Control())
    inputs = check_inputs(folder, robot, Mjcf(robot="robot"), "mjcf")
    return mujoco.MjModel.from_xml_path(str(inputs / "mjcf/robot.xml"))


def mass_matrix_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    return matrix


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), TILTED])
def test_a_planar_joint_is_what_the_mjcf_made_of_it_before(axis, tmp_path: Path):
    """Names, masses and motion of the two compiled models."""
    before = base("planar", axis)
    one, other = compiled(before, tmp_path / "a"), compiled(split(before)[0], tmp_path / "b")
    for model in (one, other):
        assert [model.joint(i).name for i in range(4)] == ["base_x", "base_y", "base_yaw", "arm"]
    a, b = mujoco.MjData(one), mujoco.MjData(other)
    a.qvel[:] = b.qvel[:] = (1.0, -0.5, 2.0, 0.3)
    for _ in range(200):
        mujoco.mj_step(one, a)
        mujoco.mj_step(other, b)
    assert b.qpos == pytest.approx(a.qpos, rel=1e-9)


@pytest.mark.parametrize("kind", ["ball", "floating"])
def test_the_angles_reach_every_orientation(kind: JointKind, tmp_path: Path):
    """A mass matrix of full rank away from the pose in which two axes are one."""
    model = compiled(split(base(kind))[0], tmp_path)
    data = mujoco.MjData(model)
    data.qpos[:] = np.random.default_rng(0).uniform(-1.0, 1.0, model.nq)
    assert np.linalg.cond(mass_matrix_of(model, data)) < 1e5
    assert model.nv == {"ball": 4, "floating": 7}[kind]


def test_what_changes_is_reported():
    _, (finding,) = split(base("planar"))
    assert (finding.rule, finding.severity) == ("edit.split_joint", "info")
    assert finding.data["links"] == ("base_x_link", "base_y_link")
    tree = base("ball")
    tree = replace(tree, joints=(replace(tree.joints[0], damping=1.0), tree.joints[1]))
    _, (finding,) = split(tree)
    assert finding.severity == "warning"
    assert "damping and friction are left out" in finding.message
    assert "90 degrees" in finding.message


def test_a_hinge_cannot_be_split_nor_a_name_be_taken_twice():
    with pytest.raises(RecipeError, match="`base` is continuous"):
        split(base("continuous"))
    tree = base("planar")
    tree = replace(tree, joints=(tree.joints[0], replace(tree.joints[1], name="base_yaw")))
    with pytest.raises(RecipeError, match="`base_yaw` is the name"):
        split(tree)


TURNED = normalised_quat((0.9, 0.1, -0.2, 0.3))
LIMITS = Limits(-1.2, 1.3, 10.0, 5.0)


def hip(kind: str = "revolute") -> Tree:
    """A ball joint of three hinges, or three slides; the axes do not meet."""
    names = ["trunk", "yaw", "roll", "leg"]
    axes = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    poses = (Pose((0.1, 0.2, 0.0), TURNED), Pose((0.0, 0.0, 0.03)), Pose((0.0, 0.0, 0.05)))
    joints = tuple(
        Joint(f"j{i}", kind, names[i], names[i + 1], poses[i], axes[i], LIMITS)  # type: ignore[arg-type] # a literal
        for i in range(3)
    )
    bodies = (
        Body("trunk", box_inertial(10.0, (0.3, 0.2, 0.1))),
        Body("yaw"),
        Body("roll"),
        Body("leg", box_inertial(2.0, (0.05, 0.06, 0.4), (0.01, 0.0, -0.2))),
    )
    return Tree("hip", "floating", bodies, joints)


def shared(tree: Tree, link: str = "yaw|roll", **more: float) -> tuple[Tree, tuple[Finding, ...]]:
    return edited(tree, ShareMass(link=link, **more))


def dynamics(tree: Tree, folder: Path) -> list[np.ndarray]:
    """Mass matrix and bias force at random poses and speeds, by MuJoCo on our MJCF."""
    model = compiled(tree, folder)
    data, random, found = mujoco.MjData(model), np.random.default_rng(0), []
    for _ in range(10):
        data.qpos[7:] = random.uniform(-1.0, 1.0, model.nq - 7)
        data.qvel[:] = random.uniform(-2.0, 2.0, model.nv)
        found += [mass_matrix_of(model, data), data.qfrc_bias.copy()]
    return found


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_mass_matrix_and_forces_are_the_same(kind: str, tmp_path: Path):
    """Before: three joints on one body. After: three bodies with mass, and no more of it."""
    tree = hip(kind)
    after, (finding,) = shared(tree)
    assert [after.by_body[n].inertial.mass_kg for n in ("yaw", "roll")] == [pytest.approx(2e-9)] * 2
    before_kg, after_kg = (
        sum(b.inertial.mass_kg for b in t.bodies if b.inertial) for t in (tree, after)
    )
    assert after_kg == pytest.approx(before_kg, rel=1e-15)
    assert finding.rule == "edit.share_mass"
    assert finding.data["before_kg"] == 2.0
    for a, b in zip(dynamics(tree, tmp_path / "a"), dynamics(after, tmp_path / "b"), strict=True):
        assert b == pytest.approx(a, rel=1e-8, abs=1e-8)


def with_leg(*moments: float) -> Tree:
    leg = replace(ball_inertial(1.0, 0.1), inertia_com_kg_m2=(*moments, 0.0, 0.0, 0.0))
    return replace(hip(), bodies=(*hip().bodies[:3], Body("leg", leg)))


def test_a_link_that_is_no_solid_body_before_others_join_it_shares_its_mass():
    """The lint of the merged body judges its tensor; the share only needs a least moment."""
    after, _ = shared(with_leg(1.0, 1.0, 3.0))
    yaw = after.by_body["yaw"].inertial
    assert yaw and yaw.inertia_com_kg_m2[:3] == pytest.approx([1e-9] * 3)


@pytest.mark.parametrize(
    ("tree", "fields", "words"),
    [
        (hip(), {"link": "leg"}, "link `leg` is no massless link"),
        (with_leg(-1.0, 1.0, 1.0), {}, "link `leg` has no mass, or a principal moment"),
        (hip(), {"moments": 1.0}, "those of the whole link `leg`"),
    ],
    ids=["not between", "negative moment", "more than there is"],
)
def test_mass_that_cannot_be_shared_is_refused(tree: Tree, fields: dict[str, Any], words: str):
    with pytest.raises(RecipeError, match=words):
        shared(tree, **fields)


def test_an_end_without_mass_shares_that_of_what_fixed_joints_hold(tmp_path: Path):
    """A mobile base in an MJCF: a frame with the joints, and the bodies fixed to it."""
    tree, here = hip(), Pose((0.02, -0.1, 0.3), TURNED)
    light = Body("foot", box_inertial(0.1, (0.1, 0.1, 0.1)))
    frame = replace(tree.by_body["leg"], inertial=None)
    heavy = replace(tree.by_body["leg"], name="shank")
    fixed = (
        Joint("a", "fixed", "leg", "foot", Pose((0.0, 0.1, 0.0))),
        Joint("b", "fixed", "leg", "shank", here),
    )
    bodies = (*tree.bodies[:-1], frame, light, heavy)
    tree = replace(tree, bodies=bodies, joints=(*tree.joints, *fixed))
    after, findings = shared(tree)
    assert findings[0].subject == "link shank" and after.by_body["yaw"].inertial
    for a, b in zip(dynamics(tree, tmp_path / "a"), dynamics(after, tmp_path / "b"), strict=True):
        assert b == pytest.approx(a, rel=1e-6, abs=1e-8)


def test_stated_moments_are_those_of_the_links_and_the_finding_tells_what_they_add():
    tree, (finding,) = shared(hip(), moments=2e-10)
    moments = [tree.by_body[link].inertial for link in ("yaw", "roll")]
    assert [made.inertia_com_kg_m2[:3] for made in moments if made] == [(2e-10,) * 3] * 2
    assert "2e-10 kg m², add 2" in finding.message
    assert "the motion is the same" in shared(hip())[1][0].message
