"""A base that moves while the log is taken: its pose is measured, and drives the simulation."""

import mujoco
import numpy as np
import pytest
from logs import (
    DELAY_S,
    JOINTS,
    RATE_HZ,
    assert_found,
    chirps,
    columns_of,
    fitted,
    read,
    text_of_two_links,
)
from scipy.spatial.transform import Rotation

from assetbuild.errors import StepError
from assetbuild.identify.record import commands, on_moving_base, poses
from assetbuild.robot.identify import Columns, Identify

AXES = np.array([0.25, 0.15, 0.1, 0.8, 0.5, 0.6])


def swaying(seconds, rate=RATE_HZ):
    """(N, 6) a ship's deck: m and rad."""
    t = np.arange(int(seconds * rate)) / rate
    return np.stack([a * np.sin((1.0 + 0.3 * n) * t + n) for n, a in enumerate(AXES)], axis=1)


def wxyz(pose):
    return Rotation.from_euler("ZYX", pose[:, 3:]).as_quat()[:, [3, 0, 1, 2]]


def arm_on_a_deck(pose, target, dt=0.0005):
    """Positions of the arm, and how far its base was from the pose."""
    text = text_of_two_links(dt)
    deck = '<body name="root" pos="0 0 0">'
    text = text.replace('<body pos="0 0 1">', deck + '<body pos="0 0 1">', 1)
    text = text.replace("</worldbody>", "</body></worldbody>")
    model, base = on_moving_base(text)
    data, each, late = mujoco.MjData(model), round(1 / RATE_HZ / dt), round(DELAY_S / dt)
    data.qpos[list(base.at)] = pose[0]
    data.qvel[list(base.dof)] = (pose[1] - pose[0]) * RATE_HZ
    fine = np.concatenate([np.repeat(target[:1], late, axis=0), np.repeat(target, each, axis=0)])
    ahead = commands(pose, 1 / RATE_HZ, np.arange(len(pose) * each) / each)
    joints = [int(model.joint(name).qposadr[0]) for name in JOINTS]
    driven = [a for a in range(model.nu) if a not in base.drive]
    data.qpos[joints] = target[0]
    q, off = np.zeros_like(target), 0.0
    for n in range(len(target)):
        q[n] = data.qpos[joints]
        off = max(off, float(np.abs(data.qpos[list(base.at)] - pose[n]).max()))
        for k in range(each):
            data.ctrl[driven], data.ctrl[list(base.drive)] = fine[n * each + k], ahead[n * each + k]
            mujoco.mj_step(model, data)
    return q, off


def test_quaternions_become_angles_and_back():
    pose = swaying(4.0)
    found = poses(wxyz(pose), pose[:, :3], "log.csv")
    assert found == pytest.approx(pose, abs=1e-9)
    body = "<body><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></body>"
    model, base = on_moving_base(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    data.qpos[list(base.at)] = found[77]
    mujoco.mj_kinematics(model, data)
    assert data.xpos[1] == pytest.approx(pose[77, :3])
    assert abs(data.xquat[1] @ wxyz(pose)[77]) == pytest.approx(1.0)


def test_the_base_is_where_it_was_measured():
    _, off = arm_on_a_deck(swaying(3.0), chirps(3.0))
    assert off < 2e-3


@pytest.mark.slow
def test_hidden_parameters_come_out_on_a_base_that_sways(tmp_path):
    pose, target = swaying(20.0), chirps(20.0)
    q, _ = arm_on_a_deck(pose, target)
    q += np.random.default_rng(0).normal(0.0, 3e-4, q.shape)
    fit, findings = fitted(tmp_path / "moving", target, q, base=pose, moving=True)
    assert not findings
    assert_found(fit.parameters, but="delay")
    still, findings = fitted(tmp_path / "still", target, q)
    assert all("it lacks something" in p.refused for p in still.parameters if p.name == "armature")


def columns(pose):
    target = chirps(4.0)
    found = columns_of(target, target)
    found |= {f"base_q{axis}": wxyz(pose)[:, n] for n, axis in enumerate("wxyz")}
    return found | {f"base_{axis}": pose[:, n] for n, axis in enumerate("xyz")}


def test_columns_of_the_base_are_read(tmp_path):
    pose = swaying(4.0)
    named = Columns(base_orientation="base_q{axis}", base_position="base_{axis}")
    _, record = read(tmp_path, columns(pose), columns=named)
    assert record["base_0"] == pytest.approx(pose, abs=1e-6)


def test_an_orientation_that_is_none_is_refused(tmp_path):
    table = columns(swaying(4.0))
    table["base_qw"] = table["base_qw"] + 1.0
    with pytest.raises(StepError, match="of a unit quaternion is 1"):
        read(tmp_path, table, columns=Columns(base_orientation="base_q{axis}"))


def test_a_base_on_its_nose_is_refused():
    pose = swaying(4.0)
    pose[:, 4] = 1.55
    with pytest.raises(StepError, match=r"pitches by 1\.55 rad"):
        poses(wxyz(pose), None, "log.csv")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"base": "measured"}, "needs `base_orientation`"),
        ({"columns": {"base_orientation": "q{axis}"}}, "are for `base: measured`"),
    ],
)
def test_a_measured_base_and_its_columns_belong_together(keys, said):
    with pytest.raises(ValueError, match=said):
        Identify(logs=[{"file": "log.csv"}], **keys)
