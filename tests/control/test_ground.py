"""The scenes of a fixed robot have their floor below whatever of it moves; MuJoCo says whether."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from tiny import TinyRobot, box_inertial, run_step, write_robot_ports

from assetbuild.control.ground import Ground, with_reach
from assetbuild.robot.model import Body, Control, Joint, Keyframe, Limits, MjcfOnly, Tree
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Geometry, Shape, Shapes, Sphere
from assetbuild.targets.mjcf import Mjcf

BALL = Sphere(0.05)
ON_ZERO, AROUND_ZERO, SUNK = 0.05, 0.0, -0.2
"""Heights of a base 0.1 m high: it stands on z = 0; z = 0 is its middle; it is buried."""


def bolted(
    height: float, moving: Geometry, at: float, turned: float = 0.0, mount: Pose | None = None
) -> TinyRobot:
    """A base with a link on a hinge beside it, about the hinge's y axis.

    height, at: z of the centres of the base's box and of the link, m; turned: home's angle.
    """
    inertial = box_inertial(1.0, (0.1, 0.1, 0.1))
    hinge = Joint(
        "hinge",
        "revolute",
        "base",
        "link",
        Pose((0.3, 0.0, at)),
        (0.0, 1.0, 0.0),
        Limits(-3.0, 3.0, effort=10.0, velocity=5.0),
    )
    bodies = (Body("base", inertial), Body("link", inertial))
    tree = Tree("bolted", "fixed", bodies, (hinge,))
    if mount is not None:
        tree = replace(tree, X_world_root=mount)
    shapes = Shapes((
        Shape("base_0", "base", "collision", Box((0.1, 0.1, 0.1)), Pose((0.0, 0.0, height))),
        Shape("link_0", "link", "collision", moving),
    ))  # fmt: skip
    return TinyRobot(
        tree, tree, shapes, Control(keyframes=(Keyframe("home", (("hinge", turned),)),))
    )


ROD, SLAB = Capsule(0.02, 0.4), Box((0.4, 0.1, 0.02))
ON_A_WALL = Pose((0.0, 0.0, 0.1), quat_of_rpy(0.0, math.pi / 2, 0.0))
"""The link's x = 0.3 m points down."""


@pytest.mark.parametrize(
    ("robot", "below", "severity"),
    [
        (bolted(AROUND_ZERO, BALL, 0.0), 0.05, "info"),
        (bolted(ON_ZERO, BALL, 0.01), 0.04, "warning"),
        (bolted(SUNK, BALL, 0.01), 0.04, "info"),
        (bolted(ON_ZERO, ROD, 0.1), 0.2 + 0.02 - 0.1, "warning"),
        (bolted(ON_ZERO, SLAB, 0.1, 1.0), 0.2 * math.sin(1) + 0.01 * math.cos(1) - 0.1, "warning"),
        (bolted(ON_ZERO, BALL, 0.1, mount=ON_A_WALL), 0.3 + 0.05 - 0.1, "info"),
        (bolted(ON_ZERO, BALL, 0.046), None, None),  # 4 mm
        (bolted(ON_ZERO, ROD, 0.1, 1.5), None, None),  # lies down
        (bolted(SUNK, BALL, 0.1), None, None),  # only the base is in the floor
        (bolted(ON_ZERO, Cylinder(0.1, 0.1), -0.5), 0.55, "warning"),
    ],
)
def test_a_fixed_robot_hangs_over_the_floor_of_its_scene(
    robot: TinyRobot, below: float | None, severity: str | None, tmp_path: Path
):
    """`below` by the support function of each shape; nothing of it that moves touches anything."""
    control, found = with_reach(
        robot.tree, robot.control, Ground(robot.tree, robot.shapes, tmp_path)
    )
    assert control.reach_m == pytest.approx(below or 0.0, abs=1e-9)
    expected = [("keyframe.reaches_below", severity)] if severity else []
    assert [(f.rule, f.severity) for f in found] == expected
    inputs = write_robot_ports(tmp_path / "in", replace(robot, control=control))
    run_step(Mjcf(robot="tiny"), inputs, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    floor = float(model.geom("floor").pos[2])
    assert (floor < 0.0) is (below is not None)
    assert below is None or floor == found[0].data["floor_m"] < -below
    assert all(-contact.dist <= 0.005 for contact in data.contact[: data.ncon])


def test_a_floating_robot_is_put_on_its_floor(tmp_path: Path):
    robot = bolted(AROUND_ZERO, BALL, 0.0)
    tree = replace(robot.tree, base="floating")
    assert with_reach(tree, robot.control, Ground(tree, robot.shapes, tmp_path)) == (
        robot.control,
        [],
    )


def test_a_plane_of_the_source_stays_where_it_is(tmp_path: Path):
    """The check `trials` judges it."""
    robot = bolted(AROUND_ZERO, BALL, 0.0)
    plane = MjcfOnly("body", '<geom name="ground" type="plane" size="1 1 1"/>')
    control = replace(robot.control, mjcf_only=(plane,))
    found = with_reach(robot.tree, control, Ground(robot.tree, robot.shapes, tmp_path))
    assert found == (control, [])
