"""The MJCF of a robot from an MJCF is proved word by word: no false alarm, and no lie passes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from mjcfs import Written, hard_arm, read, write
from tiny import run_step

from assetbuild.facts.readers.mjcf import MjcfFacts
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets
from assetbuild.pipeline.recipes import whole_model

RECIPE = {"schema": "assetbuild/v1", "robot": "robot", "source": {"path": ".", "mjcf": "a.xml"}}
ROBOT = """<mujoco><option solver="CG" iterations="7"/><worldbody>
  <body name="torso" pos="0 0 1"><freejoint/><geom name="chest" size=".1" rgba="1 0 0 1"/>
    <site name="hook" pos="0 0 .1"/><site name="plain" group="2"/>
    <camera name="eye" mode="targetbody" target="foot"/>
    <camera name="lens" sensorsize=".004 .002" focal=".002 .002" resolution="64 32"/>
    <geom name="egg" type="ellipsoid" size=".1 .1 .2" contype="2" conaffinity="2"/>
    <body name="foot" pos="0 0 -.3"><joint name="roll"/><joint name="pitch" axis="0 1 0"/>
      <geom name="sole" size=".05" group="1"/>
      <body name="toe" pos=".2 0 0"><joint name="bend" axis="0 1 0"/><geom size=".02"/></body>
    </body></body></worldbody>
<tendon><fixed name="cable"><joint joint="roll" coef="2"/><joint joint="bend" coef="-1"/></fixed>
  <spatial name="rope"><site site="hook"/><geom geom="sole" sidesite="plain"/>
    <site site="plain"/><pulley divisor="2"/><site site="hook"/><site site="plain"/></spatial>
</tendon>
<actuator><motor name="pitch" joint="pitch"/><motor tendon="cable"/></actuator></mujoco>"""


def written(tmp_path: Path, text: str = ROBOT) -> Written:
    reading = read(text, tmp_path / "read") if text else hard_arm(tmp_path / "read")
    made = write(reading, tmp_path / "out")
    shutil.copyfile(reading.read / "links.json", made.inputs / "links.json")
    run_step(MeasureAssets(), made.inputs, tmp_path / "measured")
    shutil.copyfile(tmp_path / "measured" / "assets.json", made.inputs / "assets.json")
    return made


def proved(made: Written) -> list[Finding]:
    check = MjcfFacts.configure(whole_model().model_validate(RECIPE))
    assert check is not None
    out = made.inputs.parent / f"proof{len(list(made.inputs.parent.iterdir()))}"
    return run_step(check, made.inputs, out)


@pytest.mark.parametrize("text", [ROBOT, ""])
def test_words_of_the_source_are_expected(text: str, tmp_path: Path):
    assert proved(written(tmp_path, text)) == []


@pytest.mark.parametrize(
    ("old", "new", "rule", "subject"),
    [
        ('coef="2"', 'coef="2.1"', "path", "tendon cable"),
        ('sidesite="plain"', "", "path", "tendon rope"),
        ('target="foot"', 'target="toe"', "targetbody", "camera eye"),
        ('rgba="1 0 0 1"', 'rgba="0 1 0 1"', "rgba", "shape chest"),
        ('iterations="7"', 'iterations="8"', "iterations", "simulation"),
        ('sensorsize=".004 .002"', 'sensorsize=".004 .001"', "sensor_size", "camera lens"),
        ('<site name="plain" group="2"', '<site name="plain" group="1"', "group", "frame plain"),
    ],
)
def test_a_changed_word_is_found(old: str, new: str, rule: str, subject: str, tmp_path: Path):
    made = written(tmp_path)
    text = made.xml.read_text()
    assert old in text
    made.xml.write_text(text.replace(old, new, 1))
    found = {finding.rule: finding.subject for finding in proved(made)}
    assert found.get(f"equal.mjcf.{rule}") == subject
