"""Every word of MuJoCo's schema has a row that says what becomes of it, and the row is true."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import pytest
from mjcfs import Reading, read, write
from robot_files import run_step

from assetbuild.checks.mjcf_source import MjcfSource
from docs.site.pages.mjcf import FATES, HELD, LEFT_OUT, MJCF, MOVES, fate, schema

ROWS = schema()


def test_the_schema_is_the_library_s():
    """Elements and attributes, counted another way: by the words of the printed schema."""
    printed = mujoco.mj_printSchema(False, False)
    words = re.sub(r"\((\*|\?|!|R)\)|\(world\)", " ", printed).split()
    assert sum(1 + len(attributes) for _, attributes in ROWS) == len(words)


def test_no_attribute_is_without_a_row():
    for path, attributes in ROWS:
        for attribute in attributes or ("",):
            assert fate(path, attribute) in FATES, path


# --- the rows are true ----------------------------------------------------------------------

JOINT = """type="hinge" pos=".01 0 0" axis="0 1 0" group="1" stiffness="2" springref=".3"
  range="-1 1" limited="true" margin=".01" ref=".1" armature=".02" damping=".3" frictionloss=".1"
  solreflimit=".03 1" solimplimit=".9 .95 .002 .5 2" solreffriction=".03 1"
  solimpfriction=".9 .95 .002 .5 2" actuatorfrcrange="-4 4" actuatorgravcomp="true" """
GEOM = """type="box" size=".1 .1 .1" pos=".1 0 0" euler="0 .1 0" contype="2" conaffinity="3"
  condim="4" group="3" priority="1" friction=".5 .01 .001" solmix="2" solref=".03 1"
  solimp=".9 .95 .002 .5 2" margin=".01" gap=".005" density="800" rgba="1 0 0 1"
  fluidshape="ellipsoid" fluidcoef=".5 .2 1 1 1" """
SITE = 'type="box" size=".01 .02 .03" pos="0 .1 0" group="2" rgba="0 1 0 1"'
CAMERA = 'mode="track" pos="1 0 0" fovy="40" resolution="30 20" ipd=".07"'
LIGHT = """directional="true" castshadow="false" active="false" pos="0 0 2" dir="0 1 -1"
  ambient=".1 .1 .1" diffuse=".2 .2 .2" specular=".3 .3 .3" mode="track" """
SOFT = 'solref=".03 1" solimp=".9 .95 .002 .5 2"'
FIXED = """group="1" limited="true" range="-2 2" margin=".1" frictionloss=".1" springlength=".1"
  stiffness="1" damping=".2" solreflimit=".03 1" solimplimit=".9 .95 .002 .5 2"
  solreffriction=".03 1" solimpfriction=".9 .95 .002 .5 2" """
ACTED = 'gear="2" ctrlrange="-3 3" ctrllimited="true" forcerange="-9 9" forcelimited="true"'
OPTION = """timestep=".004" gravity="0 0 -5" wind="1 0 0" density="1.2" viscosity=".1"
  magnetic="0 1 0" impratio="3" integrator="implicitfast" cone="elliptic" jacobian="dense"
  solver="CG" iterations="55" tolerance="1e-9" ls_iterations="44" noslip_iterations="2" """

PROBES: dict[tuple[str, ...], str] = {
    ("(world)body", "joint"): JOINT,
    ("(world)body", "geom"): GEOM,
    ("(world)body", "site"): SITE,
    ("(world)body", "camera"): CAMERA,
    ("(world)body", "light"): LIGHT,
    ("(world)body",): 'pos="0 0 .3" euler="0 0 .2" gravcomp=".5"',
    ("equality", "joint"): f'joint1="j" joint2="k" polycoef=".1 .5 0 0 0" {SOFT}',
    ("equality", "connect"): f'body1="a" body2="b" anchor="0 0 .1" {SOFT}',
    ("equality", "tendon"): f'tendon1="t" polycoef=".1 0 0 0 0" {SOFT}',
    ("tendon", "fixed"): FIXED,
    ("actuator", "motor"): 'joint="k" gear="2" ctrlrange="-3 3" ctrllimited="true" group="1"',
    ("actuator", "position"): f'joint="k" kp="3" kv=".2" {ACTED} group="1"',
    ("actuator", "velocity"): f'joint="k" kv=".2" {ACTED}',
    ("actuator", "intvelocity"): f'joint="k" kp="3" kv=".2" {ACTED} actrange="-1 1"',
    ("actuator", "general"): f'joint="k" gaintype="affine" gainprm="2 1" biastype="affine" '
                             f'biasprm="0 -1 -.2" dyntype="filter" dynprm=".1" {ACTED}',
    ("actuator", "damper"): 'joint="k" kv=".2" ctrlrange="0 3" gear="2"',
    ("actuator", "cylinder"): f'joint="k" area=".5" bias="0 -1 0" timeconst=".3" {ACTED}',
    ("option",): OPTION,
}  # fmt: skip


def model(path: tuple[str, ...], said: str) -> str:
    """An arm of two joints that says these words of one element."""
    own = {name: said if path == ("(world)body", name) else "" for name in
           ("joint", "geom", "site", "camera", "light")}  # fmt: skip
    body = said if path == ("(world)body",) else 'pos="0 0 .3"'
    geom = own["geom"] or 'type="capsule" size=".03" fromto="0 0 0 .3 0 0"'
    section = ""
    if path[0] in ("equality", "actuator"):
        section = f'<{path[0]}><{path[-1]} name="x" {said}/></{path[0]}>'
    tendon = said if path[0] == "tendon" else ""
    option = f"<option {said}/>" if path == ("option",) else ""
    return f"""<mujoco><compiler angle="radian"/>{option}<worldbody><body name="base">
      <geom size=".1"/>
      <body name="a" {body}><joint name="j" {own["joint"] or 'axis="0 1 0"'}/>
        <geom name="g" {geom}/><site name="s" {own["site"]}/><camera name="c" {own["camera"]}/>
        <light name="l" {own["light"]}/>
        <body name="b" pos=".3 0 0"><joint name="k" axis="0 1 0"/><geom size=".05"/></body>
      </body></body></worldbody>
      <tendon><fixed name="t" {tendon}><joint joint="j" coef="1"/><joint joint="k" coef="2"/>
      </fixed></tendon>{section}</mujoco>"""


def in_mjcf_alone(reading: Reading, attribute: str) -> bool:
    texts = [item.element for item in reading.control.mjcf_only]
    return any(re.search(rf'\b{attribute}="', text) for text in texts)


@pytest.mark.parametrize("path", PROBES, ids="/".join)
def test_what_a_row_says_becomes_of_the_word(path: tuple[str, ...], tmp_path: Path):
    """Nothing is lost that the row does not call left out, and what is kept for MJCF is there."""
    said = PROBES[path]
    reading = read(model(path, said), tmp_path / "read")
    done = write(reading, tmp_path / "out")
    assert run_step(MjcfSource(robot="robot"), done.inputs, tmp_path / "check") == []
    dropped = " ".join(f.message for f in reading.findings if f.rule == "mjcf.dropped")
    for attribute in re.findall(r"(\w+)=", said):
        told = fate(("mujoco", *path), attribute)
        assert (f"`{attribute}`" in dropped) == (told == LEFT_OUT), attribute
        if told == MJCF or (told == MOVES and path[0] != "actuator"):
            assert in_mjcf_alone(reading, attribute), (attribute, told)
        assert told != HELD or f"`{attribute}`" not in dropped, attribute


def test_every_attribute_of_a_joint_is_probed():
    """But for those that stand for another, that 3.11 lacks, or that a user gives a meaning."""
    (own,) = (set(words) for path, words in ROWS if path[1:] == ("(world)body", "joint"))
    probed = set(re.findall(r"(\w+)=", JOINT))
    assert own - probed == {
        "name", "class", "actuatorfrclimited", "springdamper", "springyield", "user"
    }  # fmt: skip
