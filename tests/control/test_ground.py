"""The ground under a robot, pairs that touch, and its sensors."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from control.test_control import FEET, TREE, recipe
from mjcfs import written
from robot_files import run_step, write_robot_ports
from tiny import TinyRobot, box_inertial

from assetbuild.control.ground import Ground, with_reach
from assetbuild.control.sample_pairs import SamplePairs
from assetbuild.control.senses import changed, check_surfaces, placed_cameras, placed_sensors
from assetbuild.robot.actuators import RowError
from assetbuild.robot.model import Body, Control, Joint, Keyframe, Limits, MjcfOnly, Place, Tree
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


def test_a_robot_stands_on_an_ellipsoid_which_only_mjcf_has(tmp_path: Path):
    text = """<mujoco><worldbody><body name="trunk"><freejoint/><geom size=".1"/>
    <body name="leg" pos="0 0 -.1"><joint name="hip" axis="0 1 0"/><geom size=".05"/>
    <body name="foot" pos="0 0 -.2"><geom name="foot" type="ellipsoid" size=".03 .02 .1"
      pos=".1 0 0" euler="0 30 0"/>
    <geom type="ellipsoid" size=".3 .3 .3" contype="0" conaffinity="0"/>
    </body></body></body></worldbody></mujoco>"""
    stands = {"home": {"base": "on_ground", "joints": {"hip": 0.4}}}
    xml = written(text, tmp_path, keyframes=stands).xml
    model = mujoco.MjModel.from_xml_path(str(xml.with_name("scene.xml")))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    (floor,) = (g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE)
    gap_m = mujoco.mj_geomDistance(model, data, floor, model.geom("foot").id, 1.0, None)
    assert gap_m == pytest.approx(0.0, abs=1e-6)


ROD, SLAB, DISC = Capsule(0.02, 0.4), Box((0.4, 0.1, 0.02)), Cylinder(0.1, 0.1)
ON_A_WALL = Pose((0.0, 0.0, 0.1), quat_of_rpy(0.0, math.pi / 2, 0.0))
"""The link's x = 0.3 m points down."""


@pytest.mark.parametrize(
    ("robot", "below", "severity"),
    [
        (bolted(AROUND_ZERO, BALL, 0.0), 0.05, "info"),
        (bolted(ON_ZERO, BALL, 0.01), 0.04, "warning"),
        (bolted(SUNK, BALL, 0.01), 0.04, "info"),
        (bolted(ON_ZERO, ROD, 0.1, 0.4), 0.2 * math.cos(0.4) + 0.02 - 0.1, "warning"),
        (bolted(ON_ZERO, SLAB, 0.1, 1.0), 0.2 * math.sin(1) + 0.01 * math.cos(1) - 0.1, "warning"),
        (bolted(ON_ZERO, BALL, 0.1, mount=ON_A_WALL), 0.3 + 0.05 - 0.1, "info"),
        (bolted(ON_ZERO, BALL, 0.046), None, None),  # 4 mm
        (bolted(ON_ZERO, ROD, 0.1, 1.5), None, None),  # lies down
        (bolted(SUNK, BALL, 0.1), None, None),  # only the base is in the floor
        (bolted(ON_ZERO, DISC, 0.05, 0.7), 0.1 * math.sin(0.7) + 0.05 * math.cos(0.7) - 0.05,
         "warning"),
    ],
)  # fmt: skip
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


def test_a_floating_robot_and_a_plane_of_the_source_stay_where_they_are(tmp_path: Path):
    """The floor of a floating robot is 0; the check `trials` judges a plane."""
    robot = bolted(AROUND_ZERO, BALL, 0.0)
    floating = replace(robot.tree, base="floating")
    plane = MjcfOnly("body", '<geom name="ground" type="plane" size="1 1 1"/>')
    with_plane = replace(robot.control, mjcf_only=(plane,))
    for tree, control in ((floating, robot.control), (robot.tree, with_plane)):
        assert with_reach(tree, control, Ground(tree, robot.shapes, tmp_path)) == (control, [])


HALF_TURN = Limits(-math.pi, math.pi)


