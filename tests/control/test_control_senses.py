"""Feet, IMU, sensors, cameras and surfaces find their links, or say who is missing."""

from __future__ import annotations

import pytest
from control.test_control import feet, quadruped, recipe

from assetbuild.control.senses import contacts, placed_cameras, placed_sensors
from assetbuild.robot.actuators import RowError
from assetbuild.robot.model import Place

TREE = quadruped()


def sensors_of(said: object):
    return placed_sensors(TREE, feet(), said.imu, said.feet, said.sensors)


def test_feet_get_a_contact_sensor_each_and_the_imu_its_four():
    made = sensors_of(recipe(feet={"links": ".*_foot"}, imu={"link": "trunk"}))
    assert [s.name for s in made[:4]] == ["imu_ang_vel", "imu_lin_acc", "imu_lin_vel", "imu_quat"]
    assert [s.at for s in made[4:]] == [Place("shape", f"{leg}_f") for leg in ("FL", "FR", "RL", "RR")]  # fmt: skip # noqa: E501


def test_a_surface_changes_only_what_it_says():
    rules = {"friction": [0.5, 0, 0], "links": {".*_foot": {"condim": 6}}}
    found = dict(contacts(feet(), recipe(contact=rules).contact))
    assert set(found) == {"FL_f", "FR_f", "RL_f", "RR_f"}
    assert (found["FL_f"].condim, found["FL_f"].friction) == (6, (0.5, 0.0, 0.0))


BAD = {
    "imu.link: no link `trnk`": {"imu": {"link": "trnk"}},
    "feet.links: pattern `toe` matches no link": {"feet": {"links": "toe"}},
    "sensors.a: no moving joint `knee`": {"sensors": {"a": {"kind": "jointpos", "joint": "knee"}}},
    "sensors.a.relative_to: no link `x`": {
        "sensors": {"a": {"kind": "framepos", "link": "trunk", "relative_to": "x"}}
    },
    "sensors: the name `imu_quat` is taken": {
        "imu": {"link": "trunk"}, "sensors": {"imu_quat": {"kind": "framequat", "link": "trunk"}},
    },
}  # fmt: skip


@pytest.mark.parametrize("message", BAD)
def test_a_link_or_joint_that_is_not_there(message: str):
    with pytest.raises(RowError) as caught:
        sensors_of(recipe(**BAD[message]))
    assert message in caught.value.message


def test_a_pattern_of_surfaces_without_a_shape():
    with pytest.raises(RowError, match="matches no link with a collision shape"):
        contacts(feet(), recipe(contact={"links": {"trunk": {"condim": 1}}}).contact)


def test_an_optical_frame_looks_along_z():
    said = recipe(cameras={"a": {"link": "trunk", "optical": True}}).cameras
    (camera,) = placed_cameras(TREE, said)
    assert camera.X_link_camera.rotation[:, 2] == pytest.approx((0.0, 0.0, -1.0))
