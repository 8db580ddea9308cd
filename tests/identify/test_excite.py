"""Commands to record stay inside of limits, touch nothing, and say what they will show."""

import json

import mujoco
import numpy as np
import pytest
from logs import JOINTS, arm, prior
from robot_files import run_step

from assetbuild.identify.excite import Excite
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Control

SOLID = """
<mujoco><compiler angle="radian"/><worldbody><geom type="box" size=".02 1 1" pos="{wall} 0 1"/>
 <body name="base"><body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02" mass="1"/>
  <body name="lower" pos="0 0 -.3"><joint name="elbow" axis="0 1 0"/>
   <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".5"/></body></body></body>
</worldbody></mujoco>
"""


def excited(folder, wall=2.0, **keys):
    inputs = folder / "in"
    (inputs / "mjcf").mkdir(parents=True)
    (inputs / "mjcf/scene.xml").write_text(SOLID.format(wall=wall))
    control = Control(tuple(prior(joint) for joint in JOINTS))
    (inputs / "tree.json").write_bytes(encode(arm()))
    for name in ("control.json", "prior.json"):
        (inputs / name).write_bytes(encode(control))
    step = {
        "joints": JOINTS,
        "fit": tuple((joint, ("armature", "damping", "friction", "kd")) for joint in JOINTS),
        "gravity": (0.0, 0.0, -9.81),
        "max_relative_interval": 0.1,
        "seconds": 20.0,
        "file": "scene.xml",
    }
    findings = run_step(Excite(**step | keys), inputs, folder / "out")
    table = np.loadtxt(folder / "out/excite.csv", delimiter=",", skiprows=1)
    return findings, table, json.loads((folder / "out/expected.json").read_text())


def test_commands_begin_and_end_at_rest_inside_the_limits_and_say_what_they_will_show(tmp_path):
    findings, table, expected = excited(tmp_path)
    assert not findings and len(table) == 4000
    command = table[:, 1:]
    assert np.abs(command).max() < 0.7 and np.abs(command[[0, -1]]).max() < 0.02
    assert command.std(axis=0).min() > 0.1
    rows = {(row["joint"], row["parameter"]): row for row in expected}
    friction = rows["shoulder", "friction"]
    assert 0.0 < friction["half_width"] < 0.01 and not friction["confounded"]
    assert rows["elbow", "damping"]["confounded"] and rows["elbow", "kd"]["confounded"]


@pytest.mark.slow
def test_a_robot_beside_a_wall_swings_less(tmp_path):
    findings, table, _ = excited(tmp_path, wall=0.25)
    assert [finding.rule for finding in findings] == ["identify.excite"]
    model = mujoco.MjModel.from_xml_string(SOLID.format(wall=0.25))
    data = mujoco.MjData(model)
    for pose in table[::20, 1:]:
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