def robot() -> TinyRobot:
    """A base; an arm of 1 m that turns; at its tip a ball of 2 m; a box that slides 50 m away.

    The ball's surface passes the base in every pose. A pin on the base, 1 m aside, is met by the
    arm only when it points there. The box is out of reach.
    """
    bodies = ("base", "arm", "ball", "far", "pin")
    joints = (
        Joint("turn", "revolute", "base", "arm", axis=(0, 0, 1), limits=HALF_TURN),
        Joint("tip", "revolute", "arm", "ball", Pose((1, 0, 0)), (0, 0, 1), HALF_TURN),
        Joint("slide", "prismatic", "base", "far", Pose((50, 0, 0)), limits=Limits(-0.1, 0.1)),
        Joint("nod", "revolute", "far", "pin", Pose((-50, 0.9, 0)), (1, 0, 0), Limits(-0.1, 0.1)),
    )
    shapes = (
        Shape("b", "base", "collision", Box((0.2, 0.2, 0.2))),
        Shape("a", "arm", "collision", Box((0.2, 0.1, 0.1)), Pose((0.9, 0, 0))),
        Shape("s", "ball", "collision", Sphere(2.0)),
        Shape("f", "far", "collision", Box((1.0, 1.0, 1.0))),
        Shape("p", "pin", "collision", Sphere(0.1)),
    )
    tree = Tree("r", "fixed", tuple(Body(name) for name in bodies), joints)
    return TinyRobot(tree, tree, Shapes(shapes))


def test_what_always_and_what_never_touches_is_found(tmp_path):
    folder = write_robot_ports(tmp_path / "in", robot())
    (finding,) = run_step(SamplePairs(samples=200), folder, tmp_path / "out")
    found = json.loads((tmp_path / "out/sampled_pairs.json").read_text())
    always, never = found["always"], found["never"]
    assert ["ball", "base"] in always
    assert ["ball", "pin"] in always  # the pin is less than 2 m from any point of the circle
    assert ["arm", "far"] in never
    assert ["base", "far"] not in always + never  # a joint connects them
    assert not any({"arm", "pin"} == set(pair) for pair in always + never)  # now and then
    assert finding.rule == "exclude.sampled"
    assert finding.data == {"pairs": 6, "always": len(always), "never": len(never)}


def sensors_of(said: object):
    return placed_sensors(TREE, FEET, said.imu, said.feet, said.sensors)


def test_feet_get_a_contact_sensor_each_and_the_imu_its_four():
    made = sensors_of(recipe(feet={"links": ".*_foot"}, imu={"link": "trunk"}))
    assert [s.name for s in made[:4]] == ["imu_ang_vel", "imu_lin_acc", "imu_lin_vel", "imu_quat"]
    assert [s.at for s in made[4:]] == [Place("shape", s.name) for s in FEET.shapes]


def test_a_surface_changes_only_what_it_says():
    rules = {"friction": [0.5, 0, 0], "links": {".*_foot": {"condim": 6}}}
    contact = recipe(contact=rules).contact
    surfaces = {s.name: changed(contact.common, contact.links, s.link) for s in FEET.shapes}
    found = {name: one for name, one in surfaces.items() if one != contact.common}
    assert set(found) == {s.name for s in FEET.shapes}
    assert {(f.condim, f.friction) for f in found.values()} == {(6, (0.5, 0.0, 0.0))}


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"imu": {"link": "trnk"}}, "imu.link: no link `trnk`"),
        ({"feet": {"links": "toe"}}, "feet.links: pattern `toe` matches no link"),
        ({"sensors": {"a": {"kind": "jointpos", "joint": "knee"}}},
         "sensors.a: no moving joint `knee`"),
        ({"sensors": {"a": {"kind": "framepos", "link": "trunk", "relative_to": "x"}}},
         "sensors.a.relative_to: no link `x`"),
        ({"imu": {"link": "trunk"},
          "sensors": {"imu_quat": {"kind": "framequat", "link": "trunk"}}},
         "sensors: the name `imu_quat` is taken"),
    ],
)  # fmt: skip
def test_a_link_or_joint_that_is_not_there(said: dict[str, object], message: str):
    with pytest.raises(RowError) as caught:
        sensors_of(recipe(**said))
    assert message in caught.value.message


def test_an_optical_frame_looks_along_z():
    said = recipe(cameras={"a": {"link": "trunk", "optical": True}}).cameras
    (camera,) = placed_cameras(TREE, said)
    assert camera.X_link_camera.rotation[:, 2] == pytest.approx((0.0, 0.0, -1.0))


def test_a_pattern_of_surfaces_without_a_shape():
    with pytest.raises(RowError, match="matches no link with a collision shape"):
        check_surfaces(FEET, recipe(contact={"links": {"trunk": {"condim": 1}}}).contact)
