"""A robot from an MJCF in an archive, built as a user builds it."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import commands
import mujoco
import pytest
from mjcfs import TET

ARM = """<mujoco model="arm"><compiler meshdir="assets"/>
<asset><mesh file="a.obj" scale=".1 .1 .1"/></asset>
<worldbody><body name="base"><geom size=".1" group="3"/>
<geom type="mesh" mesh="a" contype="0" conaffinity="0" group="2"/>
<body name="tip" pos="0 0 .3"><joint name="j" axis="0 1 0" range="-30 30" damping="0.1"/>
<geom name="ball" size=".05" group="3"/><site name="tool" pos="0 0 .1"/></body></body></worldbody>
<actuator><position name="m" joint="j" kp="20" kv="1" ctrlrange="-.5 .5"
  forcerange="-5 5"/></actuator>
<sensor><framepos name="p" objtype="site" objname="tool"/></sensor></mujoco>"""
RECIPE = """schema: assetbuild/v1
robot: arm
source: {path: arm.zip, root: robots, mjcf: arm.xml, license: MIT}
collision: {default: {method: keep}}
targets: [mjcf]
"""


@pytest.mark.slow  # a whole build, pictures and all
def test_an_mjcf_in_a_zip_builds_and_equals_its_source(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "arm.zip", "w") as archive:
        archive.writestr("robots/arm.xml", ARM)
        archive.writestr("robots/assets/a.obj", TET)
    (tmp_path / "arm.yaml").write_text(RECIPE)
    environment = os.environ | {"ASSETBUILD_CACHE": str(tmp_path / "cache")}
    done = commands.run(["build", "arm.yaml", "-o", "out"], tmp_path, environment)
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((tmp_path / "out/report/report.json").read_text())
    assert report["checks"]["mjcf_source"]["status"] == "pass"
    compared = report["checks"]["mjcf_source"]["figures"]["compared"]
    assert compared["shape"] == [3, 3]
    assert compared["sensor"] == [1, 1]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/arm.xml"))
    assert (model.nbody, model.nu, model.nsensor, model.nsite) == (3, 1, 1, 1)
